"""Show the Drive screen: map, values, log, and goals by cursor, command line or teleop.

Its layout follows the size of the screen. It explains the present decision, and earlier ones that
changed the direction.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import ceil
from textwrap import wrap
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

from textual.app import ComposeResult
from textual.containers import Grid

from ground.app.app_interface import AppInterface
from ground.app.chrome.key_bar import NextKey, cursor_keys, keys_when, unsent
from ground.app.input.keymap import Layer, Situation
from ground.app.input.map_cursor import MapCursor, MapMenu
from ground.app.input.teleop_keys import TeleopKeys
from ground.app.panels.log import latest_rows
from ground.app.panels.robot_state import SidePanel
from ground.app.screens.app_screen import Action, AppScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.map import MapWidget
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.app.widgets.strip_widget import StillColumn, StillGrid
from ground.explain import NAMES, Explanation, Why, explained
from ground.map.canvas import DOTS_HIGH, DOTS_WIDE
from ground.map.scene import LAYERS, MARGIN_DOTS, MapTarget
from ground.station.station import Station
from runtime.errors import UserError
from runtime.units import NS_PER_S

if TYPE_CHECKING:
    from ground.ghost import GhostRunner


LEAST_SIDE: Final = 34
LEAST_WIDE_SIDE: Final = 44
"""The least columns of the values, border included."""
WIDE: Final = 110
LEAST_ROWS_BESIDE: Final = 22
"""From so many columns and rows on, the log is beside the map."""
LEAST_MAP: Final = 24
LOG: Final = 4
LOG_BESIDE: Final = 7
TALL: Final = 27
TALL_LOG: Final = 10
EXPLAINED: Final = 11
"""Rows of the log, its border included; the last is with an explanation instead of the log."""

Size = tuple[float, float]


class DriveLayout(NamedTuple):
    """Columns of the map, and rows of the lower part; `beside`: the map has all rows."""

    map_columns: int
    lower_rows: int
    beside: bool


def drive_layout(
    columns: int, rows: int, floor_m: Size | None, *, explaining: bool = False
) -> DriveLayout:
    """Return the layout that leaves a map of this floor as little empty space as possible."""
    beside = columns >= WIDE and rows >= LEAST_ROWS_BESIDE
    lower = LOG_BESIDE if beside else TALL_LOG if rows >= TALL else LOG
    lower = max(lower, EXPLAINED) if explaining else lower
    map_rows = rows if beside else rows - lower
    room = columns - (LEAST_WIDE_SIDE if beside else LEAST_SIDE)
    wanted = room if floor_m is None else columns_for(floor_m, map_rows)
    return DriveLayout(max(LEAST_MAP, min(wanted, room)), lower, beside)


def columns_for(floor_m: Size, rows: int) -> int:
    """Return the columns that a map of so many rows fills with this floor, legend excluded."""
    width_m, height_m = floor_m
    if not (width_m > 0.0 and height_m > 0.0):
        return LEAST_MAP
    down = DOTS_HIGH * (rows - 1) - 2 * MARGIN_DOTS
    return ceil((max(1, down) * width_m / height_m + 2 * MARGIN_DOTS) / DOTS_WIDE)


def turn_rows(why: Why, back: int, station: Station, width: int) -> list[Row]:
    """Explain the turning point that is `back` turns ago, and show how long ago it was."""
    turned = why.at(back)
    if turned is None:
        return [row(faint("the robot has not turned yet"))]
    ago_s = (station.now_ns - turned.at_ns) / NS_PER_S
    first = row(Span(f"{ago_s:.1f} s ago: ", "accent"), Span(turned.point.words, "caution"))
    return [first, *explanation_rows(explained(turned, station), width)]


def explanation_rows(found: Explanation, width: int) -> list[Row]:
    """Wrap an explanation to a width in columns."""
    rows = [row(Span(line, "accent")) for line in wrap(found.headline, max(8, width))]
    for line in found.lines:
        name, text = line[:NAMES], line[NAMES:]
        for piece in wrap(text, max(8, width - NAMES)) or [""]:
            rows.append(row(head(name), piece))
            name = " " * NAMES
    return rows


ZOOM: Final = 1.25
TELEOP_PROMPT: Final = "TELEOP arrows or WASD drive, esc ends"
GAMEPAD_PROMPT: Final = "TELEOP arrows, WASD or the left stick with L1 held drive, esc ends"
HINT: Final = "the map needs 60 columns and 18 rows"


class DriveScreen(AppScreen):
    """The map with the values beside it and the log below it."""

    key_layer = Layer.DRIVE
    focus_first: ClassVar[str] = "#map"
    commands_robot: ClassVar[bool] = True

    back = 0

    def __init__(self, interface: AppInterface) -> None:
        super().__init__(interface)
        self.why = Why()
        self._side = SidePanel()
        self._arranged: tuple[object, ...] = ()
        self.teleop = TeleopKeys(interface)
        self.map_cursor = MapCursor(
            lambda: self.map.view, self.robot_place, interface.commands.perform, self.show_goal
        )
        self.map_menu = MapMenu(interface, self.map_cursor, lambda: self.map.scene)
        self._ghost_runner: GhostRunner | None = None
        self._station = interface.station

    def compose_content(self) -> ComposeResult:
        """Compose the map, the values and the log; `share_space` decides where they are."""
        with StillGrid(id="drive"):
            yield MapWidget(ascii_only=self.interface.ascii_only, id="map")
            yield Lines(id="side")
            with StillColumn(id="lower"):
                yield Lines(id="log")
                yield Lines(id="why-below")
        yield Lines(id="hint")

    def on_mount(self) -> None:
        """Let the map take the focus, and show the hint for small terminals."""
        self.map.can_focus = True
        self.lines("hint").show([row(faint(HINT))])
        super().on_mount()

    def on_unmount(self) -> None:
        """End the ghosts."""
        if self._ghost_runner is not None:
            self._ghost_runner.clear()

    @property
    def map(self) -> MapWidget:
        """The large map."""
        return self.query_one("#map", MapWidget)

    def draw(self) -> None:
        """Draw the map and the panels."""
        self.map.paint(self.app.theme)
        self.follow_station()
        if self._ghost_runner is not None:
            self._ghost_runner.poll()
        self.share_space()
        self.draw_side()
        self.draw_log()
        if self.map.size:
            self.draw_map()

    def share_space(self) -> None:
        """Share the screen between map, values and log, for this size and this world."""
        grid, world = self.query_one("#drive", Grid), self.interface.station.world
        is_hidden = self.has_class("-low") or self.has_class("-tiny")
        explaining = self.has_class("-explaining")
        floor_m = None if world is None else world.size_m
        layout = drive_layout(*grid.size, floor_m, explaining=explaining)
        side = 0
        if layout.beside:
            limit = grid.size.height - layout.lower_rows
            side = self._side.fitting(self.interface.station, limit, len(self.draft()))
        wanted = (layout, is_hidden, side)
        if wanted == self._arranged or not grid.size:
            return
        self._arranged = wanted
        grid.set_class(layout.beside and not is_hidden, "-beside")
        grid.set_class(is_hidden, "-mapless")
        grid.styles.grid_columns = "1fr" if is_hidden else f"{layout.map_columns} 1fr"
        rows = f"{side} 1fr" if layout.beside else f"1fr {layout.lower_rows}"
        grid.styles.grid_rows = rows
        self.call_after_refresh(self.redraw)  # the panels have their new sizes then

    def draw_side(self) -> None:
        """Draw the values."""
        side, recording = self.lines("side"), self.interface.session_info.recording
        size, drafts = side.size, len(self.draft())
        station = self.interface.station
        side.show(
            self._side.rows(station, size.height, size.width, recording=recording, draft=drafts)
        )

    def draw_map(self) -> None:
        """Draw the scene."""
        ghosts = () if self._ghost_runner is None else self._ghost_runner.trails()
        scene = replace(self.interface.station.scene(), ghosts=ghosts, draft=self.draft())
        self.map.show(replace(scene, cursor=self.map_cursor.place))

    def draft(self) -> tuple[MapTarget, ...]:
        """Return the mission draft, until the robot has it."""
        return unsent(self.interface.commands.draft_items, self.interface.station)

    def draw_log(self) -> None:
        """Draw the log, or the explanation of the last turn in its place."""
        station = self.interface.station
        self.why.look(station)
        log, below = self.lines("log"), self.lines("why-below")
        if log.size:
            log.show(latest_rows(station.log, log.size.height, log.size.width))
        if below.size:
            below.show(turn_rows(self.why, self.back, station, below.size.width))

    def follow_station(self) -> None:
        """Forget explanations when the station has been replaced."""
        if self._station is not self.interface.station:
            self._station = self.interface.station
            self.why = Why()

    def key_layers(self) -> tuple[Layer, ...]:
        """Return the layers of keys that are active now."""
        if self.teleop.held:
            return (Layer.STOP, Layer.TELEOP)
        above = super().key_layers()
        return above if self.map_cursor.cursor is None or self.typing else (Layer.CURSOR, *above)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        return {
            **super().actions(),
            **self.map_cursor.actions(),
            "map-menu": self.map_menu.open,
            "zoom-in": partial(self.map.zoom, ZOOM),
            "zoom-out": partial(self.map.zoom, 1 / ZOOM),
            "fit": self.map.fit,
            "centre": self.centre,
            "follow": self.follow,
            "layers": self.choose_layer,
            **self.teleop.actions(),
            "teleop-end": self.end_teleop,
            "teleop": self.begin_teleop,
            "explain": self.explain,
            "explain-before": partial(self.look_back, 1),
            "ghost": self.choose_ghost,
        }

    def following_keys(self) -> tuple[NextKey, ...]:
        """Return those of teleop or of the cursor while they are in use."""
        if self.teleop.held:
            return keys_when(Situation.TELEOP)
        if self.map_cursor.cursor is None:
            return super().following_keys()
        return cursor_keys(self.interface.station, self.interface.commands.draft_items)

    def close_what_is_open(self) -> None:
        """Close the explanation."""
        self.remove_class("-explaining")

    def explain(self) -> None:
        """Show or hide the explanation of the last turn."""
        self.back = 0
        self.toggle_class("-explaining")

    def look_back(self, step: int) -> None:
        """Explain an earlier turn."""
        self.back = min(self.back + step, max(0, len(self.why.points) - 1))
        self.add_class("-explaining")

    # Ghosts.

    @property
    def ghost_runner(self) -> "GhostRunner":
        """The runner of ghosts, created when it is first needed."""
        if self._ghost_runner is None:
            from ground.ghost import GhostRunner  # imports recordings and trials

            self._ghost_runner = GhostRunner(lambda: self.interface.station)
        return self._ghost_runner

    def choose_ghost(self) -> None:
        """Let the operator choose a navigator to simulate."""
        from ground.ghost import CHOICES  # rarely needed, so imported late

        self.interface.choose("navigator to simulate", list(CHOICES), self.try_ghost)

    def try_ghost(self, navigator: str) -> None:
        """Start a ghost; an error goes to the log."""
        try:
            self.start_ghost(navigator)
        except UserError as error:
            self.interface.note(f"no ghost: {error}")

    def start_ghost(self, navigator: str) -> None:
        """Simulate another navigator from now on. Raise UserError when that is not possible."""
        self.ghost_runner.begin(navigator)

    # Teleop.

    def begin_teleop(self) -> None:
        """Start teleop by keys; any other key ends it."""
        if self.teleop.take():
            self.map_cursor.hide()
            words = GAMEPAD_PROMPT if self.teleop.has_gamepad else TELEOP_PROMPT
            self.prompt(words, self.interface.commands.run_line)

    def poll(self) -> None:
        """Send the teleop command."""
        if self.teleop.held and not self.teleop.poll():
            self.prompt("", self.interface.commands.run_line)

    def take_key(self, key: str) -> bool:
        """End teleop at any other key."""
        held = self.teleop.held
        if held:
            self.end_teleop()
        return held

    def end_teleop(self) -> None:
        """Stop the robot and end teleop."""
        self.teleop.drop()
        self.prompt("", self.interface.commands.run_line)

    # The map.

    def show_goal(self, words: str) -> None:
        """Show the command that Enter would send; move a zoomed map to the cursor."""
        self.prompt(words, self.interface.commands.run_line)
        if self.map_cursor.place is not None:
            self.map.reveal(*self.map_cursor.place)

    def centre(self) -> None:
        """Centre the map on the robot."""
        place = self.robot_place()
        if place is not None:
            self.map.centre(*place)

    def follow(self) -> None:
        """Follow the robot, or stop following."""
        self.map.following = not self.map.following
        self.interface.note("the map follows the robot" if self.map.following else "the map stays")

    def choose_layer(self) -> None:
        """Let the operator choose a layer to show or hide."""
        shown = self.map.shown_layers
        choices = [f"{'hide' if name in shown else 'show'} {name}" for name in LAYERS]
        self.interface.choose("layers of the map", choices, self.switch_layer)

    def switch_layer(self, choice: str) -> None:
        """Show or hide the layer that ends the choice."""
        name = choice.split()[-1]
        self.map.shown_layers = set(self.map.shown_layers) ^ {name}

    def on_map_widget_pointed(self, event: MapWidget.Pointed) -> None:
        """Place the cursor where the map was clicked."""
        self.home()
        self.map_cursor.point(event.x_m, event.y_m)
        self.redraw()

    def on_map_widget_menu_requested(self, event: MapWidget.MenuRequested) -> None:
        """Place the cursor, and open the menu there."""
        self.on_map_widget_pointed(event)
        self.map_menu.open()

    def on_map_widget_zoomed(self, event: MapWidget.Zoomed) -> None:
        """Zoom about the mouse."""
        self.map.zoom(event.factor, (event.x_m, event.y_m))

    def robot_place(self) -> tuple[float, float] | None:
        """Return the position of the robot in metres, if known."""
        robot = self.map.scene.robot
        return None if robot is None else (robot.x_m, robot.y_m)
