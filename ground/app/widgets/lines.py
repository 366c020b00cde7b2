"""Show rows of text, and draw only those that have changed."""

from collections.abc import Iterable
from itertools import zip_longest

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip

from ground.app.widgets.role_colours import styles_of
from ground.app.widgets.rows import Row, in_ascii
from ground.app.widgets.strip_widget import StripWidget


class Lines(StripWidget):
    """A panel of rows; `drawn` counts the rows drawn, for measurements."""

    def __init__(self, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self._rows: tuple[Row, ...] = ()
        self._strips: dict[int, Strip] = {}
        self._appearance: tuple[object, ...] = ()
        self._ground = Style.null()
        self.drawn = 0

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows that are shown."""
        return self._rows

    def show(self, rows: Iterable[Row]) -> None:
        """Show these rows, the first at the top; the space below the last is empty."""
        before, self._rows = self._rows, tuple(rows)
        if before == self._rows:
            return
        pairs = enumerate(zip_longest(before, self._rows))
        width, height = self.size
        changed = [y for y, (old, new) in pairs if old != new]
        for y in changed:
            self._strips.pop(y, None)
        regions = [Region(0, y, width, 1) for y in changed if y < height]
        if regions:
            self.refresh(*regions)

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return the strips of a region."""
        self._restyle()
        return super().render_lines(crop)

    def render_line(self, y: int) -> Strip:
        """Return one strip, drawn if it has changed."""
        strip = self._strips.get(y)
        if strip is None:
            self._restyle()
            strip = self._strips[y] = self._strip(y)
        return strip

    def notify_style_update(self) -> None:
        """Draw again: Textual applies the style sheet of a new theme some time after the switch."""
        super().notify_style_update()
        self._appearance = ()
        self._strips.clear()
        self.refresh()

    def _restyle(self) -> None:
        """Clear the cache when the theme, the character set or the width has changed."""
        appearance = (self.app.theme, self.app.has_class("-ascii"), self.size.width)
        if appearance != self._appearance:
            self._appearance, self._ground = appearance, self.rich_style
            self.forget_background()
            self._strips.clear()

    def _strip(self, y: int) -> Strip:
        self.drawn += 1
        width = self.size.width
        if y >= len(self._rows):
            return Strip.blank(width, self._ground)
        ascii_only = self.app.has_class("-ascii")
        strip = strip_of(self._rows[y], self.app.theme, self._ground, ascii_only=ascii_only)
        return strip.adjust_cell_length(width, self._ground)


def strip_of(row: Row, theme: str, ground: Style, *, ascii_only: bool) -> Strip:
    """Return a row in the colours of a theme."""
    styles = styles_of(theme)
    return Strip(
        [
            Segment(in_ascii(text) if ascii_only else text, ground + styles[role])
            for text, role in row
            if text
        ]
    )
