"""What can be done to a running stack, as data; `lockstep` and `wall` each know how."""

from dataclasses import dataclass
from typing import TypeAlias

from protocol.bus.faults.link_faults import LinkFaults


@dataclass(frozen=True, slots=True)
class Kill:
    """SIGKILL. It is started again when the robot stands, or after `again_s`."""

    role: str
    again_s: float | None = None


@dataclass(frozen=True, slots=True)
class Hang:
    """SIGSTOP, or with `gil` a C call that keeps the lock of its interpreter; then let go."""

    role: str
    gil: bool = False


@dataclass(frozen=True, slots=True)
class Cut:
    """Nothing passes between these two, until it is mended."""

    one: str
    other: str


@dataclass(frozen=True, slots=True)
class Impersonate:
    """The robot's cable to its router leads to a process with the key of another robot."""


@dataclass(frozen=True, slots=True)
class Disturb:
    """A bad network on the way into robot and plant."""

    trouble: LinkFaults


@dataclass(frozen=True, slots=True)
class Deafen:
    """`who` hears nothing of `whom` any more, who still hears `who`."""

    who: str
    whom: str


@dataclass(frozen=True, slots=True)
class Delay:
    """The operator's frames come so late from now on, also when the robot has stopped for that."""

    delay_ms: float


@dataclass(frozen=True, slots=True)
class Abandon:
    """The operator's process ends, whose frames have been late by so much all the time."""

    late_ms: float


@dataclass(frozen=True, slots=True)
class Double:
    """A second robot of the same name appears, as when a network that was cut is whole again."""


@dataclass(frozen=True, slots=True)
class Exaggerate:
    """Frames that can be read, with the least and the greatest values of every field."""


@dataclass(frozen=True, slots=True)
class Sense:
    """A fault of the robot's body, by the names of a world file's [[fault]]."""

    kind: str
    target: str = ""
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Wrap:
    """Both encoder counters pass the end of their 32 bits on the way."""


@dataclass(frozen=True, slots=True)
class Jump:
    """The robot's clock jumps."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Break:
    """The control core raises an exception."""


@dataclass(frozen=True, slots=True)
class EmergencyStop:
    """The operator's."""


@dataclass(frozen=True, slots=True)
class Fill:
    """No more room on the disk for this process, while a parameter is set."""

    role: str


@dataclass(frozen=True, slots=True)
class Slow:
    """Each fsync of the robot takes so long from now on.

    A parameter is set, and a mission and a fence are sent, in turn until the robot has arrived.
    """

    fsync_s: float


@dataclass(frozen=True, slots=True)
class Unplug:
    """The power is cut while a parameter and the fence are saved, on a disk that reorders."""


@dataclass(frozen=True, slots=True)
class Spoil:
    """The robot is killed, and its saved fence cannot be read when it is started again."""


@dataclass(frozen=True, slots=True)
class Flood:
    """An attack of `bench flood`, by its kind; `pressed`: the operator presses the stop in it."""

    kind: str
    pressed: bool = False


@dataclass(frozen=True, slots=True)
class Squeeze:
    """The robot gets no more memory than it has."""


@dataclass(frozen=True, slots=True)
class Burn:
    """As many processes as the machine has cores do nothing but use the processor."""


Act: TypeAlias = (
    Kill
    | Hang
    | Cut
    | Impersonate
    | Disturb
    | Deafen
    | Delay
    | Abandon
    | Double
    | Exaggerate
    | Sense
    | Wrap
    | Jump
    | Break
    | EmergencyStop
    | Fill
    | Slow
    | Spoil
    | Unplug
    | Flood
    | Squeeze
    | Burn
)
