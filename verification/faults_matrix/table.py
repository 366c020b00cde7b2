"""The fault matrix as data: what is done, what the robot must do then, and within which limit."""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from protocol.bus.faults.link_faults import LinkFaults
from protocol.wire.reasons import Reason
from verification.faults_matrix.actions import (
    Abandon,
    Act,
    Break,
    Burn,
    Cut,
    Deafen,
    Delay,
    Disturb,
    Double,
    EmergencyStop,
    Exaggerate,
    Fill,
    Flood,
    Hang,
    Impersonate,
    Jump,
    Kill,
    Sense,
    Slow,
    Spoil,
    Squeeze,
    Unplug,
    Wrap,
)


class Must(Enum):
    """What is right, in the words of the page."""

    STOP = "stops, failsafe"
    STAND = "wheels stand"
    SAY = "says so and stands still"
    GO_ON = "goes on: arrives, no contact"
    BE_SAFE = "arrives, or stops with a reason; no contact"
    KEEP = "a restart finds what was acknowledged"
    KEEP_TIME = "arrives, misses no tick, saves all"
    TOUCH_AT_MOST = "cannot be known: arrives, or a contact stops it at once"


class Way(Enum):
    LOCKSTEP = "lockstep"
    WALL = "wall"


BOTH: Final = (Way.LOCKSTEP, Way.WALL)
WALL: Final = (Way.WALL,)
LOCKSTEP: Final = (Way.LOCKSTEP,)
SAMPLING_S: Final = 0.1
"""Until the next sample would have been due, and until the tick that looks for it."""
BRAKING_S: Final = 0.4
"""From a failsafe to a standing robot: down the ramp from 0.3 m/s, and the lag of the motors."""
DEATH_S: Final = 0.2
PRESSED_S: Final = 0.25
"""From an emergency stop to standing wheels: two periods and short-circuited motors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """`within_s`: until the robot knows; `stands_s`: until the wheels stand. None: not judged.

    `reasons` are those that are right, none: any. `unseen`: the robot cannot be heard meanwhile.
    `at_rest`: it happens to a robot that is disarmed.
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
    def limit(self) -> str:
        known = "" if self.within_s is None else f"known {self.within_s * 1e3:.0f} ms"
        stands = "" if self.stands_s is None else f"stands {self.stands_s * 1e3:.0f} ms"
        return ", ".join(part for part in (known, stands) if part)


def stops(
    name: str,
    act: Act,
    within_s: float,
    *reasons: Reason,
    unseen: bool = False,
    ways: tuple[Way, ...] = BOTH,
) -> Fault:
    """A row of the failsafe table; `within_s` is its limit, to which comes the sampling."""
    known_s = within_s + SAMPLING_S
    return Fault(
        name=name,
        act=act,
        must=Must.STOP,
        within_s=known_s,
        stands_s=known_s + BRAKING_S,
        reasons=reasons,
        unseen=unseen,
        ways=ways,
    )


def blind(name: str, act: Act) -> Fault:
    """The plant is gone, and with it whatever could be seen of the wheels."""
    return Fault(
        name=name,
        act=act,
        must=Must.SAY,
        within_s=0.15 + SAMPLING_S,
        reasons=(Reason.TICKS_LOST,),
    )


def dies(name: str, act: Act, *reasons: Reason, ways: tuple[Way, ...] = BOTH) -> Fault:
    """Whatever becomes of the robot's process, the wheels stand in time and stay so."""
    return Fault(
        name=name,
        act=act,
        must=Must.STAND,
        stands_s=DEATH_S,
        reasons=reasons,
        unseen=True,
        ways=ways,
    )


def goes_on(name: str, act: Act, must: Must = Must.GO_ON, ways: tuple[Way, ...] = BOTH) -> Fault:
    return Fault(name=name, act=act, must=must, ways=ways)


LOST: Final = (Reason.TICKS_LOST, Reason.SCAN_LOST)
OPERATOR_S: Final = 1.5
STUCK_S: Final = 1.0
"""Two looks of half a second: the first may still see it turn."""
FROZEN_S: Final = 1.9
"""0.1 m at the speed it has where it is narrow."""
SENSES: Final = ("sense/",)

