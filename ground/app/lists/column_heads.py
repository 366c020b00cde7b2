"""Show the heads of a table; a click on one sorts by its column."""

from typing import Any

from textual import events

from ground.app.lists.table import Heads
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import cut


class ColumnHeads(Lines):
    """The heads of the columns in one row."""

    def __init__(self, heads: Heads[Any], *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._heads = heads

    def draw(self) -> None:
        """Draw the heads."""
        self.show([cut(self._heads.heads(), self.size.width)])

    def on_click(self, event: events.Click) -> None:
        """Sort by the column that was clicked."""
        event.stop()
        self._heads.sort_by(self._heads.column_at(event.x))
        self.draw()
