"""Explain the decision of one tick as a headline and lines of numbers."""

from collections.abc import Iterator
from math import isfinite
from typing import Final, NamedTuple

from ground.explain.headline import headline
from ground.explain.names import (
    ZONES,
    because,
    branch_words,
    goal_words,
    mode_words,
    navigator_words,
    vehicle_words,
)
from ground.explain.turning import changes
from ground.text.state_roles import present_reason
from ground.text.wording import (
    NONE,
    echo,
    heading_deg,
    left_or_right,
    metres,
    place,
    short,
    side,
)
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus
from protocol.wire.reasons import reason_text
from runtime.units import NS_PER_S

NAMES: Final = 9


class Explanation(NamedTuple):
    """An explanation; each line starts with a name, padded to a common width."""

    headline: str
    lines: tuple[str, ...]

    def text(self) -> str:
        """Return headline and lines as text."""
        return "\n".join((self.headline, *(f"  {line}" for line in self.lines)))


def explain(
    decision: AvoidanceDecision | None,
    status: NavigatorStatus | None,
    cycle: CycleReport | None = None,
    previous: AvoidanceDecision | None = None,
) -> Explanation:
    """Explain the decision of one tick; `previous` is the decision before it.

    None and values that are not numbers are shown as missing, unknown states as their numbers.
    """
    found: list[tuple[str, str]] = []
    if decision is not None:
        found += seen(decision, status)
        found += chosen(decision)
    if status is not None:
        found.append(("state", state(status)))
    if cycle is not None:
        found.append(("cycle", cost(cycle)))
    if decision is not None and previous is not None:
        found.append(("changed", changed(previous, decision)))
    lines = tuple(f"{name:<{NAMES}}{text}" for name, text in found)
    return Explanation(headline(decision, status), lines)


def seen(decision: AvoidanceDecision, status: NavigatorStatus | None) -> Iterator[tuple[str, str]]:
    """Yield what the robot detected and where."""
    yield "nearest", echo(decision.nearest_range_m, decision.nearest_bearing_rad)
    yield "zone", zone(decision, status)
    away = NONE if status is None else metres(status.goal_distance_m)
    yield "goal", f"{side(decision.goal_bearing_rad)}, {away} to go"


def zone(decision: AvoidanceDecision, status: NavigatorStatus | None) -> str:
    """Describe the avoidance zone, and whether the nearest echo is in it."""
    if not isfinite(decision.zone_m):
        return "none" if status is None else f"not used by {navigator_words(status.navigator)}"
    name = "" if status is None else ZONES.get(status.navigator, "")
    words = f"{name} {metres(decision.zone_m)}".strip()
    if decision.nearest_range_m < decision.zone_m:
        return f"{words}, nearest echo inside"
    if decision.nearest_range_m >= decision.zone_m:
        return f"{words}, empty"
    return f"{words}, occupancy not reported"


def chosen(decision: AvoidanceDecision) -> Iterator[tuple[str, str]]:
    """Yield what the navigator chose."""
    yield "branch", branch_words(decision.branch)
    yield "rotation", rotation(decision.rotation_rad)
    yield "virtual", virtual(decision)
    yield "guard", guard(decision)


def rotation(rotation_rad: float) -> str:
    """Describe the paper's gamma: the angle by which the goal is rotated about the robot."""
    angle_deg = heading_deg(rotation_rad)
    if angle_deg is None:
        return NONE
    if round(abs(angle_deg), 1) == 0.0:
        return "gamma 0°: straight to the goal"
    turned = f"{abs(angle_deg):.0f}° {left_or_right(angle_deg)}"
    return f"gamma {angle_deg:+z.0f}°: heading {turned} of the goal"


def virtual(decision: AvoidanceDecision) -> str:
    """Describe the virtual goal and its bearing from the robot."""
    if decision.rotation_rad == 0.0:
        return "the goal itself"
    where = side(decision.goal_bearing_rad + decision.rotation_rad)
    return f"{place(decision.virtual_x_m, decision.virtual_y_m)}, {where}"


def guard(decision: AvoidanceDecision) -> str:
    """Describe what the guard removed and why; of the speed only the rest is known."""
    if not decision.guard:
        return "no speed limit"
    left_m_s = decision.speed_m_s
    all_of_it = left_m_s == 0.0 and decision.yaw_rate_rad_s == 0.0
    kept = f"{short(left_m_s)} m/s" if isfinite(left_m_s) else "unknown"
    took = "stopped the robot" if all_of_it else f"limited the speed to {kept}"
    return f"{took}: {reason_text(decision.guard)}"


def state(status: NavigatorStatus) -> str:
    """Return vehicle state, mode, goal state and navigator, with the present reason."""
    names = (vehicle_words(status.vehicle), mode_words(status.mode), goal_words(status.goal))
    words = f"{' '.join(names)}, {navigator_words(status.navigator)}"
    return because(words, present_reason(status))


def cost(cycle: CycleReport) -> str:
    """Describe the cost of the tick: a late decision may look like a wrong one."""
    words = f"{sum(cycle.stage_us)} of {cycle.budget_us} us, {cycle.late_us / 1000:.3g} ms late"
    words += f", senses {cycle.sense_age_us / 1000:.3g} ms old"
    return f"{words}, {cycle.missed} ticks missed" if cycle.missed else words


def changed(previous: AvoidanceDecision, decision: AvoidanceDecision) -> str:
    """Describe the changes since the previous decision."""
    found = changes(previous, decision)
    since_s = (decision.time_ns - previous.time_ns) / NS_PER_S
    return f"{'; '.join(found) if found else 'nothing'} (within {since_s:.3g} s)"
