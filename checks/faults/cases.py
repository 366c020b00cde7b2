"""The fault matrix as data: faults with the required reactions and time limits, and results.

Results are saved line by line, so that an interrupted run continues from the saved lines. The page
docs/evidence/faults.md is made of them; it begins with the rows that miss a limit.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from enum import Enum, auto
from pathlib import Path
from statistics import median
from typing import Final, Self, TypeAlias

from protocol.bus.link_faults import LinkFaults
from protocol.wire.reasons import Reason


class BoardFault(Enum):
    """A fault of the emulated board that runs the control core, or of its serial line."""

    HANG = auto()
    """Its program loops for ever, until its watchdog resets it."""
    SUSPEND = auto()
    """Its emulator is suspended."""
    RESET = auto()
    """It is reset."""
    KILL = auto()
    """Its emulator is killed."""
    CUT = auto()
    """Its line is cut."""
    OUTPUT_LOST = auto()
    """Its line loses all bytes to the host."""
    INPUT_LOST = auto()
    """Its line loses all bytes to the board."""
    GARBAGE = auto()
    """Its line carries bytes that belong to no frame, between the frames."""


@dataclass(frozen=True, slots=True)
class Kill:
    """Send SIGKILL; restart the process when the robot has stopped, or after `again_s`."""

    role: str
    again_s: float | None = None


@dataclass(frozen=True, slots=True)
class Hang:
    """Send SIGSTOP, or with `gil` block in a C call that holds the GIL; resume it later."""

    role: str
    gil: bool = False


@dataclass(frozen=True, slots=True)
class Cut:
    """Drop all frames between two processes."""

    one: str
    other: str


@dataclass(frozen=True, slots=True)
class Disturb:
    """Disturb the network on the way into robot and plant."""

    trouble: LinkFaults


@dataclass(frozen=True, slots=True)
class DropOneWay:
    """Drop the frames of `sender` at `receiver`, but not those in the other direction."""

    receiver: str
    sender: str


@dataclass(frozen=True, slots=True)
class DelayOperator:
    """Delay the operator's frames from now on, even after the robot has stopped for that."""

    delay_ms: float


@dataclass(frozen=True, slots=True)
class KillLateOperator:
    """Kill the operator's process, whose frames have been delayed all the time."""

    late_ms: float


@dataclass(frozen=True, slots=True)
class BodyFault:
    """Cause a fault of sensors or wheels, by the names of [[fault]] in a world file."""

    kind: str
    target: str = ""
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class JumpClock:
    """Let the robot's clock jump."""

    seconds: float


@dataclass(frozen=True, slots=True)
class FillDisk:
    """Leave a process no room on the disk, and set a parameter."""

    role: str


@dataclass(frozen=True, slots=True)
class SlowDisk:
    """Let each fsync of the robot take this long.

    Meanwhile set a parameter and send a mission and a fence, in turn, until the robot has arrived.
    """

    fsync_s: float


@dataclass(frozen=True, slots=True)
class Flood:
    """Attack as `bench flood` does; with `pressed` the operator presses the stop meanwhile."""

    kind: str
    pressed: bool = False


class PlainAct(Enum):
    """A fault without parameters."""

    IMPERSONATE_ROUTER = auto()
    """Connect the robot to a process with the key of another robot instead of its router."""
    SECOND_ROBOT = auto()
    """Start a second robot of the same name, as when two separate networks are joined again."""
    EXTREME_FRAMES = auto()
    """Send readable frames with the least and the greatest value of every field."""
    WRAP_ENCODERS = auto()
    """Let both encoder counters pass the end of their 32 bits during the drive."""
    RAISE_IN_CORE = auto()
    """Raise an exception in the control core."""
    EMERGENCY_STOP = auto()
    """Let the operator request the emergency stop."""
    POWER_CUT = auto()
    """Cut the power while a parameter and the fence are saved, on a disk that reorders writes."""
    UNREADABLE_FENCE = auto()
    """Kill the robot and restart it with an unreadable fence file."""
    NO_MEMORY = auto()
    """Allow the robot no more memory than it has."""
    BUSY_PROCESSOR = auto()
    """Run one process per core that does nothing but use the processor."""


