"""Show a list with one chosen row; only the rows in sight are drawn."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from textual import events

from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, cut

T = TypeVar("T")


class ListView(Lines, can_focus=True):
    """A list; `at` is the index of the chosen row, which stays in sight."""

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self.at = 0
        self._top = 0
        self._count = 0

    def window(self, items: Sequence[T], paint: Callable[[T, bool], Row]) -> None:
        """Draw the part of the list in sight."""
        self._count = len(items)
        self.move(0)
        height = max(1, self.size.height)
        self._top = max(0, min(self._top, self.at, self._count - height))
        self._top = max(self._top, self.at - height + 1)
        shown = enumerate(items[self._top : self._top + height], start=self._top)
        width = self.size.width
        self.show(cut(paint(item, number == self.at), width) for number, item in shown)

    @property
    def hidden(self) -> tuple[int, int]:
        """The numbers of rows above and below those in sight."""
        return self._top, max(0, self._count - self._top - max(1, self.size.height))

    def move(self, rows: int) -> None:
        """Move the choice by rows, up to the ends."""
        self.at = max(0, min(self._count - 1, self.at + rows))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Move the choice up."""
        event.stop()
        self.move(-1)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Move the choice down."""
        event.stop()
        self.move(1)

    def on_click(self, event: events.Click) -> None:
        """Choose the row that was clicked."""
        self.at = self._top + event.y
        self.move(0)
