"""Define the command line: it completes words, and takes pasted text as plain text."""

from collections.abc import Callable

from textual import events
from textual.suggester import Suggester
from textual.widgets import Input


class Completion(Suggester):
    """Suggests the first completion, shown faintly behind the cursor."""

    def __init__(self, complete: Callable[[str], list[str]]) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._complete = complete

    async def get_suggestion(self, value: str) -> str | None:
        """Return the first completion, unless it is the text itself."""
        found = self._complete(value)
        return found[0] if found and found[0] != value else None


class CommandLine(Input):
    """A line of input; it sends `Submitted` when Enter is pressed."""

    def __init__(self, complete: Callable[[str], list[str]]) -> None:
        super().__init__(
            id="command", select_on_focus=False, compact=True, suggester=Completion(complete)
        )
        self._complete = complete
        self._found: list[str] = []

    def begin(self, text: str) -> None:
        """Start with this text, the cursor behind it, and take the focus."""
        self.value = text
        self.cursor_position = len(text)
        self.screen.set_focus(self)

    def complete(self) -> None:
        """Insert the next completion; further calls go through all of them."""
        if self.value in self._found:
            after = self._found.index(self.value) + 1
            self.value = self._found[after % len(self._found)]
        else:
            self._found = self._complete(self.value)
            self.value = self._found[0] if self._found else self.value
        self.cursor_position = len(self.value)

    def _on_paste(self, event: events.Paste) -> None:
        """Insert one line of pasted text without control characters."""
        event.prevent_default()
        event.stop()
        self.insert_text_at_cursor(printable(event.text))


def printable(text: str) -> str:
    """Return the first line that is not blank, at most 400 characters, all printable."""
    lines = (line.strip() for line in text.splitlines())
    line = next((line for line in lines if line), "")
    return "".join(mark for mark in line if mark.isprintable())[:400]
