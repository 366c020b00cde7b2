"""The faults that can be caused in a running stack, as data without behaviour."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import TypeAlias

from checks.board.fault import BoardFault
from protocol.bus.link_faults import LinkFaults


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