Act: TypeAlias = (
    Kill
    | Hang
    | Cut
    | Disturb
    | DropOneWay
    | DelayOperator
    | KillLateOperator
    | BodyFault
    | JumpClock
    | FillDisk
    | SlowDisk
    | Flood
    | BoardFault
    | PlainAct
)


class Must(Enum):
    """The required reaction to a fault, in the words of the page."""

    STOP = "stops, failsafe"
    STAND = "wheels stop"
    SAY = "reports it and stays at rest"
    GO_ON = "goes on: arrives, no contact"
    BE_SAFE = "arrives, or stops with a reason; no contact"
    KEEP = "a restart finds what was acknowledged"
    KEEP_TIME = "arrives, misses no tick, saves all"
    TOUCH_AT_MOST = "undetectable: arrives, or a contact stops it at once"


class Way(Enum):
    """The time in which a repetition runs: simulated or wall time."""

    LOCKSTEP = "lockstep"
    WALL = "wall"


RUNS_OUT_S: Final = 0.5
"""Wheels that were turning when the plant was stopped may run on for this long."""

BOTH: Final = (Way.LOCKSTEP, Way.WALL)
WALL: Final = (Way.WALL,)
LOCKSTEP: Final = (Way.LOCKSTEP,)
SAMPLING_S: Final = 0.1
"""Time until the next sample would be due, and until the tick that checks it."""
BRAKING_S: Final = 0.4
"""Time from a failsafe until the robot has stopped: the ramp from 0.3 m/s and motor lag."""
DEATH_S: Final = 0.2
PRESSED_S: Final = 0.25
"""Time from an emergency stop until the wheels stop: two periods and short-circuited motors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultCase:
    """A row of the matrix.

    `within_s` is the limit until the robot reports the fault, `stands_s` until the wheels have
    stopped; None is not judged. `reasons` are the expected reasons; any, if empty. `unseen`: the
    robot cannot be received meanwhile. `at_rest`: the robot is disarmed.
    """

    name: str
    act: Act
    must: Must
    within_s: float | None = None
    stands_s: float | None = None
    reasons: tuple[Reason, ...] = ()
    unseen: bool = False
    at_rest: bool = False
    ways: tuple[Way, ...] = BOTH

    @property
    def must_stop(self) -> bool:
        """True if the robot must stop."""
        return self.must in (Must.STOP, Must.STAND, Must.SAY)

    @property
    def limit(self) -> str:
        """The limits as text; empty without limits."""
        known = "" if self.within_s is None else f"known {self.within_s * 1e3:.0f} ms"
        stopped = "" if self.stands_s is None else f"stopped {self.stands_s * 1e3:.0f} ms"
        return ", ".join(part for part in (known, stopped) if part)


def stops(
    name: str,
    act: Act,
    within_s: float,
    *reasons: Reason,
    unseen: bool = False,
    ways: tuple[Way, ...] = BOTH,
) -> FaultCase:
    """Return a row whose robot must stop with a reason; `within_s` is the limit of the failsafe.

    The time until a missing sample is noticed is added.
    """
    known_s = within_s + SAMPLING_S
    return FaultCase(
        name=name,
        act=act,
        must=Must.STOP,
        within_s=known_s,
        stands_s=known_s + BRAKING_S,
        reasons=reasons,
        unseen=unseen,
        ways=ways,
    )


def blind(name: str, act: Act) -> FaultCase:
    """Return a row whose plant is gone, so that its wheels cannot be observed."""
    return FaultCase(
        name=name,
        act=act,
        must=Must.SAY,
        within_s=0.15 + SAMPLING_S,
        reasons=(Reason.TICKS_LOST,),
    )


def dies(name: str, act: Act, *reasons: Reason, ways: tuple[Way, ...] = BOTH) -> FaultCase:
    """Return a row whose robot process or plant link fails: the wheels must stop by themselves."""
    return FaultCase(
        name=name,
        act=act,
        must=Must.STAND,
        stands_s=DEATH_S,
        reasons=reasons,
        unseen=True,
        ways=ways,
    )


def goes_on(
    name: str, act: Act, must: Must = Must.GO_ON, ways: tuple[Way, ...] = BOTH
) -> FaultCase:
    """Return a row whose robot must drive on, or at least stay safe."""
    return FaultCase(name=name, act=act, must=must, ways=ways)


LOST: Final = (Reason.TICKS_LOST, Reason.SCAN_LOST)
OPERATOR_S: Final = 1.5
STUCK_S: Final = 1.0
"""Two checks of half a second: the first may still see the wheel turn."""
FROZEN_S: Final = 1.9
"""The time for 0.1 m at the speed in narrow places."""
SENSES: Final = ("sense/",)

PROCESSES: Final = (
    dies("robot killed", Kill("robot")),
    dies("robot stopped", Hang("robot"), Reason.BUDGET),
    dies("robot hung with the GIL held", Hang("robot", gil=True), ways=WALL),
    dies("robot restarted", Kill("robot", again_s=0.5)),
    blind("plant killed", Kill("plant")),
    blind("plant stopped", Hang("plant")),
    FaultCase(
        name="plant hung with the GIL held",
        act=Hang("plant", gil=True),
        must=Must.SAY,
        within_s=0.15 + SAMPLING_S,
        reasons=(Reason.TICKS_LOST,),
        ways=WALL,
    ),
    blind("plant restarted", Kill("plant", again_s=0.5)),
    stops("ground killed", Kill("ground"), OPERATOR_S, Reason.OPERATOR_LOST),
    stops("ground stopped (operator lost)", Hang("ground"), OPERATOR_S, Reason.OPERATOR_LOST),
    FaultCase(
        name="ground hung with the GIL held",
        act=Hang("ground", gil=True),
        must=Must.STOP,
        within_s=OPERATOR_S + SAMPLING_S,
        stands_s=OPERATOR_S + SAMPLING_S + BRAKING_S,
        reasons=(Reason.OPERATOR_LOST,),
        ways=WALL,
    ),
    goes_on("ground restarted", Kill("ground", again_s=0.3), Must.BE_SAFE),
    dies("router killed", Kill("router"), Reason.TICKS_LOST),
    dies("router stopped", Hang("router"), Reason.TICKS_LOST),
    goes_on("router hung with the GIL held", Hang("router", gil=True), ways=WALL),
    dies("router restarted", Kill("router", again_s=0.5), Reason.TICKS_LOST),
    dies("control core raises an exception", PlainAct.RAISE_IN_CORE, Reason.CORE_EXCEPTION),
    goes_on("recorder killed", Kill("recorder"), ways=WALL),
)
BOARD: Final = (
    dies("board hangs", BoardFault.HANG, ways=LOCKSTEP),
    dies("board suspended", BoardFault.SUSPEND, ways=LOCKSTEP),
    dies("board reset", BoardFault.RESET, ways=LOCKSTEP),
    dies("emulator of the board killed", BoardFault.KILL, ways=LOCKSTEP),
    dies("line to the board cut", BoardFault.CUT, ways=LOCKSTEP),
    dies("line loses all bytes from the board", BoardFault.OUTPUT_LOST, ways=LOCKSTEP),
    dies("line loses all bytes to the board", BoardFault.INPUT_LOST, ways=LOCKSTEP),
    goes_on("garbage on the line of the board", BoardFault.GARBAGE, ways=LOCKSTEP),
)
LINKS: Final = (
    stops("robot | plant", Cut("robot", "plant"), 0.15, *LOST),
    stops("robot | ground", Cut("robot", "ground"), OPERATOR_S, Reason.OPERATOR_LOST, unseen=True),
    goes_on("plant | ground", Cut("plant", "ground")),
    dies("robot | router", Cut("robot", "router"), *LOST),
    dies("plant | router", Cut("plant", "router"), *LOST),
    stops("ground | router", Cut("ground", "router"), OPERATOR_S, Reason.OPERATOR_LOST),
    goes_on("1 % of all samples lost", Disturb(LinkFaults(loss=0.01))),
    goes_on("5 % lost", Disturb(LinkFaults(loss=0.05))),
    goes_on("20 % lost", Disturb(LinkFaults(loss=0.2)), Must.BE_SAFE),
    goes_on("50 ms late", Disturb(LinkFaults(delay_ms=50))),
    goes_on("100 ms late", Disturb(LinkFaults(delay_ms=100)), Must.BE_SAFE),
    goes_on("up to 100 ms late, at random", Disturb(LinkFaults(jitter_ms=100)), Must.BE_SAFE),
    stops("300 ms late", Disturb(LinkFaults(delay_ms=300)), 0.15, *LOST),
    stops("500 ms late", Disturb(LinkFaults(delay_ms=500)), 0.15, *LOST),
    stops("senses alone 300 ms late", Disturb(LinkFaults(delay_ms=300, paths=SENSES)), 0.15, *LOST),
    goes_on("30 % doubled", Disturb(LinkFaults(duplicate=0.3))),
    goes_on("30 % overtaken by the next", Disturb(LinkFaults(reorder=0.3))),
)
ONE_WAY: Final = (
    stops("operator to robot", DropOneWay("robot", "ground"), OPERATOR_S, Reason.OPERATOR_LOST),
    goes_on("robot to operator", DropOneWay("ground", "robot"), ways=LOCKSTEP),
    stops("plant to robot", DropOneWay("robot", "plant"), 0.15, *LOST),
    dies("robot to plant", DropOneWay("plant", "robot")),
    *(
        stops(
            f"operator's frames {name} late",
            DelayOperator(late_ms),
            OPERATOR_S,
            Reason.OPERATOR_LOST,
        )
        for name, late_ms in (("300 ms", 300.0), ("1 s", 1000.0), ("3 s", 3000.0))
    ),
    *(
        stops(
            f"ground killed, its frames {name} late",
            KillLateOperator(late_ms),
            OPERATOR_S,
            Reason.OPERATOR_LOST,
            ways=WALL,
        )
        for name, late_ms in (("300 ms", 300.0), ("1 s", 1000.0))
    ),
    stops("a second robot of the same name", PlainAct.SECOND_ROBOT, 0.0, Reason.NAME_TAKEN),
)
HOSTILE: Final = (
    FaultCase(
        name="extreme frames to a disarmed robot",
        act=PlainAct.EXTREME_FRAMES,
        must=Must.STAND,
        stands_s=0.0,
        at_rest=True,
    ),
    goes_on("extreme frames under way", PlainAct.EXTREME_FRAMES, Must.BE_SAFE),
    FaultCase(
        name="emergency stop in a flood of stops",
        act=Flood("stops", pressed=True),
        must=Must.STOP,
        within_s=PRESSED_S,
        stands_s=PRESSED_S,
        ways=WALL,
    ),
    goes_on("long answers read at 20 kB/s", Flood("readers"), ways=WALL),
    goes_on("histories asked for 500 times a second", Flood("history"), ways=WALL),
    dies("router impersonated", PlainAct.IMPERSONATE_ROUTER, *LOST, ways=WALL),
)
BODY: Final = (
    goes_on("one sonar dead", BodyFault("sonar_dead", "3")),
    stops("all sonars dead", BodyFault("sonar_dead", "all"), 0.25, Reason.SCAN_LOST),
    stops("no scans", BodyFault("scan_stopped"), 0.25, Reason.SCAN_LOST),
    stops("sonars frozen", BodyFault("sonar_frozen", "all"), FROZEN_S, Reason.SONAR_FROZEN),
    stops(
        "sonar impossible (9 m)", BodyFault("sonar_fixed", "3", 9.0), 0.0, Reason.SONAR_IMPOSSIBLE
    ),
    goes_on("sonar lies (1 m too far)", BodyFault("sonar_offset", "3", 1.0), Must.TOUCH_AT_MOST),
    goes_on(
        "all sonars lose half their echoes",
        BodyFault("sonar_dropout", "all", 0.5),
        Must.BE_SAFE,
    ),
    goes_on(
        "all sonars lose every echo",
        BodyFault("sonar_dropout", "all", 1.0),
        Must.TOUCH_AT_MOST,
    ),
    stops("no wheel ticks", BodyFault("ticks_stopped"), 0.15, Reason.TICKS_LOST),
    stops("encoder stuck", BodyFault("encoder_stuck", "left"), STUCK_S, Reason.WHEEL_STUCK),
    stops(
        "encoder jumps", BodyFault("encoder_jump", "left", 50_000.0), 0.0, Reason.ENCODER_IMPOSSIBLE
    ),
    goes_on("encoders wrap", PlainAct.WRAP_ENCODERS),
    goes_on("wheels slip by a third", BodyFault("wheel_slip", "both", 0.33), Must.BE_SAFE),
    goes_on("one wheel slips by a third", BodyFault("wheel_slip", "left", 0.33), Must.BE_SAFE),
    stops("wheel stuck", BodyFault("wheel_stuck", "right"), STUCK_S, Reason.WHEEL_STUCK),
    stops("both wheels stuck", BodyFault("wheel_stuck", "both"), STUCK_S, Reason.WHEEL_STUCK),
    stops("bumper pressed", BodyFault("bumper_stuck", "", 1.0), 0.0, Reason.BUMPER),
)
MACHINE: Final = (
    FaultCase(
        name="emergency stop",
        act=PlainAct.EMERGENCY_STOP,
        must=Must.STOP,
        within_s=SAMPLING_S,
        stands_s=PRESSED_S,
    ),
    FaultCase(
        name="robot's clock jumps 5 s ahead",
        act=JumpClock(5.0),
        must=Must.STOP,
        within_s=0.0 + SAMPLING_S,
        stands_s=SAMPLING_S + BRAKING_S,
        reasons=(Reason.BUDGET, *LOST),
    ),
    goes_on("robot's clock jumps 5 s back", JumpClock(-5.0), Must.BE_SAFE),
    goes_on("disk full for the recorder", FillDisk("recorder"), ways=WALL),
    goes_on("disk full for the robot's --state", FillDisk("robot"), ways=WALL),
    goes_on("disk slow: fsync takes 0.25 s", SlowDisk(0.25), Must.KEEP_TIME, ways=WALL),
    goes_on("disk slow: fsync takes 2 s", SlowDisk(2.0), Must.KEEP_TIME, ways=WALL),
    goes_on("power cut between write and rename", PlainAct.POWER_CUT, Must.KEEP, ways=LOCKSTEP),
    dies(
        "robot restarted, its fence unreadable",
        PlainAct.UNREADABLE_FENCE,
        Reason.FENCE_UNREADABLE,
        ways=WALL,
    ),
    goes_on("robot gets no more memory", PlainAct.NO_MEMORY, Must.BE_SAFE, ways=WALL),
    goes_on("processor starved by burners", PlainAct.BUSY_PROCESSOR, Must.BE_SAFE, ways=WALL),
)
GROUPS: Final = {
    "Processes": PROCESSES,
    "Control core on an emulated board": BOARD,
    "Networks": LINKS,
    "One way, late and double": ONE_WAY,
    "Hostile": HOSTILE,
    "Senses and wheels": BODY,
    "Operator and machine": MACHINE,
}
FAULTS: Final = tuple(fault for group in GROUPS.values() for fault in group)


TOUCH_S = 0.5
"""Limit from a contact until the wheels stop: a tick, and braking."""
EPSILON_S = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Repetition:
    """The reaction to a fault; times are from the fault, None if not observed.

    `known_s` is the time until the robot reported a stop, `stood_s` until its wheels stopped, and
    `touched_s` from the first contact until then. `moved_again`: the robot moved after it had
    stopped, perhaps after the end of the fault. `lost` and `lost_events` are frames that were sent
    but are not in the log; `unlogged_s` is the time missing at its end. `missed_ticks` are control
    periods that the robot missed, where that is judged.
    """

    fault: str
    way: str
    number: int
    known_s: float | None = None
    stood_s: float | None = None
    distance_m: float | None = None
    reason: str = ""
    reached: bool = False
    contacts: int = 0
    touched_s: float | None = None
    moved_again: bool = False
    logged: int | None = None
    lost: int | None = None
    lost_events: int | None = None
    unlogged_s: float | None = None
    missed_ticks: int | None = None
    trouble: str = ""

    def misses(self, fault: FaultCase) -> list[str]:
        """Return how the repetition misses its requirement, in words; empty if it does not."""
        if self.trouble:
            return [self.trouble]
        found = (
            [f"{self.contacts} contacts"]
            if self.contacts and fault.must is not Must.TOUCH_AT_MOST
            else []
        )
        if fault.must_stop:
            return found + self._late(fault)
        if self.missed_ticks:
            found.append(f"missed {self.missed_ticks} ticks")
        if fault.must in (Must.GO_ON, Must.KEEP_TIME):
            return found + ([] if self.reached else [f"did not arrive ({self.reason or 'late'})"])
        if not self.reached and not self.reason:
            found.append("neither arrived nor stopped with a reason")
        if self.touched_s is not None and self.touched_s > TOUCH_S + EPSILON_S:
            found.append(f"drove on for {self.touched_s:.2f} s after a contact")
        return found

    def _late(self, fault: FaultCase) -> list[str]:
        found = ["moved again"] if self.moved_again else []
        names = [reason.name for reason in fault.reasons]
        if names and self.reason not in names:
            found.append(f"reported {self.reason or 'no reason'}")
        if fault.within_s is not None and not fault.unseen:
            found += over("known", self.known_s, fault.within_s)
        if fault.stands_s is not None:
            found += over("stopped", self.stood_s, fault.stands_s)
        return found


def over(what: str, took_s: float | None, limit_s: float) -> list[str]:
    """Return how a time exceeds its limit, in words; empty if it does not."""
    if took_s is None:
        return [f"never {what}"]
    if took_s > limit_s + EPSILON_S:
        return [f"{what} after {took_s * 1e3:.0f} ms, not {limit_s * 1e3:.0f}"]
    return []


class Results:
    """All repetitions so far, optionally saved in a file."""

    def __init__(self, path: Path | None, found: Iterable[Repetition] = ()) -> None:
        self._path = path
        self._found = {(one.fault, one.way, one.number): one for one in found}

    @classmethod
    def kept_in(cls, path: Path) -> Self:
        """Load the repetitions of an earlier run; incomplete lines are skipped."""
        found = []
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    found.append(Repetition(**json.loads(line)))
                except (ValueError, TypeError):
                    continue
        return cls(path, found)

    def add(self, one: Repetition) -> None:
        """Add a repetition and save it at once."""
        self._found[one.fault, one.way, one.number] = one
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(one)) + "\n")

    def has(self, fault: str, way: Way, number: int) -> bool:
        """Return whether there is such a repetition, by the name of its fault."""
        return (fault, way.value, number) in self._found

    def of(self, fault: FaultCase, way: Way) -> list[Repetition]:
        """Return the repetitions of a fault."""
        key = (fault.name, way.value)
        return [one for one in self._found.values() if (one.fault, one.way) == key]


def reason_name(number: int) -> str:
    """Return the name of a reason; empty for none."""
    return Reason(number).name if number else ""


INTRODUCTION: Final = """\
# Faults

