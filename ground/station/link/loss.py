"""Classify losses into six kinds, and describe the cause and the robot's own response in words."""

from enum import Enum
from typing import Final, NamedTuple

from ground.station.robot.lease_state import LeaseView
from ground.text.wording import driving
from protocol.bus.network import Hub
from protocol.topics import HEARTBEAT
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.limits import MAX_WHEEL_TTL_MS, SCAN_LOST_MS, TICKS_LOST_MS
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_MS, NS_PER_S

DEAD_NS: Final = 400 * NS_PER_MS
"""Two heartbeats missed."""
CUT_NS: Final = 1_500 * NS_PER_MS
"""After this time the transport has noticed a cut cable: its lease is 1 s."""
SENSES_NS: Final = SCAN_LOST_MS * NS_PER_MS
BEHIND_NS: Final = 200 * NS_PER_MS


class LossKind(Enum):
    """Kinds of loss by rank: an earlier one explains the later ones."""

    ROUTER_GONE = "ROUTER GONE"
    TRANSPORT = "LINK LOST"
    PROCESS_DEAD = "ROBOT DEAD"
    HUNG = "ROBOT HUNG"
    SENSES_STALE = "SENSES STALE"
    OTHER_OPERATOR = "OTHER OPERATOR"


class Loss(NamedTuple):
    """A loss: its `cause`, the robot's own `response`, and when it began."""

    kind: LossKind
    robot: str
    cause: str
    response: str
    since_ns: int

    @property
    def words(self) -> str:
        """Cause and response in words."""
        return f"{self.cause}; {self.response}"

    def banner(self, now_ns: int) -> str:
        """Return the whole line: kind, robot, duration, cause and response."""
        seconds = (now_ns - self.since_ns) / NS_PER_S
        return f"{self.kind.value} {self.robot} {seconds:.1f} s: {self.words}"


class LossInputs(NamedTuple):
    """Inputs of the classification; ages in ns, None for never."""

    watched_ns: int
    """Time since the start of monitoring: the age of anything that never arrived."""
    hub: Hub | None = None
    hub_ns: int | None = None
    """Time since the hub was checked."""
    by_router: bool = False
    """True if the last link was established by a router."""
    kept_out: bool = False
    """True if the peer rejects this station."""
    gone_ns: int | None = None
    """Time since the robot's token disappeared; None while it is present."""
    heartbeat_ns: int | None = None
    status_ns: int | None = None
    """Age of the newest status, which is more frequent than heartbeats."""
    others_ns: int | None = None
    """Age of the newest frame of any process other than the robot and operators."""
    senses_ns: int | None = None
    """Age of the older one of scan and wheel ticks."""
    senses_missing: bool = False
    """True if the robot reports missing sensor data."""
    other_operator: bool = False

    def age_ns(self, age_ns: int | None) -> int:
        """Return an age, or the time of monitoring for None."""
        return self.watched_ns if age_ns is None else age_ns

    @property
    def alive_ns(self) -> int:
        """Age of the newest message of the robot's loop; any message counts as a heartbeat."""
        return min(self.age_ns(self.heartbeat_ns), self.age_ns(self.status_ns))

    @property
    def received_ns(self) -> int:
        """Age of the newest frame of any process."""
        return min(self.alive_ns, self.age_ns(self.others_ns))

    @property
    def senses_are_stale(self) -> bool:
        """True if the loop runs without sensor data; data that stop with it do not count."""
        senses_ns = self.age_ns(self.senses_ns)
        behind_ns = senses_ns - self.age_ns(self.status_ns)
        return self.senses_missing or (senses_ns > SENSES_NS and behind_ns > BEHIND_NS)

    def linked_since(self, ago_ns: int) -> bool:
        """Return whether the link was found intact more recently than that."""
        return self.hub_ns is not None and self.hub_ns < ago_ns


def classify(inputs: LossInputs) -> LossKind | None:
    """Return the first kind that applies; None for no loss or while the cause is still open."""
    if inputs.hub is not None and not inputs.hub.linked and not _received_since(inputs):
        return _unlinked(inputs, inputs.hub)
    heartbeat_ns = inputs.alive_ns
    if inputs.gone_ns is not None and heartbeat_ns > DEAD_NS:
        known = _others_received(inputs) or inputs.linked_since(inputs.gone_ns)
        return LossKind.PROCESS_DEAD if known else None
    if heartbeat_ns > HEARTBEAT.stale_after_ns:
        known = _others_received(inputs) or inputs.linked_since(inputs.received_ns - CUT_NS)
        return LossKind.HUNG if known else None
    if inputs.senses_are_stale:
        return LossKind.SENSES_STALE
    return LossKind.OTHER_OPERATOR if inputs.other_operator else None


def _received_since(inputs: LossInputs) -> bool:
    """Return whether a frame arrived since the hub was checked: then the link is intact."""
    return inputs.hub_ns is not None and inputs.received_ns < inputs.hub_ns


