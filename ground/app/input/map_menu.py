"""Offer what can be done at a place of the map: by a right click, or by a key at the cursor."""

from collections.abc import Callable
from typing import Final

from ground.app.input.map_cursor import MapCursor
from ground.app.playback.app_interface import AppInterface
from ground.app.screens.choice import Choice
from ground.map.drawing import described, measured
from ground.map.scene import MapScene
from ground.map.view import Point

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
