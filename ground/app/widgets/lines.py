"""Show rows, lists with a chosen row, and growing logs, and draw only what is in sight and changed.

The terminal gets no control characters of them.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import zip_longest
from typing import TypeVar

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.color import Color
from textual.filter import LineFilter
from textual.geometry import Region
from textual.strip import Strip

from ground.app.widgets.role_colours import styles_of
from ground.app.widgets.rows import Row, cut, in_ascii
from ground.app.widgets.strip_widget import StripWidget
from runtime.cli.terminal import REPLACEMENT


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


class Printable(LineFilter):
    """Replaces each unprintable character by as many cells as Textual counted for it.

    Textual passes the rows of all widgets, its own included, through this filter.
    """

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments without control characters."""
        if all(segment.text.isprintable() for segment in segments):
            return segments
        return [Segment(cleaned(text), style, control) for text, style, control in segments]


def cleaned(text: str) -> str:
    """Return the text without control characters."""
    return "".join(one if one.isprintable() else REPLACEMENT * cell_len(one) for one in text)
