"""One line that says how it stands; what is old is not shown as if it were new."""

from math import degrees, isfinite
from typing import Final

from ground.telemetry import Age, Telemetry
from protocol.enums import GoalState, Mode, Vehicle
from protocol.messages import NavigatorStatus, PlanarOdometry
from protocol.reasons import Reason, reason_text
from protocol.topics import CYCLE, DECISION, HEARTBEAT, ODOMETRY, STATUS

NONE: Final = "--"
LOUD_NS: Final = 700_000_000


def goal_line(telemetry: Telemetry, now_ns: int, silent_ns: int) -> str:
    """For who waits for a goal: distance, state, reason, speed."""
    if silent_ns > LOUD_NS:
        return f"nothing heard of the robot for {silent_ns / 1e9:.1f} s"
    status = telemetry.live(STATUS, now_ns)
    odometry = telemetry.live(ODOMETRY, now_ns)
    if status is None:
        return "waiting for the robot's status"
    return "  ".join(
        part
        for part in (
            f"{metres(status.goal_distance_m)} to go",
            state_of(status),
            reason_of(status),
            f"{NONE if odometry is None else f'{odometry.speed_m_s:.2f}'} m/s",
        )
        if part
    )


def watch_line(telemetry: Telemetry, now_ns: int) -> str:
    """For who watches: state, pose, goal, nearest echo, cycle time, and the ages of old streams."""
    status = telemetry.live(STATUS, now_ns)
    decision = telemetry.live(DECISION, now_ns)
    cycle = telemetry.live(CYCLE, now_ns)
    spent = NONE if cycle is None else f"{sum(cycle.stage_us)} us"
    parts = (
        NONE if status is None else f"{state_of(status)} {reason_of(status)}".rstrip(),
        pose_of(telemetry.live(ODOMETRY, now_ns)),
        f"goal {NONE if status is None else metres(status.goal_distance_m)}",
        f"echo {NONE if decision is None else metres(decision.nearest_range_m)}",
        f"cycle {spent}",
        ages(telemetry, now_ns),
    )
    return "  ".join(part for part in parts if part)


def ages(telemetry: Telemetry, now_ns: int) -> str:
    """Streams that are late or silent, with their age; empty when all are live."""
    late = []
    for topic in (HEARTBEAT, STATUS, ODOMETRY, DECISION, CYCLE):
        seen = telemetry.seen(topic, now_ns)
        if seen.age is not Age.LIVE:
            name = topic.path.rpartition("/")[2]
            late.append(f"{name} {NONE if seen.age_ns is None else f'{seen.age_ns / 1e9:.1f} s'}")
    return f"[old: {', '.join(late)}]" if late else ""


def state_of(status: NavigatorStatus) -> str:
    """Vehicle, mode and goal in words; a number this version does not know stays a number."""
    vehicle = name_of(Vehicle, status.vehicle)
    mode, goal = name_of(Mode, status.mode), name_of(GoalState, status.goal)
    return f"{vehicle} {mode} {goal}"


def name_of(kind: type[Vehicle] | type[Mode] | type[GoalState], number: int) -> str:
    try:
        return kind(number).name
    except ValueError:
        return f"{kind.__name__} {number}"


def reason_of(status: NavigatorStatus) -> str:
    reason = status.vehicle_reason or status.goal_reason
    return "" if reason == Reason.NONE else f"({reason_text(reason)})"


def pose_of(odometry: PlanarOdometry | None) -> str:
    if odometry is None:
        return f"pose {NONE}"
    x_m, y_m = odometry.x_m, odometry.y_m
    return f"pose {x_m:.2f} {y_m:.2f} {degrees(odometry.heading_rad):.0f} deg"


def metres(value: float) -> str:
    """A distance; no number is missing, infinity is no echo."""
    if value == float("inf"):
        return "none"
    return f"{value:.2f} m" if isfinite(value) else NONE
