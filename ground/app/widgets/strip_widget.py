"""Draw widgets from their strips, without Textual's general method where that is possible.

Containers draw only background and border, so their strips are cached: Textual draws each container
below a changed widget, although the children cover it.
"""

from textual.color import Color
from textual.containers import Container, Grid, Horizontal, Vertical
from textual.filter import LineFilter
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget


class StripWidget(Widget):
    """A widget whose `render_line` returns strips from a cache, with the background in them.

    Without padding, and with no border except a left one, they are used unchanged. That takes a
    third of the time of Textual's general method. Call `forget_background` after every change of
    the style.
    """

    _background: Color | None = None
    _edge: Strip | None = None
    _filters: tuple[LineFilter, ...] = ()
    _finished: dict[int, tuple[Strip, Strip]]

    def forget_background(self) -> None:
        """Compute the background and the border again at the next drawing."""
        self._background = self._edge = None

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return the strips of a region."""
        top, right, bottom, left = self.styles.gutter
        if top or right or bottom:
            return super().render_lines(crop)
        width, filters = left + self.size.width, tuple(self.get_line_filters())
        if self._background is None or self._edge is None or filters != self._filters:
            self._background, self._filters = self.background_colors[1], filters
            self._edge = self._left_edge(left, width)
            self._finished = {}
        strips = [self._finish(y, self.render_line(y)) for y in crop.line_range]
        x1, x2 = crop.column_span
        return strips if (x1, x2) == (0, width) else [strip.crop(x1, x2) for strip in strips]

    def _left_edge(self, left: int, width: int) -> Strip:
        """Return the left border, which is the same in each row."""
        if not left:
            return Strip([])
        (first,) = super().render_lines(Region(0, 0, width, 1))
        return first.crop(0, left)

    def _finish(self, y: int, strip: Strip) -> Strip:
        """Return a strip with its border, filtered.

        Creating strips is slow in Textual, so create only one.
        """
        inner, finished = self._finished.get(y, (None, strip))
        if inner is not strip and self._edge is not None and self._background is not None:
            segments = [*self._edge, *strip]
            for line_filter in self._filters:
                segments = line_filter.apply(segments, self._background)
            finished = Strip(segments, self._edge.cell_length + strip.cell_length)
            self._finished[y] = strip, finished
        return finished


class StillWidget(Widget):
    """A widget whose strips change only with its style, its size and the colours of the terminal.

    List it after the container in the bases of a class: Textual uses the style sheets of the first
    one.
    """

    _kept: tuple[tuple[object, ...], list[Strip]] | None = None

    def notify_style_update(self) -> None:
        """Draw again with a new style."""
        super().notify_style_update()
        self._kept = None

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return the strips of a region."""
        key = (crop, self.size, *self.get_line_filters())
        if self._kept is None or self._kept[0] != key:
            self._kept = key, super().render_lines(crop)
        return self._kept[1]


class StillContainer(Container, StillWidget):
    """A container."""


class StillGrid(Grid, StillWidget):
    """A grid."""


class StillRow(Horizontal, StillWidget):
    """A container with a horizontal layout."""


class StillColumn(Vertical, StillWidget):
    """A container with a vertical layout."""
