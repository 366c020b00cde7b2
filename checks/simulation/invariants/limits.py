"""The limits of the invariants, how each is composed, and the shared state of the invariants.

A limit is the sum of what the design allows in the worst case, without a margin. What the product
decides is decided here once more and in another way: a limit or a table that was the product's own
would be right by definition.

The state has time, disturbances, the first violation, and the coverage of the runs, which shows
that the absence of violations means something.
"""

from collections import Counter
from dataclasses import dataclass, field
from math import atan2, hypot, pi
from typing import TYPE_CHECKING, Final, NamedTuple

from checks.simulation.hosts.operators import RequestHistory
from checks.simulation.hosts.virtual_time import Scheduler
from protocol.wire.enums import Command, LeaseAction, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    MissionRequestInt,
    MissionRequestList,
    ParamRequestRead,
)
from runtime.units import NS_PER_MS

PERIOD_NS: Final = 50 * NS_PER_MS
TTL_NS: Final = 150 * NS_PER_MS
LINK_NS: Final = 1 * NS_PER_MS
"""Round trip of a frame on an undisturbed network (0.3 ms each way), rounded up."""

STILL_M_S: Final = 0.01
"""Rim speed of a stopped wheel: the rest of 0.3 m/s after three time constants."""

BRAKE_NS: Final = 38 * NS_PER_MS
"""The driver's brake from 0.3 m/s at 8 m/s^2."""

RAMP_NS: Final = 250 * NS_PER_MS
"""Braking by a command of zero speed: 0.3 to 0.075 m/s at 1.5 m/s^2 take 150 ms, the motor's lag
of 50 ms takes another 100 ms down to 0.01 m/s."""

SILENT_STOP_NS: Final = TTL_NS + BRAKE_NS
"""Time from the tick that the last command answers, with no later one, until the wheels stop."""

COMMAND_STOP_NS: Final = TTL_NS + RAMP_NS
"""Time from the tick that the last command to move answers. A zero command takes effect at the
latest when the time to live of that command ends, and then brakes."""

TICK_NS: Final = PERIOD_NS + PERIOD_NS // 4
"""Longest time between two ticks of an undisturbed robot: its grid waits up to a quarter of a
period for a scan."""

DISARMED_STOP_NS: Final = TICK_NS + COMMAND_STOP_NS
"""Time from the last armed tick of the robot, which the last command may answer."""

STOP_NS: Final = LINK_NS + TICK_NS + PERIOD_NS + BRAKE_NS
"""Time from the press of an emergency stop on an undisturbed network: the delay of the frame, the
robot's next tick, the plant's next period, and the driver's brake."""

FAILSAFE_STOP_NS: Final = TICK_NS + PERIOD_NS + BRAKE_NS
"""Time from the limit of a failsafe until the wheels stop: the robot's next tick, the plant's next
period, and the driver's brake."""

ACKNOWLEDGED_STOP_NS: Final = PERIOD_NS + BRAKE_NS
"""Time from an acknowledged stop: the status is sent right after the brake command."""

ACKNOWLEDGED_NS: Final = LINK_NS + TICK_NS + 2 * PERIOD_NS
"""Time from the press of an emergency stop until its operator sees it: the robot's next tick, one
repetition of the operator, and one look of the station at its newest status."""

ACKNOWLEDGED_AMONG_OTHERS_NS: Final = 1_000 * NS_PER_MS + ACKNOWLEDGED_NS + 2 * PERIOD_NS
"""The same if others stop at the same time, so that the status shows their stops: an accepted stop
and EMERGENCY_STOP for 1 s acknowledge it, as seen by two more repetitions."""

KEPT_NS: Final = 1_000 * NS_PER_MS
"""A stop is on the disk within this time."""

LOST_BRAKE_NS: Final = TTL_NS + BRAKE_NS
"""The same if the brake command was lost: the last command to move expires."""

BRAKED_NS: Final = COMMAND_STOP_NS + TICK_NS
"""After this time of zero commands, forged commands are rejected as contradictory."""

BOOT_NS: Final = 300 * NS_PER_MS
"""A robot that was started serves within this time."""

