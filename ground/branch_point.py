"""Describe the instant of a run from which another navigator continues: live or of a recording.

Parse the output of a ghost's process, too: its path tick by tick, then its result.
"""

from collections.abc import Iterable, Mapping
from itertools import pairwise
from math import degrees, dist, isfinite
from typing import Any, Final, NamedTuple, TypeAlias

from ground.client.goal import Destination
from ground.client.lost_drive import SAME_M
from ground.client.parameter import Parameter, parameters_in
from ground.client.robot_link import LISTEN_NS, UnansweredError
from ground.client.vocabulary import SIDES
from ground.recording.log_reader import LogIndex
from ground.recording.world_metadata import world_of
from ground.robot import Robot
from protocol.outcome import ENDS, reason_words, start_arguments
from protocol.topics import CLOCK, COMMANDED, ODOMETRY, STATUS, TRUTH, WORLD
from protocol.wire.enums import GoalState
from protocol.wire.messages import (
    GoalRequest,
    GroundTruth,
    NavigatorStatus,
    PlanarOdometry,
    SystemTime,
)
from runtime.errors import RemoteError, UserError
from runtime.files import value_in
from runtime.units import NS_PER_S, NS_PER_US

STANDARD_INPUT: Final = "-"
OF_THE_BODY: Final = frozenset(
    {
        *("radius_m", "track_m", "wheel_radius_m", "wheel_ratio", "m_per_tick"),
        *("wheel_max_m_s", "accel_m_s2", "k_r_m", "k_l_m", "sonar_max_m", "period_s"),
    }
)
"""Parameters given by the world and its noise; another noise level gives other values."""

OF_THE_RUN: Final = frozenset({"navigator", "side"})


class BranchPoint(NamedTuple):
    """Start of a ghost: `world` is a file name or the plant's description (JSON, parsed or text).

    `start` is x_m, y_m and heading_rad; `at_s` is the world's own time.
    """

    world: str
    start: tuple[float, float, float]
    at_s: float
    goal: Destination


def trial_words(instant: BranchPoint, navigator: str, more: Mapping[str, object]) -> list[str]:
    """Return the arguments of a trial; `more` are options by name, None for those to omit."""
    goal = instant.goal
    place = [repr(goal.x_m), repr(goal.y_m)]
    if goal.heading_rad is not None:
        place.append(repr(degrees(goal.heading_rad)))
    words = ["trial", "--json", "--trace", "-", "--navigator", navigator]
    words += ["--world", STANDARD_INPUT if world_bytes(instant) else instant.world]
    words += ["--start", *start_arguments(*instant.start), "--at", repr(instant.at_s)]
    words += ["--goal", *place, "--tolerance", repr(goal.position_tolerance_m)]
    words += ["--heading-tolerance", repr(degrees(goal.heading_tolerance_rad))]
    for name, value in more.items():
        words += [] if value is None else [f"--{name}", str(value)]
    return words


def world_bytes(instant: BranchPoint) -> bytes:
    """Return the standard input of the trial; empty when the world is given by name."""
    world = instant.world
    return world.encode() if world.lstrip().startswith("{") else b""


