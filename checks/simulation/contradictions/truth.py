"""The truth of a run, and what persons do and their programs say in it.

The truth is the state of robot and plant at each tick, and what arrived where. A row of the robot
is noted after each tick and after each request that it has answered.
"""

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot
from typing import Any, Final, NamedTuple

from checks.simulation.hosts.bus import SimulatedNetwork, path_of
from checks.simulation.hosts.robot_and_plant import RobotSide
from checks.simulation.hosts.virtual_time import Argument, Host, Scheduler
from plant.sim.simulation import Plant
from protocol.topics import STATUS, STOP, STOP_SERVICE
from protocol.wire.codec import decode
from protocol.wire.enums import AckResult, Command, GoalState, MissionState, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    MissionVerdict,
    NavigatorStatus,
)
from robot.vehicle import Answer, RobotVehicle
from runtime.clock import Tick
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS

NEVER: Final = -(1 << 62)
ACTIVE_GOAL: Final = range(GoalState.ACCEPTED, GoalState.REACHED)
DRIVES: Final = (Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL)


class RobotRow(NamedTuple):
    """The robot's own state, the plant's pose and speed, and the lease, at one time."""

    ns: int
    vehicle: int
    vehicle_reason: int
    mode: int
    goal_state: int
    goal_reason: int
    goal_id: int
    stop_id: int
    mission_state: int
    mission_reason: int
    x_m: float
    y_m: float
    speed_m_s: float
    holder: str
    """The program with the lease, PERSON/SESSION; empty without one."""
    holder_name: str
    op_lost_ms: float

    @property
    def is_armed(self) -> bool:
        """Whether the wheels may turn."""
        return self.vehicle == Vehicle.ACTIVE

    @property
    def is_stopped(self) -> bool:
        """Whether the emergency stop is latched."""
        return self.vehicle == Vehicle.EMERGENCY_STOP

    @property
    def has_goal(self) -> bool:
        """Whether a goal has not ended."""
        return self.goal_state in ACTIVE_GOAL

    @property
    def drives(self) -> bool:
        """Whether the robot drives to a goal."""
        return self.is_armed and self.mode in DRIVES and self.has_goal

    @property
    def is_by_hand(self) -> bool:
        """Whether an operator steers the robot."""
        return self.is_armed and self.mode == Mode.MANUAL


class RequestTruth(NamedTuple):
    """A request that the robot has answered, and its state before and after."""

    ns: int
    program: str
    """The host that sent it; empty if unknown."""
    operator: str
    request: Message
    ok: bool
    reason: int
    before: RobotRow
    at: int
    """The index of the row after it."""

    @property
    def number(self) -> int:
        """The id of the request."""
        return int(getattr(self.request, "request_id", 0))

    def is_command(self, command: Command, *params: float) -> bool:
        """Return whether this is a command with these first parameters."""
        found = self.request
        return (
            isinstance(found, CommandRequest)
            and found.command == command
            and (found.param1, found.param2)[: len(params)] == params
        )

    @property
    def begins_drive(self) -> bool:
        """Whether it began a drive by hand."""
        return self.ok and self.is_command(Command.DO_SET_MODE, 1.0, float(Mode.MANUAL))

    @property
    def begins(self) -> bool:
        """Whether it began a drive: by hand, to a goal, along a mission, or back."""
        is_drive = any(self.is_command(*words) for words in BEGINS)
        return self.ok and (is_drive or isinstance(self.request, GoalRequest))


BEGINS: Final[tuple[tuple[Any, ...], ...]] = (
    (Command.DO_SET_MODE, 1.0, float(Mode.MANUAL)),
    (Command.DO_SET_MODE, 1.0, float(Mode.SMART_RTL)),
    (Command.NAV_RETURN_TO_LAUNCH,),
    (Command.MISSION_START,),
)


class GoalTruth(NamedTuple):
    """A goal that the robot has accepted: its request, and the row in which it had ended, if any.

    `by` is the request that replaced it.
    """

    asked: RequestTruth
    end: RobotRow | None
    by: RequestTruth | None

    @property
    def place(self) -> tuple[float, float]:
        """The goal in metres."""
        return place_of(self.asked.request)


