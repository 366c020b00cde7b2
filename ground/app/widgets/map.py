"""Show the map as a widget; only rows that have changed are repainted."""

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip

from ground.app.widgets.role_colours import styles_of
from ground.app.widgets.strip_widget import StripWidget
from ground.map.canvas import ROLES, Canvas
from ground.map.drawing import KeptLayers, draw_moving
from ground.map.scene import LAYERS, MapScene, Point, View

WHEEL_FACTOR = 1.25
RIGHT = 3
BLANK = ""
MONO = "mono"


class MapWidget(StripWidget):
    """Draws the last scene shown; `styles_by_role` are the styles of what is drawn.

    While `fitted`, all of the scene is on the map; zooming and centring end that. While
    `following`, the robot is kept away from the edge. The app handles the keys.
    """

    class Pointed(Message):
        """A click at a position in metres."""

        def __init__(self, x_m: float, y_m: float) -> None:
            super().__init__()
            self.x_m, self.y_m = x_m, y_m

    class MenuRequested(Pointed):
        """A right click at a position in metres."""

    class Zoomed(Message):
        """A turn of the wheel above a position in metres; the app decides what to do."""

        def __init__(self, factor: float, x_m: float, y_m: float) -> None:
            super().__init__()
            self.factor, self.x_m, self.y_m = factor, x_m, y_m

    def __init__(
        self,
        styles_by_role: Mapping[str, Style] | None = None,
        ascii_only: bool = False,
        id: str | None = None,
    ) -> None:
        super().__init__(id=id)
        self.scene = MapScene()
        self._canvas = Canvas(0, 0, ascii_only)
        self._layers = KeptLayers()
        self._theme = ""
        self._fitted_for: tuple[object, ...] = ()
        self._strips: dict[int, Strip] = {}
        self._view = View(0, 0)
        self._shown: Collection[str] = LAYERS
        self._ascii_only, self._fitted, self._following = ascii_only, True, False
        self._styles_by_role = styles_by_role or {}
        self._inks: tuple[dict[str, Style], dict[str, Style]] | None = None

    @property
    def view(self) -> View:
        """The view; setting it ends `fitted`."""
        return self._view

    @view.setter
    def view(self, view: View) -> None:
        self._view, self._fitted = view.resized(*self.size), False
        self._draw()

    @property
    def fitted(self) -> bool:
        """True while all of the scene is kept on the map."""
        return self._fitted

    @property
    def following(self) -> bool:
        """True while the map follows the robot."""
        return self._following

    @following.setter
    def following(self, following: bool) -> None:
        self._following = following
        self._fitted = self._fitted and not following
        self._draw()

    @property
    def shown_layers(self) -> Collection[str]:
        """The names of the layers that are drawn (see `ground.map.LAYERS`)."""
        return self._shown

    @shown_layers.setter
    def shown_layers(self, layers: Collection[str]) -> None:
        self._shown = frozenset(layers)
        self._draw()

    def paint(self, theme: str) -> None:
        """Use the colours of a theme on the widget's background."""
        if theme != self._theme:
            self._theme = theme
            self.colour(styles_of(theme))

    def colour(self, styles_by_role: Mapping[str, Style]) -> None:
        """Use these styles."""
        self._styles_by_role = styles_by_role
        self._restyle()

    def notify_style_update(self) -> None:
        """Draw again: Textual applies the style sheet of a new theme some time after the switch."""
        super().notify_style_update()
        self._restyle()

    def _restyle(self) -> None:
        """Read the background again at the next drawing."""
        self._inks = None
        self.forget_background()
        self._strips.clear()
        self.refresh()

    def show(self, scene: MapScene) -> None:
        """Draw a scene from now on; an equal scene costs nothing."""
        if scene == self.scene:
            return
        went_stale = scene.live != self.scene.live
        self.scene = scene
        self._draw()
        if went_stale:
            self._strips.clear()
            self.refresh()

    def fit(self) -> None:
        """Keep all of the scene on the map."""
        self._fitted, self._following, self._fitted_for = True, False, ()
        self._draw()

    def zoom(self, factor: float, about: Point | None = None) -> None:
        """Zoom by a factor about a position, or about the centre."""
        self.view = self._view.zoomed(factor, about)

    def centre(self, x_m: float, y_m: float) -> None:
        """Centre the map on a position."""
        self.view = self._view.centred(x_m, y_m)

    def reveal(self, x_m: float, y_m: float) -> None:
        """Move to a position near or beyond the edge, unless the map is fitted or following."""
        if not (self._fitted or self._following):
            self.view = self._view.following(x_m, y_m)

    def render_line(self, y: int) -> Strip:
        """Return one strip, drawn if it has changed."""
        strip = self._strips.get(y)
        if strip is None:
            self._strips[y] = strip = self._strip(y)
        return strip

    def on_resize(self, event: events.Resize) -> None:
        """Draw in the new size."""
        self._view = self._view.resized(*self.size)
        self._draw()

    def on_click(self, event: events.Click) -> None:
        """Send the position of a click; a right click asks for the menu."""
        message = self.MenuRequested if event.button == RIGHT else self.Pointed
        self.post_message(message(*self._view.middle_of(event.x, event.y)))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        """Send a request to zoom in."""
        self._wheel(event, WHEEL_FACTOR)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        """Send a request to zoom out."""
        self._wheel(event, 1.0 / WHEEL_FACTOR)

    def _wheel(self, event: events.MouseEvent, factor: float) -> None:
        event.stop()
        self.post_message(self.Zoomed(factor, *self._view.middle_of(event.x, event.y)))

    def _strip(self, row: int) -> Strip:
        if self._inks is None:
            ground = self.rich_style if self._theme else Style.null()
            self._inks = inks(ground, self._styles_by_role)
        ink = self._inks[not self.scene.live]
        runs = self._canvas.strip(row)
        return Strip([Segment(text, ink[role]) for role, text in runs], self._canvas.columns)

    def _adjust_view(self) -> None:
        """Move the view to where this scene needs it."""
        robot = self.scene.robot
        if self._fitted:
            self._view = self._whole()
        elif self._following and robot is not None:
            self._view = self._view.following(robot.x_m, robot.y_m)

    def _whole(self) -> View:
        """Return the view of the whole scene; the present view while it shows everything."""
        scene, box = self.scene, self.scene.box()
        fitted_for = (self.size, scene.size_m, box is None)
        if fitted_for == self._fitted_for and (box is None or self._view.shows(box)):
            return self._view
        self._fitted_for = fitted_for
        return View.fit(box, *self.size, bounded=scene.size_m is not None)

    def _draw(self) -> None:
        self._adjust_view()
        before, scene, view = self._canvas, self.scene, self._view
        is_mono = self._theme == MONO
        blank = Canvas(view.columns, view.rows, self._ascii_only, is_mono=is_mono)
        self._canvas = self._layers.below(scene, view, self._shown, blank)
        draw_moving(scene, view, self._canvas, self._shown)
        self._repaint(before)

    def _repaint(self, before: Canvas) -> None:
        canvas = self._canvas
        if before.columns != canvas.columns or before.rows != canvas.rows:
            self._strips.clear()
            self.refresh()
            return
        rows = canvas.changed_rows(before)
        for row in rows:
            self._strips.pop(row, None)
        if rows:
            self.refresh(*bands(rows, canvas.columns))


def inks(
    ground: Style, styles_by_role: Mapping[str, Style]
) -> tuple[dict[str, Style], dict[str, Style]]:
    """Return a style for each role, normal and dim. Never None, which Textual cannot filter."""
    plain = {role: ground + styles_by_role.get(role, Style.null()) for role in (BLANK, *ROLES)}
    return plain, {role: style + Style(dim=True) for role, style in plain.items()}


def bands(rows: Sequence[int], columns: int) -> list[Region]:
    """Return the rows as regions, with neighbours joined.

    Textual's work grows with the number of regions.
    """
    firsts = [row for before, row in pairwise((-2, *rows)) if row != before + 1]
    lasts = [row for row, after in pairwise((*rows, rows[-1] + 2)) if after != row + 1]
    return [Region(0, a, columns, b - a + 1) for a, b in zip(firsts, lasts, strict=True)]
