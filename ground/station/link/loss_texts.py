"""Describe each loss in words: its cause and the robot's own response."""

from typing import NamedTuple

from ground.station.link.loss import LossKind
from ground.station.robot.lease_state import LeaseView
from ground.text.status_parts import driving
from protocol.bus.network import Hub
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.limits import (
    MAX_WHEEL_TTL_MS,
    SCAN_LOST_MS,
    TICKS_LOST_MS,
)
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_MS


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