class Truth:
    """Observes robot and plant, and is asked when the run is over."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.rows: list[RobotRow] = []
        self.answered: list[RequestTruth] = []
        self.programs: dict[str, str] = {}
        """The host of each session on the bus."""
        self.plant: Callable[[], Plant | None] = lambda: None
        self.restarts_ns: list[int] = []
        self.heard_ns: defaultdict[str, list[int]] = defaultdict(list)
        """When a status of the robot arrived at each host."""
        self.pressed: dict[int, str] = {}
        """The host that pressed each emergency stop, by its id."""
        self.shown_ns: dict[int, int] = {}
        """When a status of the robot first showed each goal, by its id."""
        self.last_status: NavigatorStatus | None = None
        self.lag_ns = 0
        """How much later than it is so a state may be known here."""

        self._scheduler = scheduler

    @property
    def now_ns(self) -> int:
        """The simulated time."""
        return self._scheduler.now_ns

    # Events of the bus.

    def put(self, source: Host, key: str, frame: bytes, _note: bytes | None, _asked: bool) -> None:
        """Note a frame that leaves a host: an emergency stop, or a status of the robot."""
        path = path_of(key)
        if path.startswith((f"{STOP.path}/", f"{STOP_SERVICE.path}/")):
            with suppress(RemoteError):
                self.pressed.setdefault(
                    getattr(decode(frame).message, "request_id", 0), source.name
                )
        elif path == STATUS.path and source.name == "robot":
            self.shown(decode(frame).message)

    def shown(self, status: Any) -> None:
        """Note a status of the robot."""
        self.last_status = status
        self.shown_ns.setdefault(status.goal_id, self.now_ns)

    # Events of the robot; see RobotObserver.

    def robot_started(self) -> None:
        """Note a start of the robot's process."""
        self.restarts_ns.append(self.now_ns)

    def restored(self, vehicle: RobotVehicle) -> None:
        """Have no rules about files."""

    def held_up(self, until_ns: int) -> None:
        """Have no faults of the robot's timing."""

    def received(
        self, vehicle: RobotVehicle, request: Message, answer: Answer, operator: str
    ) -> None:
        """Note a request that the robot has answered."""
        before = self.rows[-1] if self.rows else self._row(vehicle)
        after = self._row(vehicle)
        program = self.program_of(operator)
        ok, reason = verdict_of(answer)
        at = len(self.rows)
        self.rows.append(after)
        self.answered.append(
            RequestTruth(self.now_ns, program, operator, request, ok, reason, before, at)
        )

    def cycled(self, side: RobotSide, tick: Tick) -> None:
        """Note the state after a tick."""
        if side.vehicle is not None:
            self.rows.append(self._row(side.vehicle))

    def _row(self, vehicle: RobotVehicle) -> RobotRow:
        machine, commands, plant = vehicle.state.machine, vehicle.commands, self.plant()
        truth = None if plant is None else plant.truth()
        holder: Any = vehicle.lease.holder
        return RobotRow(
            self.now_ns,
            machine.vehicle,
            machine.vehicle_reason,
            machine.mode,
            machine.goal_state,
            machine.goal_reason,
            commands.goal_id,
            commands.stop_id,
            vehicle.mission.state,
            vehicle.mission.reason,
            0.0 if truth is None else truth.x_m,
            0.0 if truth is None else truth.y_m,
            0.0 if truth is None else truth.speed_m_s,
            "" if holder is None else holder.operator,
            "" if holder is None else holder.name,
            vehicle.params.op_lost_ms,
        )

    # Questions.

    def between(self, since_ns: int, until_ns: int) -> list[RobotRow]:
        """Return the rows of a time, with the one that was in force at its beginning."""
        first = bisect_right(self.rows, since_ns, key=lambda row: row.ns)
        last = bisect_right(self.rows, until_ns + self.lag_ns, key=lambda row: row.ns)
        return self.rows[max(0, first - 1) : last]

    def ever(self, since_ns: int, until_ns: int, condition: Callable[[RobotRow], bool]) -> bool:
        """Return whether something was so at any instant of a time."""
        return any(map(condition, self.between(since_ns, until_ns)))

    def at(self, ns: int) -> RobotRow:
        """Return the newest row of a time."""
        return self.rows[max(0, bisect_right(self.rows, ns, key=lambda row: row.ns) - 1)]

    def silent_ns(self, host: str, now_ns: int) -> int:
        """Return how long ago the newest status reached a host."""
        heard_ns = self.heard_ns[host]
        at = bisect_right(heard_ns, now_ns)
        return now_ns - heard_ns[at - 1] if at else now_ns

    def gap_ns(self, host: str, since_ns: int, until_ns: int) -> int:
        """Return the longest time without a status at a host."""
        heard_ns = self.heard_ns[host]
        first, last = bisect_right(heard_ns, since_ns), bisect_right(heard_ns, until_ns)
        times_ns = [*heard_ns[max(0, first - 1) : last], until_ns]
        return max(after - before for before, after in pairwise((times_ns[0], *times_ns)))

    def gap_at(self, host: str, ns: int, now_ns: int) -> tuple[int, int]:
        """Return when a host heard the last status before a time and the first one after it."""
        heard_ns = self.heard_ns[host]
        at = bisect_right(heard_ns, ns)
        since_ns = heard_ns[at - 1] if at else 0
        return since_ns, min(now_ns, heard_ns[at] if at < len(heard_ns) else now_ns)

    def person_of(self, operator: str) -> str:
        """Return the person of an operator on the bus, by the host that has the session."""
        return person_of(self.program_of(operator))

    def program_of(self, operator: str) -> str:
        """Return the host that has the session of an operator on the bus."""
        return self.programs.get(operator.rpartition("/")[2], "")

    def is_name(self, program: str, name: str) -> bool:
        """Return whether a program is shown to others by this name; without one, by its person."""
        person, _, rest = program.partition("-")
        return name in (person, f"{person}@sim:{rest.partition('.')[0]}"[:16])

    def has_lease(self, row: RobotRow, person: str) -> bool:
        """Return whether a person holds the lease."""
        return bool(row.holder) and self.person_of(row.holder) == person

    def others_lease(self, row: RobotRow, person: str) -> bool:
        """Return whether another person holds the lease."""
        return bool(row.holder) and self.person_of(row.holder) != person

    def restarted(self, since_ns: int, until_ns: int) -> bool:
        """Return whether the robot was started again in a time."""
        return any(since_ns < ns <= until_ns for ns in self.restarts_ns[1:])

    def goals_of(self, program: str, since_ns: int, until_ns: int) -> Iterator[GoalTruth]:
        """Yield the goals of a program that the robot accepted in a time."""
        for asked in self.answered:
            is_goal = isinstance(asked.request, GoalRequest) and asked.ok
            if is_goal and asked.program == program and since_ns <= asked.ns <= until_ns:
                yield self._goal(asked)

    def refused_goal(self, program: str, since_ns: int) -> bool:
        """Return whether the robot has refused a goal of a program."""
        goals = (one for one in self.answered if isinstance(one.request, GoalRequest))
        return any(one.program == program and one.ns >= since_ns and not one.ok for one in goals)

    def _last_in_tick(self, row: RobotRow) -> RobotRow:
        """Return the last row of the tick of a row."""
        return [one for one in self.rows if one.ns == row.ns][-1]

    def _goal(self, asked: RequestTruth) -> GoalTruth:
        for row in self.rows[asked.at :]:
            if row.goal_id == asked.number and row.goal_state >= GoalState.REACHED:
                is_shown = self._last_in_tick(row).goal_id == asked.number
                if row.goal_state != GoalState.REACHED and not is_shown:
                    continue  # no status shows an end that another goal follows in its own tick
                return GoalTruth(asked, row, None)
            if row.goal_id != asked.number:
                by = next((one for one in self.answered if one.number == row.goal_id), None)
                return GoalTruth(asked, row, by)
        return GoalTruth(asked, None, None)

    def driven_after(self, by: RequestTruth) -> RequestTruth:
        """Return the first goal since this one that lasted to the end of a tick, if any did.

        The robot has not driven to one that was replaced in its own tick.
        """
        while by.number not in self.shown_ns and (following := self._goal(by).by) is not None:
            by = following
        return by

    def drives_of(self, program: str, since_ns: int, until_ns: int) -> Iterator[RequestTruth]:
        """Yield the requests by which a program has begun to drive by hand in a time."""
        for one in self._asked_once():
            if one.begins_drive and one.program == program and since_ns <= one.ns <= until_ns:
                yield one

    def begun_after(self, drive: RequestTruth, until_ns: int) -> list[RequestTruth]:
        """Return the requests that have begun another drive since this one, by hand or not."""
        later = (one for one in self._asked_once() if one.at > drive.at and one.ns <= until_ns)
        return [one for one in later if one.begins]

    def _asked_once(self) -> Iterator[RequestTruth]:
        """Yield the requests without their copies, which have the same answer and no effect."""
        known: set[tuple[str, int]] = set()
        for one in self.answered:
            if (key := (one.operator, one.number)) not in known:
                known.add(key)
                yield one

    def drive_at(self, ns: int) -> RequestTruth | None:
        """Return the request that began the newest drive by hand."""
        return self._newest(lambda one: one.begins_drive and one.ns <= ns)

    def drive_before(self, ended: RequestTruth) -> RequestTruth | None:
        """Return the request that began the drive by hand which another request has ended."""
        return self._newest(lambda one: one.begins_drive and one.at < ended.at)

    def mission_before(self, ended: RequestTruth) -> RequestTruth | None:
        """Return the request that began the mission which another request has ended."""
        start = Command.MISSION_START
        return self._newest(lambda one: one.ok and one.is_command(start) and one.at < ended.at)

    def _newest(self, wanted: Callable[[RequestTruth], bool]) -> RequestTruth | None:
        return next(filter(wanted, reversed(self.answered)), None)