def driving(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters that describe driving, without those of the body."""
    return {
        name: value
        for name, value in parameters.items()
        if name not in OF_THE_BODY and name not in OF_THE_RUN
    }


Point: TypeAlias = tuple[float, float]

STEP_M: Final = 0.02
"""Distance below which points are omitted; they would not be visible on a map."""

PLACE: Final = ("true_x_m", "true_y_m")
FAILED: Final = "failed"


class PredictedPath(NamedTuple):
    """A path and its result: `outcome` as in `protocol.outcome`, or `failed`.

    `length_m` and `time_s` are None when the run did not start.
    """

    path_m: list[Point]
    outcome: str
    reason: str
    time_s: float | None = None
    length_m: float | None = None
    contacts: int = 0


class PathReader:
    """Accepts the output in pieces of any size; malformed lines are ignored."""

    def __init__(self) -> None:
        self.path_m: list[Point] = []
        self.outcome: dict[str, Any] | None = None
        self._rest = b""
        self._columns: tuple[int, ...] | None = None
        self._last: Point | None = None

    def take(self, data: bytes) -> None:
        """Process a piece of the output."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._take_lines(lines)

    def _take_lines(self, lines: Iterable[bytes]) -> None:
        for line in lines:
            if line.startswith(b"{"):
                self._take_outcome(line)
            elif self._columns is None:
                self._take_header(line)
            else:
                self._take_place(line.split(b","))

    def _take_header(self, line: bytes) -> None:
        names = line.decode(errors="replace").strip().split(",")
        if all(name in names for name in PLACE):
            self._columns = tuple(names.index(name) for name in PLACE)

    def _take_place(self, values: list[bytes]) -> None:
        try:
            x_m, y_m = (float(values[column]) for column in self._columns or ())
        except (ValueError, IndexError):
            return
        if not (isfinite(x_m) and isfinite(y_m)):
            return
        self._last = (x_m, y_m)
        if not self.path_m or dist(self.path_m[-1], self._last) >= STEP_M:
            self.path_m.append(self._last)

    def _take_outcome(self, line: bytes) -> None:
        """Store the outcome; the last point is always part of the path."""
        try:
            found = value_in(line)
        except ValueError:
            return
        if isinstance(found, dict) and isinstance(found.get("outcome"), str):
            self.outcome = found
            if self._last is not None and self.path_m[-1] != self._last:
                self.path_m.append(self._last)

    def course(self, otherwise: str) -> PredictedPath:
        """Return the result; `otherwise` is the reason when the process reported none."""
        outcome = self.outcome
        if outcome is None:
            return PredictedPath(list(self.path_m), FAILED, otherwise)
        return PredictedPath(
            list(self.path_m),
            outcome["outcome"],
            str(outcome.get("reason", "")),
            number(outcome.get("time_s")),
            number(outcome.get("path_m")),
            int(number(outcome.get("contacts")) or 0),
        )


def number(value: object) -> float | None:
    """Return a finite number, or None."""
    return float(value) if isinstance(value, int | float) and isfinite(value) else None


SLACK_NS: Final = 100_000_000
"""Tolerance between the recording of a request and the robot's report of its goal."""

LIVING: Final = (GoalState.ACCEPTED, GoalState.DRIVING, GoalState.AVOIDING, GoalState.ALIGNING)
DRIVING: Final = "driving"


class RecordedPose(NamedTuple):
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
            RecordedPose(when(at_ns, one.time_ns), pose_of(one), one.time_ns)
            for at_ns, one in log_index.on(TRUTH.path)
            if type(one) is GroundTruth
        ]
        self.places = truths or [
            RecordedPose(when(at_ns, one.time_ns), pose_of(one), None)
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

    def place_at(self, at_ns: int) -> RecordedPose:
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
            reason_words(last.goal_reason, last.ended_by),
            (ends_ns - at_ns) / NS_PER_S,
            sum(dist(a, b) for a, b in pairwise(path_m)),
        )

    def world(self) -> str:
        """Return the JSON of the recorded world; UserError when the recording does not hold it."""
        text = self.facts.get("world", "")
        if world_of(text) is None:
            raise UserError("the recording does not hold its world: name one with --world")
        return text


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


ASK_S: Final = 1.0


class LiveState(NamedTuple):
    """State of a running robot, from which a ghost can start."""

    status: NavigatorStatus
    instant: BranchPoint
    parameters: dict[str, float]
    """Those for driving that differ from their defaults."""

    def rest(self) -> PredictedPath:
        """Return an open result, because the robot is still driving."""
        return PredictedPath([], DRIVING, "", None, None)


async def state_of(robot: Robot, world: str | None, goal: Destination | None) -> LiveState:
    """Return the state of a running robot; `world` and `goal` replace those of the robot.

    Raises UnansweredError when its messages do not arrive, UserError without a simulation, as only
    a simulation provides the true pose, and RemoteError for a malformed world.
    """
    with robot.subscribed(STATUS, TRUTH) as telemetry:
        await robot.wait(lambda: all(map(telemetry.latest, (STATUS, TRUTH))), LISTEN_NS)
        now_ns = robot.clock.now_ns()
        status, truth = telemetry.live(STATUS, now_ns), telemetry.live(TRUTH, now_ns)
    if status is None:
        raise UnansweredError(await robot.diagnosis())
    if truth is None:
        raise UserError("there is no simulation, which a ghost needs for the true pose")
    whereto = goal or goal_of(status)
    if world is None:
        world = await robot.in_own_thread(lambda: world_at(robot))
    instant = BranchPoint(world, pose_of(truth), truth.time_ns / NS_PER_S, whereto)
    return LiveState(status, instant, driving(changed(await robot.parameters.fetch())))


def world_at(robot: Robot) -> str:
    """Ask the plant for the JSON of its world; RemoteError when the answer is malformed."""
    answer = robot.bus.ask(WORLD, timeout_s=ASK_S, robot=robot.name)
    text = answer.decode(errors="replace") if isinstance(answer, bytes) else ""
    if world_of(text) is None:
        raise RemoteError("malformed answer of the plant: not a world")
    return text
