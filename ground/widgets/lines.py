"""Rows of text on the screen; only those that have changed are drawn again."""

from collections.abc import Iterable
from itertools import zip_longest

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from ground.widgets.paint import styles_of
from ground.widgets.rows import Row, in_ascii


class Lines(Widget):
    """A panel. `drawn` counts the rows that were drawn, for whoever measures."""

    def __init__(self, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self._rows: tuple[Row, ...] = ()
        self.drawn = 0

    @property
    def rows(self) -> tuple[Row, ...]:
        return self._rows

    def show(self, rows: Iterable[Row]) -> None:
        """From the top; what is below the last row is empty."""
        before, self._rows = self._rows, tuple(rows)
        if before == self._rows:
            return
        pairs = enumerate(zip_longest(before, self._rows))
        width, height = self.size
        changed = [Region(0, y, width, 1) for y, (old, new) in pairs if old != new and y < height]
        if changed:
            self.refresh(*changed)

    def render_line(self, y: int) -> Strip:
        self.drawn += 1
        ground, width = self.rich_style, self.size.width
        if y >= len(self._rows):
            return Strip.blank(width, ground)
        ascii_only = self.app.has_class("-ascii")
        strip = strip_of(self._rows[y], self.app.theme, ground, ascii_only=ascii_only)
        return strip.adjust_cell_length(width, ground)


def strip_of(row: Row, theme: str, ground: Style, *, ascii_only: bool) -> Strip:
    """A row in the colours of a theme."""
    styles = styles_of(theme)
    return Strip(
        [
            Segment(in_ascii(text) if ascii_only else text, ground + styles[role])
            for text, role in row
            if text
        ]
    )