class ListeningNetwork(SimulatedNetwork):
    """A network that notes when a status of the robot reaches a host."""

    def __init__(self, scheduler: Scheduler, truth: Truth) -> None:
        super().__init__(scheduler)
        self._truth = truth

    def send(
        self, source: Host, target: Host, path: str, action: Callable[..., object], *arguments: Any
    ) -> None:
        """Send a frame, and note its arrival."""
        if source.name == "robot" and path == STATUS.path:
            given, name = action, target.name

            def action(*more: Any) -> None:
                self._truth.heard_ns[name].append(self.scheduler.now_ns)
                given(*more)

        super().send(source, target, path, action, *arguments)


def verdict_of(answer: Answer) -> tuple[bool, int]:
    """Return whether an answer accepts, and its reason."""
    if isinstance(answer, CommandAck):
        return answer.result == AckResult.ACCEPTED, answer.result_param2
    if isinstance(answer, MissionVerdict):
        return not answer.reason, answer.reason
    return True, 0


def place_of(request: Message) -> tuple[float, float]:
    """Return the place of a goal in metres."""
    assert isinstance(request, GoalRequest), "only goals have a place"
    return request.x_mm / 1000, request.y_mm / 1000


def distance_m(row: RobotRow, place: tuple[float, float]) -> float:
    """Return the true distance of the robot from a place."""
    return hypot(row.x_m - place[0], row.y_m - place[1])