ROUNDING_NS: Final = 5 * NS_PER_MS
"""Ages are whole milliseconds, and the robot's clock is known within the delay of a frame."""

STEERED_NS: Final = RAMP_NS
"""After a teleop frame has expired, the robot brakes at its own limit of acceleration."""

LAPSE_NS: Final = 3_000 * NS_PER_MS + TICK_NS
"""The lease expires after this time without a heartbeat of its person, once one of its programs
has sent some: 3 s and one tick."""

IDLE_NS: Final = 30_000 * NS_PER_MS + TICK_NS
"""The lease expires after this time in which its person has neither asked nor driven."""

GIVEN_UP_NS: Final = 500 * NS_PER_MS
"""A request stays valid for the rest of its attempt after its operator's process has ended."""

FENCE_M: Final = 0.12
"""Distance that the centre of the robot may leave the fence: 0.3 m/s for one tick until detection
(62 ms) and one period until the plant obeys (50 ms), and 0.04 m of braking: 0.3 * 0.112 + 0.04 =
0.08. Senses that are late by up to their time to live add 0.04."""

BORDER_M: Final = 0.002
"""Error of a place on the border of a fence: goals are whole millimetres, corners single floats."""

TICK_GAP_NS: Final = 2 * TICK_NS - 1 * NS_PER_MS
"""Longest time between two ticks of an undisturbed loop: one frame late, the next early."""

BACKLOG: Final = 64
"""Maximum number of requests in a queue."""

STANDSTILL_NS: Final = 12_000 * NS_PER_MS
"""A goal ends as STUCK after 10 s without motion; the rest is for turning on the spot."""

CALM_NS: Final = 3_000 * NS_PER_MS
"""After this time without a fault, all late and retained frames are gone."""

CLIENT_REPEAT_NS: Final = 200 * NS_PER_MS
"""A client of the gateway repeats its emergency stop at this interval."""

CLIENT_SILENT_NS: Final = 3_500 * NS_PER_MS
"""After this silence of the client in control, the gateway sends no operator's heartbeat."""

CLIENT_STEERED_NS: Final = 1_000 * NS_PER_MS + 20 * NS_PER_MS
"""Speeds of a client are valid for a second, and the gateway works in rounds of 20 ms."""

CLIENT_ASKED_NS: Final = 15_000 * NS_PER_MS
"""Time from a client's frame to the robot's answer: on a bad network up to three requests follow it
(the lease, the clear and the arming), each of which waits 3 s and is sent for 1.5 s."""

CLIENT_ACKNOWLEDGED_NS: Final = (
    ACKNOWLEDGED_AMONG_OTHERS_NS + ACKNOWLEDGED_NS + CLIENT_REPEAT_NS + LINK_NS
)
"""Time from the press of a client's emergency stop until it sees the acknowledgement: each frame is
a stop of its own, and the gateway waits for the acknowledgement of one after another."""

OPERATOR_LOST_NS: Final = 1_500 * NS_PER_MS
"""Longest silence of an operator; an operator may only shorten it."""


def operator_lost_ns(op_lost_ms: float) -> float:
    """Return the time after which an operator is lost, by the parameter in force."""
    return min(OPERATOR_LOST_NS, op_lost_ms * NS_PER_MS)


def stop_ns(operator: str, *, is_heard: bool) -> int:
    """Return the limit of a stop; a client's passes one more link, and perhaps with a later copy.

    `is_heard`: nothing was in the way when it was pressed.
    """
    if not operator.startswith("client"):
        return STOP_NS
    return STOP_NS + LINK_NS + (0 if is_heard else CLIENT_REPEAT_NS)


RESTS: Final[dict[int, dict[str, float]]] = {
    Command.DO_FLIGHTTERMINATION: {},
    Command.SIDESTEP_ABORT_GOAL: {},
    Command.DO_PAUSE_CONTINUE: {"param1": 0},
    Command.COMPONENT_ARM_DISARM: {"param1": 0},
    Command.DO_SET_MODE: {"param2": Mode.HOLD},
}
"""Commands after which the robot rests, with the parameters that make them so."""