PROCESSES: Final = (
    dies("robot killed", Kill("robot")),
    dies("robot stopped", Hang("robot"), Reason.BUDGET),
    dies("robot hung with the GIL held", Hang("robot", gil=True), ways=WALL),
    dies("robot restarted", Kill("robot", again_s=0.5)),
    blind("plant killed", Kill("plant")),
    blind("plant stopped", Hang("plant")),
    Fault(
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
    Fault(
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
    dies("control core raises an exception", Break(), Reason.CORE_EXCEPTION),
    goes_on("recorder killed", Kill("recorder"), ways=WALL),
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
    stops("operator to robot", Deafen("robot", "ground"), OPERATOR_S, Reason.OPERATOR_LOST),
    goes_on("robot to operator", Deafen("ground", "robot"), ways=LOCKSTEP),
    stops("plant to robot", Deafen("robot", "plant"), 0.15, *LOST),
    dies("robot to plant", Deafen("plant", "robot")),
    *(
        stops(f"operator's frames {name} late", Delay(late_ms), OPERATOR_S, Reason.OPERATOR_LOST)
        for name, late_ms in (("300 ms", 300.0), ("1 s", 1000.0), ("3 s", 3000.0))
    ),
    *(
        stops(
            f"ground killed, its frames {name} late",
            Abandon(late_ms),
            OPERATOR_S,
            Reason.OPERATOR_LOST,
            ways=WALL,
        )
        for name, late_ms in (("300 ms", 300.0), ("1 s", 1000.0))
    ),
    stops("a second robot of the same name", Double(), 0.0, Reason.NAME_TAKEN),
)
HOSTILE: Final = (
    Fault(
        name="extreme frames to a disarmed robot",
        act=Exaggerate(),
        must=Must.STAND,
        stands_s=0.0,
        at_rest=True,
    ),
    goes_on("extreme frames under way", Exaggerate(), Must.BE_SAFE),
    Fault(
        name="emergency stop in a flood of stops",
        act=Flood("stops", pressed=True),
        must=Must.STOP,
        within_s=PRESSED_S,
        stands_s=PRESSED_S,
        ways=WALL,
    ),
    goes_on("long answers read at 20 kB/s", Flood("readers"), ways=WALL),
    goes_on("histories asked for 500 times a second", Flood("history"), ways=WALL),
    dies("router impersonated", Impersonate(), *LOST, ways=WALL),
)
BODY: Final = (
    goes_on("one sonar dead", Sense("sonar_dead", "3")),
    stops("all sonars dead", Sense("sonar_dead", "all"), 0.25, Reason.SCAN_LOST),
    stops("no scans", Sense("scan_stopped"), 0.25, Reason.SCAN_LOST),
    stops("sonars frozen", Sense("sonar_frozen", "all"), FROZEN_S, Reason.SONAR_FROZEN),
    stops("sonar impossible (9 m)", Sense("sonar_fixed", "3", 9.0), 0.0, Reason.SONAR_IMPOSSIBLE),
    goes_on("sonar lies (1 m too far)", Sense("sonar_offset", "3", 1.0), Must.TOUCH_AT_MOST),
    goes_on("all sonars lose half their echoes", Sense("sonar_dropout", "all", 0.5), Must.BE_SAFE),
    goes_on("all sonars lose every echo", Sense("sonar_dropout", "all", 1.0), Must.TOUCH_AT_MOST),
    stops("no wheel ticks", Sense("ticks_stopped"), 0.15, Reason.TICKS_LOST),
    stops("encoder stuck", Sense("encoder_stuck", "left"), STUCK_S, Reason.WHEEL_STUCK),
    stops("encoder jumps", Sense("encoder_jump", "left", 50_000.0), 0.0, Reason.ENCODER_IMPOSSIBLE),
    goes_on("encoders wrap", Wrap()),
    goes_on("wheels slip by a third", Sense("wheel_slip", "both", 0.33), Must.BE_SAFE),
    goes_on("one wheel slips by a third", Sense("wheel_slip", "left", 0.33), Must.BE_SAFE),
    stops("wheel stuck", Sense("wheel_stuck", "right"), STUCK_S, Reason.WHEEL_STUCK),
    stops("both wheels stuck", Sense("wheel_stuck", "both"), STUCK_S, Reason.WHEEL_STUCK),
    stops("bumper pressed", Sense("bumper_stuck", "", 1.0), 0.0, Reason.BUMPER),
)
MACHINE: Final = (
    Fault(
        name="emergency stop",
        act=EmergencyStop(),
        must=Must.STOP,
        within_s=SAMPLING_S,
        stands_s=PRESSED_S,
    ),
    Fault(
        name="robot's clock jumps 5 s ahead",
        act=Jump(5.0),
        must=Must.STOP,
        within_s=0.0 + SAMPLING_S,
        stands_s=SAMPLING_S + BRAKING_S,
        reasons=(Reason.BUDGET, *LOST),
    ),
    goes_on("robot's clock jumps 5 s back", Jump(-5.0), Must.BE_SAFE),
    goes_on("disk full for the recorder", Fill("recorder"), ways=WALL),
    goes_on("disk full for the robot's --state", Fill("robot"), ways=WALL),
    goes_on("disk slow: fsync takes 0.25 s", Slow(0.25), Must.KEEP_TIME, ways=WALL),
    goes_on("disk slow: fsync takes 2 s", Slow(2.0), Must.KEEP_TIME, ways=WALL),
    goes_on("power cut between write and rename", Unplug(), Must.KEEP, ways=LOCKSTEP),
    dies("robot restarted, its fence unreadable", Spoil(), Reason.FENCE_UNREADABLE, ways=WALL),
    goes_on("robot gets no more memory", Squeeze(), Must.BE_SAFE, ways=WALL),
    goes_on("processor starved by burners", Burn(), Must.BE_SAFE, ways=WALL),
)
GROUPS: Final = {
    "Processes": PROCESSES,
    "Networks": LINKS,
    "One way, late and double": ONE_WAY,
    "Hostile": HOSTILE,
    "Senses and wheels": BODY,
    "Operator and machine": MACHINE,
}
FAULTS: Final = tuple(fault for group in GROUPS.values() for fault in group)
