"""Text for a terminal, and whether it has taken all that was written to it."""

from io import BufferedWriter, FileIO, TextIOWrapper


class TerminalText(TextIOWrapper):
    """`busy` from a write until the flush after it is done, as a slow terminal lets it be.

    Textual writes from a thread of its own, and flushes whenever nothing else waits to be written.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(BufferedWriter(FileIO(descriptor, "w")), encoding="utf-8")
        self.busy = False

    def write(self, text: str) -> int:
        self.busy = True
        return super().write(text)

    def flush(self) -> None:
        super().flush()
        self.busy = False
