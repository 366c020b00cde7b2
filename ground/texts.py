"""Puts the pieces of a long STATUSTEXT together again."""

from protocol.message import Message
from protocol.messages import Statustext

PIECE_BYTES = 50
MOST_PIECES = 20


class Texts:
    """One sender's texts. A piece that belongs to no text begun is shown as it is."""

    def __init__(self) -> None:
        self._id = 0
        self._pieces: list[str] = []

    def receive(self, message: Message) -> str:
        """The text that is complete now, or nothing."""
        if not isinstance(message, Statustext):
            return ""
        if not message.id:
            return message.text
        if message.id != self._id or message.chunk_seq != len(self._pieces):
            self._id, self._pieces = message.id, []
        self._pieces.append(message.text)
        if len(message.text.encode()) >= PIECE_BYTES and len(self._pieces) < MOST_PIECES:
            return ""
        text, self._pieces, self._id = "".join(self._pieces), [], 0
        return text
