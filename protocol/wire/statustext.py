"""A text of any length as the pieces of 50 bytes in which MAVLink sends it.

All pieces but the last are full: a shorter one, empty if need be, tells that the text has ended.
"""

from typing import Final

from protocol.wire.messages import Statustext

PIECE_BYTES: Final = 50
MOST_PIECES: Final = 20


def pieces_of(text: str, number: int, severity: int) -> list[Statustext]:
    """One message, or several under this number; beyond 50 bytes only ASCII survives, and of a
    text that is longer than all pieces its beginning."""
    encoded = text.encode(errors="replace").replace(b"\0", b" ")
    if len(encoded) <= PIECE_BYTES:
        return [Statustext(severity=severity, text=encoded.decode(), id=0, chunk_seq=0)]
    encoded = text.encode("ascii", "replace").replace(b"\0", b" ")[: PIECE_BYTES * MOST_PIECES - 1]
    return [
        Statustext(
            severity=severity,
            text=encoded[at : at + PIECE_BYTES].decode("ascii"),
            id=number,
            chunk_seq=at // PIECE_BYTES,
        )
        for at in range(0, len(encoded) + 1, PIECE_BYTES)
    ]
