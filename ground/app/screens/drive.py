"""Drive: the map, the numbers beside it, what happened, and a goal by cursor, line or hand."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Final

from textual import events
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical

from ground.app.input.key_table import Layer
from ground.app.input.map_cursor import MapCursor
from ground.app.input.teleop_keys import TeleopKeys
from ground.app.panels.log import latest_rows
from ground.app.panels.mission import draft_rows, mission_rows
from ground.app.panels.side import side_rows
from ground.app.panels.streams import stream_rows
from ground.app.panels.why import now_rows, turn_rows
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.map import MapWidget
from ground.app.widgets.rows import faint, row
from ground.app.widgets.sparklines import spark_rows
from ground.explain import Why
from ground.map import LAYERS, Target
from runtime.errors import UserError

if TYPE_CHECKING:
    from ground.ghost.ghost_thread import GhostRunner

ZOOM: Final = 1.25
HINT: Final = "60 columns and 18 rows show the map"


class DriveScreen(AppScreen):
    key_layer = Layer.DRIVE
    focus_first: ClassVar[str] = "#map"

    back = 0

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self.why = Why()
        self.teleop = TeleopKeys(interface)
        self.map_cursor = MapCursor(
            lambda: self.map.view, self.robot_place, interface.perform, self.tell
        )
        self._ghost_runner: GhostRunner | None = None
        self._station = interface.station

    def compose_content(self) -> ComposeResult:
        with Horizontal(id="upper"):
            yield MapWidget(ascii_only=self.interface.ascii_only, id="map")
            with Vertical(id="second"):
                yield Lines(id="side")
                yield Lines(id="why")
            with Vertical(id="third"):
                yield Lines(id="sparks")
                yield Lines(id="mission")
                yield Lines(id="streams")
                yield MapWidget(ascii_only=self.interface.ascii_only, id="inset")
        yield Lines(id="hint")
        with Vertical(id="lower"):
            yield Lines(id="log")
            yield Lines(id="why-below")

    def on_mount(self) -> None:
        self.map.can_focus = True
        self.lines("hint").show([row(faint(HINT))])
        super().on_mount()

    def on_unmount(self) -> None:
        if self._ghost_runner is not None:
            self._ghost_runner.clear()

    @property
    def map(self) -> MapWidget:
        return self.query_one("#map", MapWidget)

    def draw(self) -> None:
        for one in self.query(MapWidget):
            one.paint(self.app.theme)
        self.follow_station()
        if self._ghost_runner is not None:
            self._ghost_runner.poll()
        station = self.interface.station
        side, log = self.lines("side"), self.lines("log")
        side.show(side_rows(station, side.size.height, side.size.width))
        log.show(latest_rows(station.log, log.size.height, log.size.width))
        self.draw_why()
        if self.map.size:
            self.draw_maps()
        if self.query_one("#third").display:
            self.draw_third()

    def draw_maps(self) -> None:
        ghosts = () if self._ghost_runner is None else self._ghost_runner.trails()
        scene = replace(self.interface.station.scene(), ghosts=ghosts, draft=self.draft())
        self.map.show(replace(scene, cursor=self.map_cursor.place))
        inset = self.query_one("#inset", MapWidget)
        if inset.size:
            inset.show(scene)

    def draft(self) -> tuple[Target, ...]:
        """The mission that is being made, until it is what the robot has."""
        draft_items = self.interface.draft_items
        return () if draft_items == self.interface.station.mission_items else draft_items

    def draw_why(self) -> None:
        """Where there is room the decision of now, and on demand the last one that changed it."""
        station = self.interface.station
        self.why.look(station)
        now, below = self.lines("why"), self.lines("why-below")
        if now.size:
            now.show(now_rows(station.moment(), now.size.width))
        if below.size:
            below.show(turn_rows(self.why, self.back, station, below.size.width))

    def draw_third(self) -> None:
        station = self.interface.station
        sparks = self.lines("sparks")
        sparks.show(spark_rows(station, max(24, sparks.size.width - 1)))
        mission = [*mission_rows(station), *draft_rows(len(self.draft()))]
        self.lines("mission").show(mission)
        panel = self.lines("mission")
        panel.display, panel.styles.height = bool(mission), max(1, len(mission))
        self.lines("streams").show(stream_rows(station))

    def follow_station(self) -> None:
        """What was learned from another station is not true of this one."""
        if self._station is not self.interface.station:
            self._station = self.interface.station
            self.why = Why()

    def key_layers(self) -> tuple[Layer, ...]:
        if self.teleop.held:
            return (Layer.STOP, Layer.TELEOP)
        above = super().key_layers()
        return above if self.map_cursor.cursor is None or self.typing else (Layer.CURSOR, *above)

    def actions(self) -> Mapping[str, Action]:
        return {
            **super().actions(),
            **self.map_cursor.actions(),
            "zoom-in": partial(self.map.zoom, ZOOM),
            "zoom-out": partial(self.map.zoom, 1 / ZOOM),
            "fit": self.map.fit,
            "centre": self.centre,
            "follow": self.follow,
            "layers": self.choose_layer,
            **self.teleop.actions(),
            "teleop": self.begin_teleop,
            "explain": self.explain,
            "explain-before": partial(self.look_back, 1),
            "ghost": self.choose_ghost,
        }

    def explain(self) -> None:
        """Why did it turn? The last time it did."""
        self.back = 0
        self.toggle_class("-explaining")

    def look_back(self, step: int) -> None:
        self.back = min(self.back + step, max(0, len(self.why.points) - 1))
        self.add_class("-explaining")

    # Ghosts.

    @property
    def ghost_runner(self) -> "GhostRunner":
        """The ghosts on this map; begun when the first is wanted."""
        if self._ghost_runner is None:
            from ground.ghost.ghost_thread import GhostRunner  # with its recordings, and trials

            self._ghost_runner = GhostRunner(lambda: self.interface.station)
        return self._ghost_runner

    def choose_ghost(self) -> None:
        from ground.ghost.ghost_thread import CHOICES  # seldom needed, so not at the start

        self.interface.choose("a ghost from here on", list(CHOICES), self.try_ghost)

    def try_ghost(self, navigator: str) -> None:
        try:
            self.start_ghost(navigator)
        except UserError as error:
            self.interface.note(f"no ghost: {error}")

    def start_ghost(self, navigator: str) -> None:
        """Another navigator from this instant on; UserError when it cannot be."""
        self.ghost_runner.begin(navigator)

    # By hand.

    def begin_teleop(self) -> None:
        """From now on keys drive, and any key that does not ends it."""
        if self.teleop.take():
            self.map_cursor.hide()
            self.prompt("by hand, any other key ends it", self.interface.run_line)

    def poll(self) -> None:
        if self.teleop.held and not self.teleop.poll():
            self.prompt("", self.interface.run_line)

    def on_key(self, event: events.Key) -> None:
        if self.teleop.held:
            event.stop()
            self.teleop.drop()
            self.prompt("", self.interface.run_line)

    # The map.

    def tell(self, words: str) -> None:
        """What Enter would send, where the prompt is; a map that shows a part goes there."""
        self.prompt(words, self.interface.run_line)
        if self.map_cursor.place is not None:
            self.map.reveal(*self.map_cursor.place)

    def centre(self) -> None:
        place = self.robot_place()
        if place is not None:
            self.map.centre(*place)

    def follow(self) -> None:
        self.map.following = not self.map.following
        self.interface.note("the map follows the robot" if self.map.following else "the map stays")

    def choose_layer(self) -> None:
        shown = self.map.shown_layers
        choices = [f"{'hide' if name in shown else 'show'} {name}" for name in LAYERS]
        self.interface.choose("the map", choices, self.switch_layer)

    def switch_layer(self, choice: str) -> None:
        name = choice.split()[-1]
        self.map.shown_layers = set(self.map.shown_layers) ^ {name}

    def on_map_widget_pointed(self, event: MapWidget.Pointed) -> None:
        self.home()
        self.map_cursor.point(event.x_m, event.y_m)
        self.redraw()

    def on_map_widget_zoomed(self, event: MapWidget.Zoomed) -> None:
        self.map.zoom(event.factor, (event.x_m, event.y_m))

    def robot_place(self) -> tuple[float, float] | None:
        robot = self.map.scene.robot
        return None if robot is None else (robot.x_m, robot.y_m)
