"""Draw a widget from its strips, without the general way of Textual where that is possible."""

from textual.color import Color
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget


class StripWidget(Widget):
    """A widget whose `render_line` returns strips from a cache, with the background in them.

    Without border and padding they are used as they are. That takes a third of the time of
    Textual's general way. `forget_background` belongs to every change of the style.
    """

    _background: Color | None = None

    def forget_background(self) -> None:
        """Compute the background again at the next drawing."""
        self._background = None

    def render_lines(self, crop: Region) -> list[Strip]:
        """Return the strips of a region."""
        if any(self.styles.gutter):
            return super().render_lines(crop)
        width = self.size.width
        strips = [self.render_line(y) for y in crop.line_range]
        if self._background is None:
            self._background = self.background_colors[1]
        for line_filter in self.get_line_filters():
            strips = [strip.apply_filter(line_filter, self._background) for strip in strips]
        x1, x2 = crop.column_span
        return strips if (x1, x2) == (0, width) else [strip.crop(x1, x2) for strip in strips]