def person_of(program: str) -> str:
    """Return the person of a program, as in `ada` of `ada-t1`."""
    return program.partition("-")[0]


def failed_mission(row: RobotRow) -> bool:
    """Return whether the mission has failed."""
    return row.mission_state == MissionState.FAILED


def ms(ns: int) -> int:
    """Return whole milliseconds."""
    return ns // NS_PER_MS


@dataclass(slots=True, eq=False)
class Deed:
    """What a person asks of a program, until the program says its end.

    `cancelled_ns` is when the person, or a time limit, has ended it early.
    """

    program: str
    verb: str
    arguments: tuple[Argument, ...]
    began_ns: int
    ended_ns: int | None = None
    cancelled_ns: int | None = None
    killed: bool = False

    def __str__(self) -> str:
        return " ".join(map(str, (self.verb, *self.arguments)))

    def until_ns(self, now_ns: int) -> int:
        """Return the time of its end, or now."""
        return now_ns if self.ended_ns is None else self.ended_ns


@dataclass(frozen=True, slots=True)
class EndedCommand:
    """The end of a command or of `up`: exit code, the outcome or None, and the error in words."""

    code: int
    outcome: Any = None
    error: str = ""


@dataclass(frozen=True, slots=True)
class ShownText:
    """A text that a program shows; `where` names the part of it."""

    where: str
    text: str


class Said(NamedTuple):
    """A word of a program: a value of the product, or text in which a value is rendered."""

    ns: int
    program: str
    value: Any
    deed: Deed | None = None


@dataclass(slots=True)
class Journal:
    """All deeds and all words of a run."""

    scheduler: Scheduler
    deeds: list[Deed] = field(default_factory=list)
    words: list[Said] = field(default_factory=list)

    def begin(self, program: str, verb: str, arguments: tuple[Argument, ...]) -> Deed:
        """Note the begin of a deed."""
        deed = Deed(program, verb, arguments, self.scheduler.now_ns)
        self.deeds.append(deed)
        return deed

    def end(self, deed: Deed, value: Any) -> None:
        """Note the end of a deed, and what was said at its end."""
        deed.ended_ns = self.scheduler.now_ns
        self.say(deed.program, value, deed)

    def cancel(self, deed: Deed) -> None:
        """Note that a deed is ended early."""
        if deed.cancelled_ns is None:
            deed.cancelled_ns = self.scheduler.now_ns

    def killed(self, program: str) -> None:
        """Note that a program has been killed."""
        for deed in self.deeds:
            if deed.program == program and deed.ended_ns is None:
                deed.ended_ns, deed.killed = self.scheduler.now_ns, True

    def say(self, program: str, value: Any, deed: Deed | None = None) -> None:
        """Note a word; the same text again is no news."""
        self.words.append(Said(self.scheduler.now_ns, program, value, deed))
