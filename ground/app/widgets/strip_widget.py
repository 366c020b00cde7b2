"""Draw a widget from its strips, without the general way of Textual where that is possible."""

from textual.color import Color
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget


class StripWidget(Widget):
    """A widget whose `render_line` returns strips from a cache, with the background in them.

    Without padding, and with no border but a left one, they are used as they are. That takes a
    third of the time of Textual's general way. `forget_background` belongs to every change of the
    style.
    """

    _background: Color | None = None
    _edge: Strip | None = None
    _joined: dict[int, tuple[Strip, Strip]]

    def forget_background(self) -> None:
        """Compute the background and the border again at the next drawing."""
        self._background = self._edge = None

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return the strips of a region."""
        top, right, bottom, left = self.styles.gutter
        if top or right or bottom:
            return super().render_lines(crop)
        width = left + self.size.width
        strips = [self.render_line(y) for y in crop.line_range]
        if left:
            strips = self._behind_the_edge(strips, left, width)
        if self._background is None:
            self._background = self.background_colors[1]
        for line_filter in self.get_line_filters():
            strips = [strip.apply_filter(line_filter, self._background) for strip in strips]
        x1, x2 = crop.column_span
        return strips if (x1, x2) == (0, width) else [strip.crop(x1, x2) for strip in strips]

    def _behind_the_edge(self, strips: list[Strip], left: int, width: int) -> list[Strip]:
        """Return the strips with the left border, which is the same in each row."""
        if self._edge is None:
            (first,) = super().render_lines(Region(0, 0, width, 1))
            self._edge = first.crop(0, left)
            self._joined = {}
        found = []
        for y, strip in enumerate(strips):
            inner, whole = self._joined.get(y, (None, strip))
            if inner is not strip:
                whole = Strip([*self._edge, *strip], width)
                self._joined[y] = strip, whole
            found.append(whole)
        return found
