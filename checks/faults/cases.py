"""The faults as data without behaviour, and the fault matrix: reactions and time limits."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, TypeAlias

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
