"""Cache the strips of containers, which draw only background and border.

Textual draws each container below a changed widget, although the children cover it.
"""

from textual.containers import Container, Grid, Horizontal, Vertical
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget


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