def is_free(request: Message) -> bool:
    """Return whether an operator without the lease may have this request accepted.

    These are what leaves a robot at rest, what only reads, and the seizure of the lease.
    """
    if isinstance(request, CommandRequest):
        wants = RESTS.get(request.command)
        return wants is not None and all(getattr(request, name) == wants[name] for name in wants)
    if isinstance(request, LeaseRequest):
        return request.action == LeaseAction.SEIZE
    return isinstance(request, ParamRequestRead | MissionRequestList | MissionRequestInt)


def begins(request: Message) -> bool:
    """Return whether an accepted request begins a goal, a mission, a way back or a manual drive."""
    if isinstance(request, CommandRequest) and request.command == Command.DO_SET_MODE:
        return request.param2 in (Mode.MANUAL, Mode.SMART_RTL)
    begun = (Command.MISSION_START, Command.NAV_RETURN_TO_LAUNCH)
    is_begun = isinstance(request, CommandRequest) and request.command in begun
    return is_begun or isinstance(request, GoalRequest)


def leads_on(request: Message) -> bool:
    """Return whether an accepted request may let the robot go on, in the name of its sender."""
    onward = (Command.DO_SET_MODE, Command.DO_PAUSE_CONTINUE)
    is_onward = isinstance(request, CommandRequest) and request.command in onward
    return is_onward and not is_free(request)


def is_around(xs_m: tuple[float, ...], ys_m: tuple[float, ...], x_m: float, y_m: float) -> bool:
    """Return whether a polygon winds around a point: the angles of its sides seen from there."""
    turned_rad = 0.0
    for at in range(len(xs_m)):
        before_rad = atan2(ys_m[at - 1] - y_m, xs_m[at - 1] - x_m)
        after_rad = atan2(ys_m[at] - y_m, xs_m[at] - x_m)
        turned_rad += (after_rad - before_rad + pi) % (2.0 * pi) - pi
    return abs(turned_rad) > pi


def outside_m(
    xs_m: tuple[float, ...], ys_m: tuple[float, ...], radius_m: float, x_m: float, y_m: float
) -> float:
    """Return the distance of a place outside a circle or a polygon; 0 within it."""
    if radius_m:
        return max(0.0, hypot(x_m - xs_m[0], y_m - ys_m[0]) - radius_m)
    if is_around(xs_m, ys_m, x_m, y_m):
        return 0.0
    places = list(zip(xs_m, ys_m, strict=True))
    return min(to_side_m((x_m, y_m), places[at - 1], places[at]) for at in range(len(places)))


def to_side_m(
    place: tuple[float, float], start: tuple[float, float], end: tuple[float, float]
) -> float:
    """Return the distance of a place from a side of a polygon."""
    dx_m, dy_m = end[0] - start[0], end[1] - start[1]
    share = ((place[0] - start[0]) * dx_m + (place[1] - start[1]) * dy_m) / (dx_m**2 + dy_m**2)
    share = min(1.0, max(0.0, share))
    return hypot(place[0] - start[0] - share * dx_m, place[1] - start[1] - share * dy_m)


if TYPE_CHECKING:
    from checks.simulation.hosts.robot_and_plant import RobotSide