This page shows how the robot reacts to faults. It was measured by
`sidestep bench faults --page docs/evidence/faults.md`
on {date}
({machine}).
**In lockstep**, time is simulated, and the whole stack runs in one process over real sockets. The
number of the repetition seeds the time of the fault, its phase in the control period and the
noise, so a run is reproducible. **In wall time**, router, plant, robot, `goto` and recorder are
real processes on a shared machine. If the machine delays one of them for too long, the robot stops
with BUDGET or TICKS_LOST instead of the expected reason.

- *Known* is the time from the fault until the robot reports why it does not drive; *stopped* is
  the time until its wheels do not turn. Both are median and worst, in ms. The limit of *known* is
  that of the failsafe plus 100 ms, for the next sample that would be due and the tick that checks
  it. The limit of *stopped* adds 400 ms for braking from 0.3 m/s. After a fault of the robot's own
  process or of its link to the plant, the wheels must stop within 200 ms.
- *Path* is the longest path after the fault. After the robot had stopped, the fault ended (the
  process was resumed or restarted, the link restored), and the robot had to stay at rest.
- *Log* counts the frames that were sent but are missing in the recorder's log, samples and events,
  for the worst repetition. Samples sent while the link was cut cannot be recorded; events are
  fetched later.
- Loss, delay, duplication and reordering are injected by the bus itself (`[network.trouble]`) on
  arrival of each sample, because TCP turns loss into delay. A link between two processes is cut by
  dropping all their frames; a link to the router is cut by a TCP proxy that stops forwarding.
  `tests/compose` cuts, pauses and kills real containers.
