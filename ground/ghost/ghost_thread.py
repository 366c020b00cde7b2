"""Run ghosts from the present instant of a station and report them in its log."""

from collections.abc import Callable
from typing import Final

from ground.client.goal import Destination
from ground.client.vocabulary import NAVIGATORS
from ground.ghost.branch_point import BranchPoint, driving
from ground.ghost.ghost import Ghost
from ground.ghost.ghost_set import Ghosts
from ground.ghost.predicted_path import FAILED, PredictedPath
from ground.ghost.recorded_ghost import changed, goal_of, side_of
from ground.map.scene import GhostTrail
from ground.station.station import Station
from protocol.outcome import detail_of
from protocol.topics import ODOMETRY, STATUS, TRUTH
from protocol.wire.enums import GoalState, Severity
from protocol.wire.messages import GroundTruth, PlanarOdometry
from runtime.errors import UserError
from runtime.units import NS_PER_S

ALL: Final = "all"
NONE: Final = "none"
CHOICES: Final = (*NAVIGATORS, ALL, NONE)
NO_WORLD: Final = "the world is unknown: a ghost needs a simulation, or a recording with its world"


class GhostRunner:
    """Starts ghosts on request, polls them with the station, and returns their paths."""

    def __init__(self, shown: Callable[[], Station], ghosts: Ghosts | None = None) -> None:
        """Create a runner; `shown` returns the present station."""
        self._shown = shown
        self._ghosts = ghosts or Ghosts()
        self._world = ""

    def begin(self, choice: str) -> None:
        """Start a navigator or `all` of them, or remove the ghosts with `none`. Raises UserError.

        A ghost replaces an earlier one of the same navigator.
        """
        if choice == NONE:
            self.clear()
            return
        if choice not in CHOICES:
            raise UserError(f"no navigator {choice!r}: {', '.join(CHOICES)}")
        station = self._shown()
        instant, status = instant_of(station), station.telemetry.live(STATUS, station.now_ns)
        side = None if status is None else side_of(status)
        parameters = driving(changed(station.parameters or ()))
        self._world = world_of(station)
        for name in NAVIGATORS if choice == ALL else (choice,):
            self._ghosts.add(name, Ghost(*instant, name, parameters, side=side))

    def poll(self) -> None:
        """Report the ghosts that have ended; remove all of them in another world."""
        station = self._shown()
        if self._world and world_of(station) not in ("", self._world):
            self.clear()
        for name in self._ghosts.poll():
            course = self._ghosts.courses[name]
            if course is not None:
                severity = Severity.WARNING if course.outcome == FAILED else Severity.INFO
                station.note(f"ghost {name}: {result_line(course)}", severity)

    @property
    def busy(self) -> bool:
        """True if a ghost waits or runs."""
        return self._ghosts.busy

    def trails(self) -> list[GhostTrail]:
        """Return the paths for `Scene.ghosts`."""
        return self._ghosts.trails()

    def clear(self) -> None:
        """End all ghosts and forget their paths."""
        self._ghosts.clear()
        self._world = ""


def instant_of(station: Station) -> BranchPoint:
    """Return the present pose of the shown robot, the true one if known; UserError if data lack."""
    world, telemetry, now_ns = station.world, station.telemetry, station.now_ns
    status = telemetry.live(STATUS, now_ns)
    place: GroundTruth | PlanarOdometry | None = telemetry.live(TRUTH, now_ns)
    at_s = 0.0 if place is None else place.time_ns / NS_PER_S
    place = place or telemetry.live(ODOMETRY, now_ns)
    if world is None:
        raise UserError(NO_WORLD)
    if status is None or place is None:
        raise UserError("the robot sends no data now")
    if status.goal == GoalState.NONE:
        raise UserError("the robot has no goal at this instant")
    goal: Destination = goal_of(status)
    return BranchPoint(world.text, (place.x_m, place.y_m, place.heading_rad), at_s, goal)


def world_of(station: Station) -> str:
    """Return the identity of a world; empty while none is known."""
    return "" if station.world is None else station.world.text


def result_line(course: PredictedPath) -> str:
    """Describe the result in one line."""
    words = course.outcome
    if course.time_s is not None and course.length_m is not None:
        words += f" after {course.time_s:.1f} s and {course.length_m:.2f} m"
    if course.reason in ("ok", ""):
        return words
    return f"{words}: {detail_of(course.outcome, course.reason)}"
