"""Show a part of a long list of lines that grows."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from textual import events

from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row

T = TypeVar("T")


class LogView(Lines, can_focus=True):
    """Shows the newest lines while `following`, else the part that was scrolled to.

    Only the lines in sight are turned into rows.
    """

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self.following = True
        self._top = 0
        self._count = 0

    def window(self, lines: Sequence[T], paint: Callable[[T], Row]) -> None:
        """Draw the lines in sight."""
        self._count = len(lines)
        last_top = max(0, self._count - self.size.height)
        self._top = last_top if self.following else max(0, min(self._top, last_top))
        self.show(map(paint, lines[self._top : self._top + self.size.height]))

    def move(self, rows: int) -> None:
        """Scroll by rows; at the end, follow the newest line again."""
        last_top = max(0, self._count - self.size.height)
        self._top = max(0, min(last_top, self._top + rows))
        self.following = self._top >= last_top

    def go(self, line: int) -> None:
        """Scroll so that this line is in the middle."""
        self._top = max(0, line - self.size.height // 2)
        self.following = False

    def reveal(self, line: int) -> None:
        """Scroll as little as possible so that this line is in sight."""
        self._top = max(min(self._top, line), line - self.size.height + 1)
        self.following = False

    def line_at(self, y: int) -> int:
        """Return the line that is drawn in a row."""
        return self._top + y

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Scroll up."""
        event.stop()
        self.move(-3)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Scroll down."""
        event.stop()
        self.move(3)