- "Router impersonated" runs with access control: the process in the router's place has the key of
  another robot, enforces no access rules, and sends everything that could make the robot drive.
  `tests/bus/test_access.py` covers an impostor at the start. `sidestep bench flood` attacks a
  robot with access control.
- A robot that hangs with the GIL held, or that was killed, is restarted.
- In the rows of the emulated board, simulated time pauses while the robot waits for the board, at
  most 3 s. The times do not contain this wait.
"""
ROW: Final = re.compile(r"^\| (.+?) \|.*$", re.MULTILINE)
THEN: Final = re.compile(r"^on (\S+)\n\((.*)\)\.$", re.MULTILINE)
APART: Final = re.compile(r"^- Apart from the others, on .*\n", re.MULTILINE)
MISSED: Final = re.compile(r"^- \*\*(.+?)\*\* in .*$", re.MULTILINE)
HEAD: Final = (
    "| fault | must | limit | lockstep: known, stopped | path "
    "| wall: known, stopped | path | log |\n"
    "|---|---|---|---|---|---|---|---|"
)

NOT_DONE: Final = {Way.LOCKSTEP: "needs processes", Way.WALL: "needs simulated time"}


def page(results: Results, machine: Mapping[str, object], before: str = "") -> str:
    """Return the page in Markdown; faults not measured now keep their rows of the old page.

    The page then keeps the date and machine of the old page, and lists the misses of old rows too.
    """
    old = rows_in(before)
    about = ", ".join(f"{key} {value}" for key, value in machine.items())
    date = f"{datetime.now(UTC):%Y-%m-%d}"
    kept = [one.name for one in FAULTS if one.name in old and not measured(one, results)]
    then = THEN.search(before) if kept else None
    if then is None:
        parts = [INTRODUCTION.format(date=date, machine=about)]
    else:
        parts = [INTRODUCTION.format(date=then[1], machine=then[2])]
        now = ", ".join(one.name for one in FAULTS if measured(one, results))
        parts += [*APART.findall(before), f"- Apart from the others, on {date} ({about}): {now}.\n"]
    parts += missed(results, [one[0] for one in MISSED.finditer(before) if one[1] in kept])
    for title, faults in GROUPS.items():
        parts += [f"## {title}\n", HEAD]
        for fault in faults:
            keep = fault.name in old and not measured(fault, results)
            parts.append(old[fault.name] if keep else row(fault, results))
        parts.append("")
    return "\n".join(parts)


def rows_in(text: str) -> dict[str, str]:
    """Return the rows of a page by the name of their fault."""
    return {found[1].replace("\\|", "|"): found[0] for found in ROW.finditer(text)}


def measured(fault: FaultCase, results: Results) -> bool:
    """Return whether there are results for a fault."""
    return any(results.of(fault, way) for way in fault.ways)


def missed(results: Results, before: Sequence[str] = ()) -> Iterable[str]:
    """Yield the rows that miss a limit, by name and with all misses."""
    yield "## Rows that miss their limit\n"
    found = [*before]
    for faults in GROUPS.values():
        for fault in faults:
            for way in fault.ways:
                repetitions = results.of(fault, way)
                bad = [(one.number, miss) for one in repetitions for miss in one.misses(fault)]
                if bad:
                    times = len({number for number, _ in bad})
                    words = "; ".join(sorted({miss for _, miss in bad}))
                    found.append(
                        f"- **{fault.name}** in {way.value}, {times} of {len(repetitions)}: {words}"
                    )
    yield from found or ["None."]
    yield ""


def row(fault: FaultCase, results: Results) -> str:
    """Return the row of a fault."""
    cells = [fault.name, fault.must.value, fault.limit or ""]
    for way in Way:
        found = results.of(fault, way)
        cells += [times(fault, found, way), way_cm(found)]
    cells.append(log(results.of(fault, Way.WALL)))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def times(fault: FaultCase, found: Sequence[Repetition], way: Way) -> str:
    """Return median and worst times; for a robot that drives on, how often it arrived."""
    if not found:
        return "" if way in fault.ways else NOT_DONE[way]
    bad = sum(bool(one.misses(fault)) for one in found)
    verdict = f" **{bad} of {len(found)} missed**" if bad else f" ({len(found)})"
    if fault.must_stop:
        known = spread(one.known_s for one in found) if fault.within_s is not None else "–"
        return f"{known}, {spread(one.stood_s for one in found)}{verdict}"
    if fault.must is Must.KEEP:
        return f"{sum(one.reached for one in found)} kept all" + verdict
    arrived = sum(one.reached for one in found)
    reasons = sorted({one.reason for one in found if one.reason and not one.reached})
    words = f"{arrived} arrived" + (f", else {', '.join(reasons)}" if reasons else "")
    if fault.must is Must.KEEP_TIME:
        words += f", {sum(one.missed_ticks or 0 for one in found)} ticks missed"
    touched = sum(one.contacts > 0 for one in found)
    return words + (f", {touched} touched" if touched else "") + verdict


def spread(values_s: Iterable[float | None]) -> str:
    """Return median and worst in ms."""
    found = [value for value in values_s if value is not None]
    return f"{median(found) * 1e3:.0f} / {max(found) * 1e3:.0f}" if found else "–"


def way_cm(found: Sequence[Repetition]) -> str:
    """Return the longest path in cm."""
    ways = [one.distance_m for one in found if one.distance_m is not None]
    return f"{max(ways) * 100:.1f} cm" if ways else ""


def log(found: Sequence[Repetition]) -> str:
    """Return the log's losses of the worst repetition, and what a killed recorder had not saved."""
    known = [one for one in found if one.lost is not None]
    if not known:
        return ""
    worst = max(known, key=lambda one: one.lost or 0)
    events = max(one.lost_events or 0 for one in known)
    text = f"{worst.lost} of {(worst.logged or 0) + (worst.lost or 0)}, {events} events"
    unlogged_s = [one.unlogged_s for one in known if one.unlogged_s is not None]
    return text + (f"; the last {max(unlogged_s):.2f} s" if unlogged_s else "")
