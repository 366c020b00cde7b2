"""Move and turn the goal cursor on the map, and offer what can be done at its place."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import floor, log10
from typing import Final

from ground.app.app_interface import AppInterface
from ground.app.screens.choice import Choice
from ground.client.goal import Destination, destination
from ground.commands.goto import Goto
from ground.console.app_commands import AddWaypoint
from ground.map.canvas import DOTS_WIDE
from ground.map.drawing import described, measured
from ground.map.scene import MapScene, Point, View
from ground.missions.files import waypoint_at

WAYS: Final = {"up": (0, 1), "down": (0, -1), "left": (-1, 0), "right": (1, 0)}

TURN_DEG: Final = 15.0
FAR: Final = 10.0
STEPS: Final = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Cursor:
    """A position in metres and a heading in degrees; a heading of None accepts any."""

    x_m: float
    y_m: float
    heading_deg: float | None = None

    def moved(self, right: float, up: float, step_m: float) -> "Cursor":
        """Return the cursor moved by steps, onto the grid of the steps."""
        x_m = round(self.x_m / step_m + right) * step_m
        y_m = round(self.y_m / step_m + up) * step_m
        return replace(self, x_m=round(x_m, 6), y_m=round(y_m, 6))

    def turned(self, times: int) -> "Cursor":
        """Return the cursor turned counter-clockwise; the first turn only sets a heading."""
        start_deg = 0.0 if self.heading_deg is None else self.heading_deg + times * TURN_DEG
        return replace(self, heading_deg=(start_deg + 180.0) % 360.0 - 180.0)

    def goal(self) -> Destination:
        """Return the destination. Raise UserError when it is not valid."""
        heading = [] if self.heading_deg is None else [self.heading_deg]
        return destination([self.x_m, self.y_m, *heading])

    def words(self) -> str:
        """Return the cursor as words of a command line."""
        place = f"{self.x_m:zg} {self.y_m:zg}"
        return place if self.heading_deg is None else f"{place} {self.heading_deg:zg}"


def step_of(m_per_cell: float) -> float:
    """Return the least of 1, 2 and 5 times a power of ten, in metres, that moves a cell."""
    power = 10.0 ** floor(log10(max(m_per_cell, 1e-3)))
    return next(step * power for step in STEPS if step * power >= m_per_cell * 0.999)


class MapCursor:
    """Handles the cursor's keys.

    `show_goal` gets the command that Enter would send, or ""; `perform` sends it.
    """

    def __init__(
        self,
        view: Callable[[], View],
        robot: Callable[[], tuple[float, float] | None],
        perform: Callable[[Goto | AddWaypoint], None],
        show_goal: Callable[[str], None],
    ) -> None:
        self._view, self._robot, self._perform = view, robot, perform
        self._show_goal = show_goal
        self.cursor: Cursor | None = None

    @property
    def place(self) -> tuple[float, float] | None:
        """The position of the cursor in metres, if there is one."""
        return None if self.cursor is None else (self.cursor.x_m, self.cursor.y_m)

    @property
    def step_m(self) -> float:
        """The length of a step in metres."""
        return step_of(self._view().m_per_dot * DOTS_WIDE)

    def actions(self) -> Mapping[str, Callable[[], None]]:
        """Return the actions of the cursor by id."""
        moves = {
            f"cursor-{way}{far}": partial(self.move, *by, times)
            for way, by in WAYS.items()
            for far, times in (("", 1.0), ("-far", FAR))
        }
        return {
            **moves,
            "cursor": self.show,
            "cursor-turn-left": partial(self.turn, 1),
            "cursor-turn-right": partial(self.turn, -1),
            "cursor-heading-free": self.free,
            "goal-at-cursor": self.send,
            "waypoint": self.waypoint,
            "leave-cursor": self.hide,
        }

    def show(self) -> None:
        """Place the cursor at the robot, or in the middle of the map."""
        view = self._view()
        self.point(*(self._robot() or (view.centre_x_m, view.centre_y_m)))

    def point(self, x_m: float, y_m: float) -> None:
        """Place the cursor at a position, on the grid of its steps."""
        self._set(Cursor(x_m, y_m).moved(0, 0, self.step_m))

    def hide(self) -> None:
        """Remove the cursor."""
        self._set(None)

    def move(self, right: int, up: int, times: float) -> None:
        """Move the cursor by steps."""
        if self.cursor is not None:
            self._set(self.cursor.moved(right * times, up * times, self.step_m))

    def turn(self, times: int) -> None:
        """Turn the cursor counter-clockwise by steps."""
        if self.cursor is not None:
            self._set(self.cursor.turned(times))

    def free(self) -> None:
        """Accept any heading."""
        if self.cursor is not None:
            self._set(replace(self.cursor, heading_deg=None))

    def send(self) -> None:
        """Drive to the cursor."""
        if self.cursor is not None:
            self._perform(Goto(goal=self.cursor.goal()))
            self.hide()

    def waypoint(self) -> None:
        """Add a waypoint at the cursor to the draft; the next one begins without a heading."""
        if self.cursor is not None:
            at = self.cursor
            self._perform(AddWaypoint(waypoint=waypoint_at(at.x_m, at.y_m, at.heading_deg, 0.0)))
            self.free()

    def _set(self, cursor: Cursor | None) -> None:
        self.cursor = cursor
        self._show_goal("" if cursor is None else f"goal {cursor.words()}")


GO: Final = "go here"
WAYPOINT: Final = "add waypoint"
FROM_ROBOT: Final = "measure from the robot"
FROM_HERE: Final = "measure from here"
TO_HERE: Final = "measure to here"
LOOK: Final = "look"


class MapMenu:
    """The menu of the cursor's place; it keeps the start of a measurement."""

    def __init__(
        self, interface: AppInterface, cursor: MapCursor, scene: Callable[[], MapScene]
    ) -> None:
        self._interface, self._cursor, self._scene = interface, cursor, scene
        self._start: Point | None = None

    def open(self) -> None:
        """Show the menu, if there is a cursor."""
        place = self._cursor.place
        if place is None:
            return
        choices = [
            Choice(GO, "drive to this place"),
            Choice(WAYPOINT, "append it to the mission draft"),
            Choice(FROM_ROBOT, "distance and heading"),
            Choice(FROM_HERE, "begin a measurement"),
            *([] if self._start is None else [Choice(TO_HERE, "end the measurement")]),
            Choice(LOOK, "say what is there: obstacle, echo, trail"),
        ]
        self._interface.choose(f"at {place[0]:g} {place[1]:g}", choices, self.take)

    def take(self, choice: str) -> None:
        """Do what was chosen."""
        place, scene = self._cursor.place, self._scene()
        if place is None:
            return
        if choice == GO:
            self._cursor.send()
        elif choice == WAYPOINT:
            self._cursor.waypoint()
        elif choice == FROM_HERE:
            self._start = place
            self._interface.note("measure: move the cursor, then m and `measure to here`")
        elif choice == TO_HERE and self._start is not None:
            self._interface.note(f"{measured(self._start, place)} between both places")
            self._start = None
        elif choice == FROM_ROBOT:
            self.measure_from_robot(place, scene)
        else:
            self._interface.note(described(scene, place, self._cursor.step_m * 2))

    def measure_from_robot(self, place: Point, scene: MapScene) -> None:
        """Note distance and heading from the robot."""
        if scene.robot is None:
            self._interface.note("the place of the robot is unknown")
            return
        robot = (scene.robot.x_m, scene.robot.y_m)
        self._interface.note(f"{measured(robot, place)} from the robot")
