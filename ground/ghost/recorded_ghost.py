"""Start ghosts from a recording, and measure the rest of the recorded drive."""

from collections.abc import Iterable
from itertools import pairwise
from math import dist, isfinite
from typing import Any, Final, NamedTuple

from ground.client.goal import Destination
from ground.client.parameter import Parameter, parameters_in
from ground.client.vocabulary import SIDES
from ground.ghost.branch_point import BranchPoint, Facts
from ground.ghost.predicted_path import Point, PredictedPath
from ground.recording.log_index import LogIndex
from protocol.outcome import ENDS
from protocol.topics import CLOCK, COMMANDED, ODOMETRY, STATUS, TRUTH
from protocol.wire.enums import GoalState
from protocol.wire.messages import (
    GoalRequest,
    GroundTruth,
    NavigatorStatus,
    PlanarOdometry,
    SystemTime,
)
from protocol.wire.reasons import reason_text
from runtime.errors import RemoteError, UserError
from runtime.files import value_in
from runtime.units import NS_PER_S, NS_PER_US

SLACK_NS: Final = 100_000_000
"""Tolerance between the recording of a request and the robot's report of its goal."""

LIVING: Final = (GoalState.ACCEPTED, GoalState.DRIVING, GoalState.AVOIDING, GoalState.ALIGNING)
SAME_M: Final = 0.002
DRIVING: Final = "driving"


class Place(NamedTuple):
    """Pose of the robot on the timeline of the recording and in the world's own time."""

    at_ns: int
    pose: tuple[float, float, float]
    world_ns: int | None

    def world_s_at(self, at_ns: int) -> float:
        """Return the world's time at an instant near this one, in s; 0 when unknown."""
        return (
            0.0 if self.world_ns is None else max(0, self.world_ns + at_ns - self.at_ns) / NS_PER_S
        )


class GhostRecording:
    """The parts of a recording that a ghost needs; true poses are preferred.

    In lockstep all stamps come from one clock and order the messages better than arrival does.
    """

    def __init__(self, log_index: LogIndex) -> None:
        begun_ns = lockstep_ns(log_index)

        def when(at_ns: int, stamp_ns: int) -> int:
            return at_ns if begun_ns is None else stamp_ns - begun_ns

        self.statuses = [
            (when(at_ns, one.time_ns), one)
            for at_ns, one in log_index.on(STATUS.path)
            if type(one) is NavigatorStatus
        ]
        truths = [
            Place(when(at_ns, one.time_ns), pose_of(one), one.time_ns)
            for at_ns, one in log_index.on(TRUTH.path)
            if type(one) is GroundTruth
        ]
        self.places = truths or [
            Place(when(at_ns, one.time_ns), pose_of(one), None)
            for at_ns, one in log_index.on(ODOMETRY.path)
            if type(one) is PlanarOdometry
        ]
        self.goals = [
            (at_ns, one) for at_ns, one in log_index.on(COMMANDED.path) if type(one) is GoalRequest
        ]
        self.facts = log_index.facts

    def beginning_ns(self) -> int:
        """Return the time of the first goal. Raises UserError when there was none."""
        first = next((pair for pair in self.statuses if pair[1].goal in LIVING), None)
        if first is None:
            raise UserError("the recording has no drive to a goal: give --at and --goal")
        return begun_ns(*first)

    def status_at(self, at_ns: int) -> NavigatorStatus:
        """Return the status in force; a new goal may be reported only in the next tick."""
        past = [one for time_ns, one in self.statuses if time_ns <= at_ns]
        if past and past[-1].goal in LIVING:
            return past[-1]
        coming = self.statuses[len(past) : len(past) + 1]
        if coming and coming[0][1].goal in LIVING and begun_ns(*coming[0]) <= at_ns:
            return coming[0][1]
        if not past:
            raise UserError(
                f"the recording has no status of the robot up to {at_ns / NS_PER_S:g} s"
            )
        return past[-1]

    def place_at(self, at_ns: int) -> Place:
        """Return the last pose up to then; before the first one, the first."""
        if not self.places:
            raise UserError("the recording has no position of the robot")
        return next((one for one in reversed(self.places) if one.at_ns <= at_ns), self.places[0])

    def goal_at(self, at_ns: int) -> Destination:
        """Return the goal in force, with the tolerances of its request if that was recorded."""
        goal = goal_of(self.status_at(at_ns))
        for time_ns, asked in reversed(self.goals):
            wanted = wanted_of(asked)
            place, wish = (goal.x_m, goal.y_m), (wanted.x_m, wanted.y_m)
            if time_ns <= at_ns + SLACK_NS and dist(place, wish) < SAME_M:
                return wanted
        return goal

    def instant(self, at_ns: int, world: str | None, goal: Destination | None) -> BranchPoint:
        """Return the start of a ghost; `world` and `goal` replace those of the recording."""
        place = self.place_at(at_ns)
        whereto = goal or self.goal_at(at_ns)
        return BranchPoint(world or self.world(), place.pose, place.world_s_at(at_ns), whereto)

    def rest(self, at_ns: int) -> PredictedPath:
        """Return the robot's own path from there to the end of that goal or of the recording."""
        goal_id = self.status_at(at_ns).goal_id
        after = [(time_ns, one) for time_ns, one in self.statuses if time_ns > at_ns]
        ends_ns, last = at_ns, self.status_at(at_ns)
        for time_ns, status in after:
            if status.goal_id != goal_id:
                break
            ends_ns, last = time_ns, status
            if status.goal in ENDS:
                break
        path_m: list[Point] = [self.place_at(at_ns).pose[:2]]
        path_m += [place.pose[:2] for place in self.places if at_ns < place.at_ns <= ends_ns]
        outcome = ENDS[GoalState(last.goal)] if last.goal in ENDS else DRIVING
        return PredictedPath(
            path_m,
            outcome,
            reason_text(last.goal_reason),
            (ends_ns - at_ns) / NS_PER_S,
            sum(dist(a, b) for a, b in pairwise(path_m)),
        )

    def world(self) -> Facts:
        """Return the recorded world; UserError when the recording does not hold it."""
        try:
            facts: Any = value_in(self.facts.get("world", ""))
        except ValueError:
            facts = None
        if not isinstance(facts, dict):
            raise UserError("the recording does not hold its world: name one with --world")
        return facts


