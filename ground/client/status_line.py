"""The state of a robot as the parts of one line; outdated values are marked or left out."""

from collections.abc import Callable
from math import degrees, isfinite
from typing import Any, Final, TypeVar

from ground.client.telemetry import Age, Telemetry
from ground.text.wording import Part, driving, present_reason
from protocol.outcome import goal_end, reason_words
from protocol.topics import CYCLE, DECISION, HEARTBEAT, ODOMETRY, STATUS, Topic
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import NavigatorStatus, PlanarOdometry
from protocol.wire.reasons import Reason
from runtime.cli.terminal import printable
from runtime.units import NS_PER_S

NONE: Final = "--"
PLACE_UNKNOWN: Final = "PLACE UNKNOWN"
SILENT_NS: Final = 700_000_000

M = TypeVar("M", bound=Message)


def goal_line(
    telemetry: Telemetry, now_ns: int, silent_ns: int, goal_id: int | None = None
) -> list[Part]:
    """Return state, distance, speed, nearest echo, time so far and reason, for a running goal.

    With `goal_id`, a status about another goal is not shown.
    """
    if silent_ns > SILENT_NS:
        return [Part(f"no message from the robot for {silent_ns / NS_PER_S:.1f} s")]
    status = telemetry.live(STATUS, now_ns)
    if status is None:
        return [Part("waiting for the robot's status")]
    if goal_id is not None and status.goal_id != goal_id:
        return [Part("waiting for the robot to show this goal")]
    odometry = telemetry.live(ODOMETRY, now_ns)
    decision = telemetry.live(DECISION, now_ns)
    to_go = metres(status.goal_distance_m)
    echo = NONE if decision is None else echo_of(decision.nearest_range_m)
    return [
        Part(f"{doing(status):<8}"),
        Part(f"{to_go} to go", to_go),
        Part(f"{NONE if odometry is None else f'{odometry.speed_m_s:z.2f}'} m/s"),
        Part(f"echo {echo}", f"echo {echo.removesuffix(' m')}"),
        Part(since_set(status)),
        Part(reason_of(status)),
    ]


def short_line(telemetry: Telemetry, robot: str, now_ns: int) -> Part:
    """Return state and distance, for a line that shows several robots."""
    status = telemetry.live(STATUS, now_ns)
    if status is None:
        return Part(f"{robot} {NONE}")
    to_go = metres(status.goal_distance_m)
    return Part(f"{robot} {doing(status)} {to_go}", f"{robot} {to_go}")


def watch_line(telemetry: Telemetry, now_ns: int) -> list[Part]:
    """Return state, pose, goal, nearest echo, cost of a cycle and heartbeat, for an observer."""

    def part(topic: Topic[M], name: str, words: Callable[[M], str]) -> Part:
        return aged(telemetry, topic, now_ns, name, words)

    return [
        part(STATUS, "state", lambda status: f"{state_of(status)} {reason_of(status)}".rstrip()),
        part(ODOMETRY, "pose", pose_of),
        part(STATUS, "goal", lambda status: f"goal {metres(status.goal_distance_m)}"),
        part(DECISION, "echo", lambda decision: f"echo {echo_of(decision.nearest_range_m)}"),
        part(CYCLE, "cycle", lambda cycle: f"cycle {sum(cycle.stage_us)} us"),
        part(HEARTBEAT, "heartbeat", lambda _: "heartbeat ok"),
    ]


def aged(
    telemetry: Telemetry, topic: Topic[Any], now_ns: int, name: str, words: Callable[[Any], str]
) -> Part:
    """Return a value while it is live, with its age while it fades, then only the age."""
    seen = telemetry.seen(topic, now_ns)
    if seen.message is None or seen.age_ns is None:
        return Part(f"{name} {NONE}")
    age_s = seen.age_ns / NS_PER_S
    if seen.age is Age.GONE:
        return Part(f"{name} {NONE} ({age_s:.1f} s)")
    return Part(words(seen.message), age_s=None if seen.age is Age.LIVE else age_s)


def doing(status: NavigatorStatus) -> str:
    """Return the robot's activity in one word."""
    if status.vehicle != Vehicle.ACTIVE:
        return name_of(Vehicle, status.vehicle).lower().replace("_", " ")
    if status.mode in (Mode.HOLD, Mode.MANUAL):
        return Mode(status.mode).name.lower()
    given_up = goal_end(status.goal, status.goal_reason) if status.goal == GoalState.STUCK else ""
    return given_up or name_of(GoalState, status.goal).lower()


def since_set(status: NavigatorStatus) -> str:
    """Return the time since the goal was set, held time included, by the robot's clock."""
    if not status.goal_id:
        return ""
    until_ns = status.goal_ended_ns or status.time_ns
    return f"{(until_ns - status.goal_started_ns) / NS_PER_S:.0f} s"


def state_of(status: NavigatorStatus) -> str:
    """Return the names of vehicle state, mode and goal state; an unknown number stays a number.

    A goal under way that the mode does not drive to is kept.
    """
    vehicle, mode = name_of(Vehicle, status.vehicle), name_of(Mode, status.mode)
    is_kept = status.mode == Mode.HOLD and driving(status)
    return f"{vehicle} {mode} {'goal kept' if is_kept else name_of(GoalState, status.goal)}"


def name_of(kind: type[Vehicle] | type[Mode] | type[GoalState], number: int) -> str:
    """Return the name of an enumeration's member, or its number if unknown."""
    try:
        return kind(number).name
    except ValueError:
        return f"{kind.__name__} {number}"


def reason_of(status: NavigatorStatus) -> str:
    """Return the reason of the present state in parentheses, empty if there is none."""
    reason = present_reason(status)
    if reason == Reason.NONE and status.mode == Mode.HOLD and status.held_by:
        return f"(held by {printable(status.held_by)})"
    return "" if reason == Reason.NONE else f"({reason_words(reason, status.ended_by)})"


def pose_of(odometry: PlanarOdometry) -> str:
    """Return position (m) and heading (degrees) in words."""
    if not knows_place(odometry):
        return PLACE_UNKNOWN
    x_m, y_m = odometry.x_m, odometry.y_m
    heading_rad = odometry.heading_rad
    heading = f"{round(degrees(heading_rad))}" if isfinite(heading_rad) else NONE
    return f"pose {x_m:z.2f} {y_m:z.2f} {heading} deg"


def knows_place(odometry: PlanarOdometry) -> bool:
    """Return whether the robot knows where it is; without a place it has no covariance."""
    return isfinite(odometry.cov_xx_m2 + odometry.cov_yy_m2 + odometry.cov_hh_rad2)


def metres(value: float) -> str:
    """Return a distance in words, `--` if it is not finite."""
    return f"{value:z.2f} m" if isfinite(value) else NONE


def echo_of(range_m: float) -> str:
    """Return the range of an echo in words: infinity means none, NaN means missing."""
    return "none" if range_m == float("inf") else metres(range_m)
