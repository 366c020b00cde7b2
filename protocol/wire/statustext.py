"""Split a text into the pieces of 50 bytes that MAVLink sends, and join them.

All pieces but the last are full: a shorter piece, possibly empty, marks the end of the text.
"""

from typing import Final

from protocol.wire.message import Message
from protocol.wire.messages import Statustext
from runtime.cli.terminal import printable

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


class StatustextAssembler:
    """Joins one sender's texts, each to one printable line.

    A piece without a text begun before it is shown alone.
    """

    def __init__(self) -> None:
        self._id = 0
        self._pieces: list[str] = []

    def receive(self, message: Message) -> str:
        """Return the text that this message completes, or nothing."""
        if not isinstance(message, Statustext):
            return ""
        if not message.id:
            return printable(message.text)
        if message.id != self._id or message.chunk_seq != len(self._pieces):
            self._id, self._pieces = message.id, []
        self._pieces.append(message.text)
        if len(message.text.encode()) >= PIECE_BYTES and len(self._pieces) < MAX_PIECES:
            return ""
        text, self._pieces, self._id = "".join(self._pieces), [], 0
        return printable(text)