def begun_ns(at_ns: int, status: NavigatorStatus) -> int:
    """Return when the goal was set, from a status that arrived at this time."""
    return at_ns - (status.time_ns - status.goal_started_ns)


def lockstep_ns(log_index: LogIndex) -> int | None:
    """Return when the plant's clock was first recorded; None without lockstep."""
    clocks = (one for _, one in log_index.on(CLOCK.path) if type(one) is SystemTime)
    first = next(clocks, None)
    return None if first is None else first.time_unix_usec * NS_PER_US


def pose_of(one: GroundTruth | PlanarOdometry) -> tuple[float, float, float]:
    """Return x_m, y_m and heading_rad."""
    return one.x_m, one.y_m, one.heading_rad


def goal_of(status: NavigatorStatus) -> Destination:
    """Return the robot's goal; UserError when it has none."""
    x_m, y_m, heading_rad = status.goal_x_m, status.goal_y_m, status.goal_heading_rad
    if status.goal == GoalState.NONE or not (isfinite(x_m) and isfinite(y_m)):
        raise UserError("the robot has no goal at that instant: give one with --goal")
    return Destination(x_m=x_m, y_m=y_m, heading_rad=heading_rad if isfinite(heading_rad) else None)


def side_of(status: NavigatorStatus) -> str | None:
    """Return the side on which the robot passes obstacles, if it reports one."""
    return next((name for name, number in SIDES.items() if number == status.side), None)


def wanted_of(asked: GoalRequest) -> Destination:
    """Return the goal of a request, as the robot reads it."""
    return Destination(
        x_m=asked.x_mm / 1000,
        y_m=asked.y_mm / 1000,
        heading_rad=None if asked.heading_free else asked.heading_urad / 1e6,
        position_tolerance_m=asked.position_tolerance_mm / 1000,
        heading_tolerance_rad=asked.heading_tolerance_urad / 1e6,
    )


def changed_in(text: str) -> dict[str, float]:
    """Return the values that differ from their defaults in a JSON list of parameters."""
    try:
        return changed(parameters_in(text))
    except RemoteError:
        return {}


def changed(parameters: Iterable[Parameter]) -> dict[str, float]:
    """Return the values that differ from their defaults."""
    return {one.name: float(one.value) for one in parameters if one.value != one.default}
