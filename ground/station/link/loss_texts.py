"""What each loss means, in words: what has happened, and what the robot does now by itself."""

from typing import NamedTuple

from ground.station.link.loss import LossKind
from ground.station.robot.lease_state import Lease
from protocol.bus.network import Hub
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.limits import (
    MAX_LEASE_MS,
    MAX_WHEEL_TTL_MS,
    OPERATOR_LOST_MS,
    SCAN_LOST_MS,
    TICKS_LOST_MS,
)
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_MS


class Known(NamedTuple):
    """What was known of the robot when it was lost."""

    robot: str
    hub: Hub | None
    linked_by_robot: bool
    kept_out: str
    plant_there: bool
    status: NavigatorStatus | None
    lease: Lease


def what(kind: LossKind, known: Known) -> str:
    """What has happened, as far as it can be told from here."""
    robot = known.robot
    match kind:
        case LossKind.ROUTER_GONE if known.hub is Hub.HANGS:
            return "the router takes calls but hangs"
        case LossKind.ROUTER_GONE:
            return "the router has ended; dialling it again"
        case LossKind.TRANSPORT if known.kept_out:
            return known.kept_out
        case LossKind.TRANSPORT:
            return "nothing comes back: the network in between is cut; dialling again"
        case LossKind.PROCESS_DEAD if known.status is None:
            return f"no process of {robot} is there"
        case LossKind.PROCESS_DEAD if known.linked_by_robot:
            return f"the process of {robot} has ended"
        case LossKind.PROCESS_DEAD:
            return f"the process of {robot} has ended or is stopped, or its own link is cut"
        case LossKind.HUNG:
            return f"the process of {robot} is there, its control loop does not run (no heartbeat)"
        case LossKind.SENSES_STALE:
            cause = "its sonars or wheels are not heard" if known.plant_there else "no plant"
            return f"{robot} beats but is without senses: {cause}"
        case LossKind.OTHER_OPERATOR:
            return f"{known.lease.words} holds the lease; commands are refused, e-stop is not"


def does(kind: LossKind, known: Known) -> str:
    """What the robot does now, without us, and after how long."""
    match kind:
        case LossKind.ROUTER_GONE | LossKind.TRANSPORT:
            return _unheard(known.status)
        case LossKind.PROCESS_DEAD if known.status is None:
            return "what the robot does is not known"
        case LossKind.PROCESS_DEAD | LossKind.HUNG:
            after = f"{MAX_WHEEL_TTL_MS} ms"
            return f"its motor driver stops the wheels {after} after the last command"
        case LossKind.SENSES_STALE:
            return _blind(known.status)
        case LossKind.OTHER_OPERATOR:
            after = f"{MAX_LEASE_MS / 1000:g} s"
            return f"the lease lapses {after} after its holder falls silent"


def ended(robot: str, kind: LossKind, gap_ns: int) -> str:
    """It is over, and how long it was."""
    after = f"after {gap_ns / NS_PER_MS / 1000:.1f} s"
    if kind is LossKind.OTHER_OPERATOR:
        return f"the lease of {robot} is free again {after}"
    return f"{robot} is back {after} ({kind.value})"


def _unheard(status: NavigatorStatus | None) -> str:
    """What a robot does whose operator is not heard any more."""
    if status is None:
        return "what the robot does is not known"
    if status.vehicle != Vehicle.ACTIVE:
        return "it stood when last heard, and stays so"
    if status.mode in (Mode.AUTO, Mode.SMART_RTL):
        return f"it goes on in {Mode(status.mode).name}, which needs no operator"
    if status.mode == Mode.HOLD:
        return "it holds"
    if status.mode == Mode.GUIDED and not driving(status):
        return "it had no goal and stands"
    return f"failsafe: it stops {OPERATOR_LOST_MS / 1000:g} s after our last beat"


def driving(status: NavigatorStatus) -> bool:
    return GoalState.ACCEPTED <= status.goal <= GoalState.ALIGNING


def _blind(status: NavigatorStatus | None) -> str:
    if status is not None and status.vehicle == Vehicle.FAILSAFE:
        return f"failsafe: it stands ({reason_text(status.vehicle_reason)})"
    if status is not None and status.vehicle != Vehicle.ACTIVE:
        reason = status.vehicle_reason
        said = f" ({reason_text(reason)})" if reason != Reason.NONE else ""
        return f"it stands{said}"
    return f"failsafe: it stops {min(SCAN_LOST_MS, TICKS_LOST_MS)} ms after its last senses"
