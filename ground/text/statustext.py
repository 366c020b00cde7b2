"""Joins the pieces of a long STATUSTEXT message."""

from protocol.wire.message import Message
from protocol.wire.messages import Statustext
from protocol.wire.statustext import MAX_PIECES, PIECE_BYTES
from runtime.cli.terminal import printable
from runtime.units import NS_PER_S

LIVE_NS = 2 * NS_PER_S
"""Age up to which a text is shown without its age."""


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


def aged(text: str, age_ns: int) -> str:
    """Append the age to a text that arrived late."""
    if age_ns <= LIVE_NS:
        return text
    age_s = age_ns // NS_PER_S
    if age_s < 120:
        return f"{text} ({age_s} s ago)"
    return f"{text} ({age_s // 60} min ago)" if age_s < 7200 else f"{text} ({age_s // 3600} h ago)"