@dataclass(slots=True)
class Coverage:
    """Counts over runs; `reached` counts situations, each once per run."""

    plant_ticks: int = 0
    moving_ticks: int = 0
    robot_ticks: int = 0
    requests: int = 0
    accepted: int = 0
    stops: int = 0
    """Emergency stops that were acknowledged to an operator."""
    reached: Counter[str] = field(default_factory=Counter)
    worst_ms: dict[str, int] = field(default_factory=dict)

    def longest(self, what: str, took_ms: int) -> None:
        """Keep the longest duration of a reaction."""
        self.worst_ms[what] = max(self.worst_ms.get(what, 0), took_ms)

    def add(self, other: "Coverage") -> None:
        """Add the counts of other runs."""
        self.plant_ticks += other.plant_ticks
        self.moving_ticks += other.moving_ticks
        self.robot_ticks += other.robot_ticks
        self.requests += other.requests
        self.accepted += other.accepted
        self.stops += other.stops
        self.reached.update(other.reached)
        for what, took_ms in other.worst_ms.items():
            self.longest(what, took_ms)

    @property
    def moving_percent(self) -> float:
        """Share of the plant's ticks in which the wheels turned."""
        return 100.0 * self.moving_ticks / self.plant_ticks if self.plant_ticks else 0.0

    def lines(self) -> list[str]:
        """Return the counts in words."""
        head = (
            f"wheels turned in {self.moving_percent:.0f} % of {self.plant_ticks} ticks; "
            f"{self.accepted} of {self.requests} requests accepted; "
            f"{self.stops} stops acknowledged"
        )
        found = ", ".join(f"{name} {count}" for name, count in sorted(self.reached.items()))
        worst = ", ".join(f"{what} {ms} ms" for what, ms in sorted(self.worst_ms.items()))
        return [head, f"runs that reached: {found}", *([f"worst: {worst}"] if worst else [])]


NEVER = -(1 << 62)


class InvariantViolation(NamedTuple):
    """The violated invariant, the time, and the observation."""

    invariant: str
    time_ns: int
    words: str


class RunState:
    """The state of a run; `violation` is the first one, or None."""

    def __init__(self, scheduler: Scheduler, history: RequestHistory) -> None:
        self.violation: InvariantViolation | None = None
        self.coverage = Coverage()
        self.history = history
        self.robot: RobotSide | None = None
        self.plant_ns = 0
        """Time of the plant's newest tick, on its own clock."""
        self.plant_starts = 0
        self.disturbed_until_ns = NEVER
        """Until then a process is delayed or missing, so ticks may be missed."""
        self.impaired_until_ns = NEVER
        """Until then frames may be lost or late."""
        self.stands_until_ns = NEVER
        """Until then the plant's clock stands still, in lockstep."""
        self.disk_until_ns = NEVER
        """Until then the robot's disk may be slow or failing."""
        self.unsure_until_ns = NEVER
        """Until then an operator does not know the robot's clock."""
        self.forged_ns = NEVER
        """Time of the plant's tick that the newest forged wheel command answers."""
        self.is_placed = False
        """True once an operator has set the pose, by which the robot keeps within its fence."""
        self.placed_ns = NEVER
        """When the pose was last set."""
        self.armed_ns = NEVER
        """Last time the robot was armed or started."""
        self.awake_ns = NEVER
        """Last time the plant was resumed; the world does not move while it is suspended."""
        self.started_ns = 0
        """Last start of the robot or the plant."""
        self._scheduler = scheduler

    @property
    def now_ns(self) -> int:
        """The simulated time."""
        return self._scheduler.now_ns

    @property
    def events(self) -> int:
        """The number of events so far."""
        return self._scheduler.events

    @property
    def sound_since_ns(self) -> int:
        """The time since which frames and processes are undisturbed; may be in the future."""
        return max(self.disturbed_until_ns, self.impaired_until_ns, self.stands_until_ns)

    @property
    def stands(self) -> bool:
        """True while the plant's clock stands still."""
        return self.now_ns <= self.stands_until_ns

    def held_up(self, until_ns: int) -> None:
        """Record that a process is delayed or missing until a time."""
        self.disturbed_until_ns = max(self.disturbed_until_ns, until_ns)

    def impaired(self, until_ns: int) -> None:
        """Record that frames may be lost or late until a time."""
        self.impaired_until_ns = max(self.impaired_until_ns, until_ns)

    def unsure(self, until_ns: int) -> None:
        """Record that an operator does not know the robot's clock until a time."""
        self.unsure_until_ns = max(self.unsure_until_ns, until_ns)

    def fail(self, invariant: str, words: str) -> None:
        """Record a violation, unless there is one already."""
        if self.violation is None:
            self.violation = InvariantViolation(invariant, self.now_ns, words)

    def worst(self, what: str, took_ns: int) -> None:
        """Record the duration of a reaction, for the report of the longest ones."""
        self.coverage.longest(what, took_ns // NS_PER_MS)