def _others_received(inputs: LossInputs) -> bool:
    """Return whether another process was received since the robot became silent."""
    if inputs.others_ns is None or inputs.others_ns > HEARTBEAT.stale_after_ns:
        return False
    return inputs.alive_ns - inputs.others_ns > BEHIND_NS


def _unlinked(inputs: LossInputs, hub: Hub) -> LossKind:
    if hub is Hub.UNREACHABLE or inputs.kept_out:
        return LossKind.TRANSPORT
    if inputs.by_router:
        return LossKind.ROUTER_GONE
    return LossKind.HUNG if hub is Hub.HANGS else LossKind.PROCESS_DEAD


class RobotKnowledge(NamedTuple):
    """Knowledge of the robot at the time of the loss."""

    robot: str
    hub: Hub | None
    linked_by_robot: bool
    kept_out: str
    plant_there: bool
    status: NavigatorStatus | None
    lease: LeaseView
    op_lost_ms: float | None
    """The robot's parameter of this name; None while it is unknown."""


def cause_of(kind: LossKind, known: RobotKnowledge) -> str:
    """Describe what happened, as far as the station can know."""
    robot = known.robot
    match kind:
        case LossKind.ROUTER_GONE if known.hub is Hub.HANGS:
            return "the router accepts connections but does not answer"
        case LossKind.ROUTER_GONE:
            return "the router has exited; reconnecting"
        case LossKind.TRANSPORT if known.kept_out:
            return known.kept_out
        case LossKind.TRANSPORT:
            return "no data arrive: the network is interrupted; reconnecting"
        case LossKind.PROCESS_DEAD if known.status is None:
            return f"no process of {robot} is running"
        case LossKind.PROCESS_DEAD if known.linked_by_robot:
            return f"the process of {robot} has exited"
        case LossKind.PROCESS_DEAD:
            return f"the process of {robot} has exited or is suspended, or its link is interrupted"
        case LossKind.HUNG:
            return f"the process of {robot} runs, but its control loop does not (no heartbeat)"
        case LossKind.SENSES_STALE:
            cause = "no data from its sonars or wheels" if known.plant_there else "no plant"
            return f"{robot} runs without sensor data: {cause}"
        case LossKind.OTHER_OPERATOR:
            return f"read-only: {known.lease.words} is in command"


def response_of(kind: LossKind, known: RobotKnowledge) -> str:
    """Describe what the robot does now without this station, and after which time."""
    match kind:
        case LossKind.ROUTER_GONE | LossKind.TRANSPORT:
            return _without_operator(known.status, known.op_lost_ms)
        case LossKind.PROCESS_DEAD if known.status is None:
            return "the state of the robot is unknown"
        case LossKind.PROCESS_DEAD | LossKind.HUNG:
            after = f"{MAX_WHEEL_TTL_MS} ms"
            return f"its motor driver stops the wheels {after} after the last command"
        case LossKind.SENSES_STALE:
            return _without_senses(known.status)
        case LossKind.OTHER_OPERATOR:
            return "hold, abort, disarm and E-STOP work. Take over: `lease seize`"


def end_of(robot: str, kind: LossKind, gap_ns: int, *, ours: bool = False) -> str:
    """Report the end of a loss and its duration; `ours`: this station holds the lease now."""
    after = f"after {gap_ns / NS_PER_MS / 1000:.1f} s"
    if kind is LossKind.OTHER_OPERATOR:
        return f"you command {robot}" if ours else f"nobody commands {robot} any more {after}"
    return f"{robot} is back {after} ({kind.value})"


def _without_operator(status: NavigatorStatus | None, op_lost_ms: float | None) -> str:
    """Describe a robot that no longer receives its operator's heartbeat."""
    if status is None:
        return "the state of the robot is unknown"
    if status.vehicle != Vehicle.ACTIVE:
        return "it was stopped and stays stopped"
    if status.mode in (Mode.AUTO, Mode.SMART_RTL):
        return f"it continues in {Mode(status.mode).name}, which needs no operator"
    if status.mode == Mode.HOLD:
        return "it holds"
    if status.mode == Mode.GUIDED and not driving(status):
        return "it has no goal and does not move"
    if op_lost_ms is None:
        return (
            "failsafe: it stops without its operator, after an unknown time (op_lost_ms not read)"
        )
    return f"failsafe: it stops {op_lost_ms / 1000:g} s after the last heartbeat of its operator"


def _without_senses(status: NavigatorStatus | None) -> str:
    if status is not None and status.vehicle == Vehicle.FAILSAFE:
        return f"failsafe: it is stopped ({reason_text(status.vehicle_reason)})"
    if status is not None and status.vehicle != Vehicle.ACTIVE:
        reason = status.vehicle_reason
        reason_words = f" ({reason_text(reason)})" if reason != Reason.NONE else ""
        return f"it is stopped{reason_words}"
    return f"failsafe: it stops {min(SCAN_LOST_MS, TICKS_LOST_MS)} ms after its last sensor data"
