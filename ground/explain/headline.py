"""Write one line: what the robot does with its wheels, and why."""

from math import copysign, degrees, isfinite
from typing import Final

from ground.explain.names import ENDS, VEHICLES, because, branch_words
from ground.text.state_roles import present_reason
from ground.text.wording import NONE, echo, heading_deg, left_or_right, metres, short, side
from protocol.wire.enums import Branch, GoalState, Mode, Vehicle
from protocol.wire.messages import AvoidanceDecision, NavigatorStatus
from protocol.wire.reasons import reason_text

TURNS_DEG_S: Final = 2.0
"""A lower yaw rate is no turn."""

MOVES_M_S: Final = 0.005
ASIDE_DEG: Final = 3.0
CLOSE_M: Final = 0.1  # a farther echo does not change the heading
BENT_DEG: Final = 1.0
PASSES: Final = (Branch.PASS_LEFT, Branch.PASS_RIGHT)


def headline(decision: AvoidanceDecision | None, status: NavigatorStatus | None) -> str:
    """Return the headline; it starts with the motion, which can be observed."""
    if decision is None:
        return "its decision is unknown"
    return f"{motion(decision)}: {cause(decision, status)}"


def motion(decision: AvoidanceDecision) -> str:
    """Describe the wheel command of this tick."""
    speed_m_s, yaw_deg_s = decision.speed_m_s, degrees(decision.yaw_rate_rad_s)
    if not (isfinite(speed_m_s) and isfinite(yaw_deg_s)):
        return "moves in an unknown way"
    creeps = abs(speed_m_s) < MOVES_M_S
    if abs(yaw_deg_s) >= TURNS_DEG_S:
        spot = " on the spot" if creeps else ""
        return f"turns {left_or_right(yaw_deg_s)}{spot} {short(abs(yaw_deg_s))}°/s"
    if creeps:
        return "does not move"
    return f"drives straight {'on' if speed_m_s > 0.0 else 'back'} at {short(abs(speed_m_s))} m/s"


def cause(decision: AvoidanceDecision, status: NavigatorStatus | None) -> str:
    """Return the outermost reason: state before mode, mode before goal, goal before avoidance."""
    outer = "" if status is None else of_the_state(status)
    by_hand = status is not None and status.vehicle == Vehicle.ACTIVE and status.mode == Mode.MANUAL
    guarded = of_the_guard(decision) if by_hand or not outer else ""
    return guarded or outer or of_the_branch(decision, status)


def of_the_state(status: NavigatorStatus) -> str:
    """Describe why the robot does not drive to a goal by itself; empty while it does."""
    if status.vehicle != Vehicle.ACTIVE:
        what = VEHICLES.get(status.vehicle, f"vehicle {status.vehicle}")
        return because(what, status.vehicle_reason)
    if status.mode == Mode.MANUAL:
        return "it is driven by hand"
    if status.mode == Mode.HOLD:
        return because("it holds on request", status.vehicle_reason)
    if status.goal in ENDS:
        return because(ENDS[status.goal], present_reason(status))
    return ""


def of_the_guard(decision: AvoidanceDecision) -> str:
    """Describe a guard that removed all speed; otherwise return an empty text."""
    stands = decision.speed_m_s == 0.0 and decision.yaw_rate_rad_s == 0.0
    if not (decision.guard and stands):
        return ""
    near = echo(decision.nearest_range_m, decision.nearest_bearing_rad)
    return reason_text(decision.guard) + ("" if near == NONE else f", {near}")


def of_the_branch(decision: AvoidanceDecision, status: NavigatorStatus | None) -> str:
    """Describe the branch of the navigator."""
    if decision.branch == Branch.NONE:
        return "idle" if status is None else settling(status)
    if decision.branch == Branch.ALIGN:
        return f"it is at the goal, whose heading is {side(decision.goal_bearing_rad)}"
    if decision.branch == Branch.GIVE_UP:
        return "a closed boundary separates it from the goal"
    if decision.branch == Branch.LOST:
        return "it finds neither a way to the goal nor a proof that there is none"
    if decision.branch in PASSES:
        return passing(decision) + swinging(decision)
    if decision.branch == Branch.TO_GOAL:
        return going(decision, status) + bending(decision, status)
    return f"it {branch_words(decision.branch)}"


def settling(status: NavigatorStatus) -> str:
    """Describe a robot with a goal and no decision: it has not started, or it has arrived."""
    if status.goal == GoalState.ACCEPTED:
        return "it has a new goal and sets off"
    away = far(status.goal_distance_m)
    return f"arrived, stopping{away}"


def passing(decision: AvoidanceDecision) -> str:
    """Describe how the robot passes the nearest obstacle on the way to the virtual goal."""
    near = echo(decision.nearest_range_m, decision.nearest_bearing_rad)
    near = "the nearest echo is unknown" if near == NONE else near
    wanted = side(decision.goal_bearing_rad + decision.rotation_rad)
    return f"{near}, so it {branch_words(decision.branch)}, heading {wanted}"


def going(decision: AvoidanceDecision, status: NavigatorStatus | None) -> str:
    """Describe the way to the goal, possibly with a small offset from a flank."""
    home = status is not None and status.mode == Mode.SMART_RTL
    what = "next point of its trail" if home else "goal"
    away = "" if status is None or home else far(status.goal_distance_m)
    words = f"{what} {side(decision.goal_bearing_rad)}{away}"
    bent_deg = heading_deg(decision.rotation_rad)
    if bent_deg is None or abs(bent_deg) < BENT_DEG:
        return words
    if decision.nearest_range_m < CLOSE_M:
        return f"{words}, and it turns away from a close obstacle, {side(decision.rotation_rad)}"
    return f"{words}, and it weaves to see edges ahead, now {side(decision.rotation_rad)}"


def far(distance_m: float) -> str:
    """Return the distance to go, or an empty text."""
    away = metres(distance_m)
    return "" if away == NONE else f", {away} to go"


def swinging(decision: AvoidanceDecision) -> str:
    """Mention a turn in the other direction, which takes some ticks to reverse."""
    return ", still swinging from before" if contrary(decision) else ""


def bending(decision: AvoidanceDecision, status: NavigatorStatus | None) -> str:
    """Mention the bend near the end of a path, which leads into the final heading."""
    if not contrary(decision):
        return ""
    if status is not None and isfinite(status.goal_heading_rad):
        return ", on a bend into its final heading"
    return swinging(decision)


def contrary(decision: AvoidanceDecision) -> bool:
    """Return whether the robot turns away from its wanted direction."""
    wanted_deg = heading_deg(decision.goal_bearing_rad + decision.rotation_rad)
    yaw_deg_s = degrees(decision.yaw_rate_rad_s)
    if wanted_deg is None or not abs(yaw_deg_s) >= TURNS_DEG_S or abs(wanted_deg) < ASIDE_DEG:
        return False
    return copysign(1.0, wanted_deg) != copysign(1.0, yaw_deg_s)
