"""Split a text into the pieces of 50 bytes that MAVLink sends.

All pieces but the last are full: a shorter piece, possibly empty, marks the end of the text.
"""

from typing import Final

from protocol.wire.messages import Statustext

PIECE_BYTES: Final = 50
MAX_PIECES: Final = 20


def pieces_of(text: str, number: int, severity: int) -> list[Statustext]:
    """Return one message, or several with the same `number`.

    Beyond 50 bytes, characters outside ASCII are replaced. Beyond MAX_PIECES the text is cut.
    """
    encoded = text.encode(errors="replace").replace(b"\0", b" ")
    if len(encoded) <= PIECE_BYTES:
        return [Statustext(severity=severity, text=encoded.decode(), id=0, chunk_seq=0)]
    encoded = text.encode("ascii", "replace").replace(b"\0", b" ")[: PIECE_BYTES * MAX_PIECES - 1]
    return [
        Statustext(
            severity=severity,
            text=encoded[at : at + PIECE_BYTES].decode("ascii"),
            id=number,
            chunk_seq=at // PIECE_BYTES,
        )
        for at in range(0, len(encoded) + 1, PIECE_BYTES)
    ]
