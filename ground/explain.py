"""Explain the decision of one tick as a headline and lines of numbers, and find turning points.

The headline says what the robot does with its wheels, and why. An unknown number of the dialect
stays a number. A turning point is a change of branch, side or guard.

Explain why a robot turned: its last turning points, live or at an instant of a recording.
"""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import copysign, degrees, isfinite
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.recording.log_reader import LogIndex
from ground.station.station import Station
from ground.text.wording import (
    NONE,
    echo,
    heading_deg,
    left_or_right,
    metres,
    place,
    present_reason,
    short,
    side,
)
from protocol.outcome import joined, reason_words
from protocol.topics import CYCLE, DECISION, STATUS
from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.messages import AvoidanceDecision, CycleReport, NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.cli.terminal import printable
from runtime.units import NS_PER_S

BRANCHES: Final[Mapping[int, str]] = MappingProxyType(
    {
        Branch.NONE: "idle",
        Branch.TO_GOAL: "goes for the goal",
        Branch.PASS_LEFT: "passes on the left",
        Branch.PASS_RIGHT: "passes on the right",
        Branch.ALIGN: "turns to the final heading",
        Branch.GIVE_UP: "gives up",
        Branch.LOST: "is lost",
        Branch.FAILED: "has failed",
    }
)
VEHICLES: Final[Mapping[int, str]] = MappingProxyType(
    {
        Vehicle.BOOT: "it is still starting",
        Vehicle.STANDBY: "it is not armed",
        Vehicle.FAILSAFE: "failsafe",
        Vehicle.EMERGENCY_STOP: "emergency stop",
    }
)
ENDS: Final[Mapping[int, str]] = MappingProxyType(
    {
        GoalState.NONE: "it has no goal",
        GoalState.REACHED: "the goal is reached",
        GoalState.STUCK: "it gave the goal up",
        GoalState.ABORTED: "the goal was dropped",
        GoalState.REFUSED: "the goal was refused",
    }
)
ZONES: Final[Mapping[int, str]] = MappingProxyType({Navigator.VGM: "d_obs", Navigator.BUG: "d_th"})
"""Name of the avoidance zone of each navigator that has one."""


def branch_words(number: int) -> str:
    """Name a branch."""
    return BRANCHES.get(number, f"branch {number}")


def navigator_words(number: int) -> str:
    """Name a navigator."""
    return word(Navigator, number, "navigator").lower()


def word(kind: type[Navigator | Mode | Vehicle | GoalState], number: int, what: str) -> str:
    """Return the name of a number, or the number itself."""
    try:
        return kind(number).name
    except ValueError:
        return f"{what} {number}"


def because(what: str, reason: int, by: str = "") -> str:
    """Append a reason other than NONE, with the name of who it was."""
    return what if reason == Reason.NONE else joined(what, reason_words(reason, by))


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
        whose = f" of {printable(status.held_by)}" if status.held_by else ""
        return because(f"it holds on request{whose}", status.vehicle_reason)
    if status.goal in ENDS:
        return because(ENDS[status.goal], present_reason(status), status.ended_by)
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
    if decision.branch == Branch.FAILED:
        return "the user's own navigator has failed"
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


SIDES: Final = (Branch.PASS_LEFT, Branch.PASS_RIGHT)


class TurningPoint(NamedTuple):
    """A change between two decisions; `time_ns` is the robot's stamp."""

    time_ns: int
    words: str
    previous: AvoidanceDecision
    decision: AvoidanceDecision


def turning_point(before: AvoidanceDecision, after: AvoidanceDecision) -> TurningPoint | None:
    """Return the turning point between two decisions, or None without a change."""
    found = changes(before, after)
    return TurningPoint(after.time_ns, "; ".join(found), before, after) if found else None


def changes(before: AvoidanceDecision, after: AvoidanceDecision) -> list[str]:
    """Return what changed between two decisions, in words."""
    found = []
    if before.branch != after.branch:
        sides = before.branch in SIDES and after.branch in SIDES
        words = f"{branch_words(before.branch)} -> {branch_words(after.branch)}"
        found.append(f"changes the side: {words}" if sides else words)
    if before.guard != after.guard:
        found.append(f"guard: {guard_words(before.guard)} -> {guard_words(after.guard)}")
    return found


def guard_words(number: int) -> str:
    """Return the reason of a guard without its prefix."""
    return reason_text(number).removeprefix("guard: ") if number else "nothing"


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
    names = (
        word(Vehicle, status.vehicle, "vehicle"),
        word(Mode, status.mode, "mode"),
        word(GoalState, status.goal, "goal"),
    )
    words = f"{' '.join(names)}, {navigator_words(status.navigator)}"
    return because(words, present_reason(status), status.ended_by)


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


MOST: Final = 200
MANY: Final = 2_400
"""With this many decisions at once, older ones may be missing."""


class Turned(NamedTuple):
    """A turning point and its time of arrival."""

    at_ns: int
    point: TurningPoint


class Why:
    """Collects turning points; call `look` before the station drops decisions."""

    def __init__(self, most: int = MOST) -> None:
        self._points: deque[Turned] = deque(maxlen=most)
        self._newest: AvoidanceDecision | None = None
        self._seen_ns = 0
        self._robot = ""

    def look(self, station: Station) -> None:
        """Process new decisions; start again for another robot or after a jump back."""
        if station.robot != self._robot:
            self._robot, self._seen_ns = station.robot, 0
            self._points.clear()
            self._newest = None
        elif station.now_ns < self._seen_ns:
            self._turn_back(station.now_ns)
        found = station.decisions(self._seen_ns)
        if len(found) >= MANY:
            self._newest = None  # what came in between is not known
        for at_ns, decision in found:
            self._take(at_ns, decision)

    def _turn_back(self, now_ns: int) -> None:
        self._seen_ns = 0
        self._newest = None
        while self._points and self._points[-1].at_ns > now_ns:
            self._points.pop()
        if self._points:
            self._seen_ns = self._points[-1].at_ns
            self._newest = self._points[-1].point.decision

    def _take(self, at_ns: int, decision: AvoidanceDecision) -> None:
        before, self._newest, self._seen_ns = self._newest, decision, at_ns
        point = None if before is None else turning_point(before, decision)
        if point is not None:
            self._points.append(Turned(at_ns, point))

    @property
    def points(self) -> list[TurningPoint]:
        """Turning points, oldest first."""
        return [turned.point for turned in self._points]

    def at(self, back: int = 0) -> Turned | None:
        """Return the last turning point, or an earlier one; None when there is none."""
        return self._points[-1 - back] if 0 <= back < len(self._points) else None


def explained(turned: Turned, station: Station) -> Explanation:
    """Explain a turning point with what the station still knows of that moment."""
    known = station.moment(turned.at_ns)
    status, cycle = (None, None) if known is None else (known.status, known.cycle)
    return explain(turned.point.decision, status, cycle, turned.point.previous)


class Turn(NamedTuple):
    """A turning point: its time since the start of the recording, and what changed."""

    at_ns: int
    words: str


class RecordedDecisions:
    """The decisions of a recording, each with the status and the cost of its tick."""

    def __init__(self, log_index: LogIndex) -> None:
        found = [
            (at_ns, one)
            for at_ns, one in log_index.on(DECISION.path)
            if type(one) is AvoidanceDecision
        ]
        self._times_ns = [at_ns for at_ns, _ in found]
        self._decisions = [decision for _, decision in found]
        self._statuses = {
            one.time_ns: one for _, one in log_index.on(STATUS.path) if type(one) is NavigatorStatus
        }
        self._cycles = {
            one.time_ns: one for _, one in log_index.on(CYCLE.path) if type(one) is CycleReport
        }

    def at(self, at_ns: int) -> tuple[int, Explanation] | None:
        """Explain the last decision up to then, with its time; None before the first."""
        place = self._place(at_ns)
        if place < 0:
            return None
        decision = self._decisions[place]
        before = self._decisions[place - 1] if place else None
        stamp_ns = decision.time_ns
        status, cycle = self._statuses.get(stamp_ns), self._cycles.get(stamp_ns)
        return self._times_ns[place], explain(decision, status, cycle, before)

    def _place(self, at_ns: int) -> int:
        """Return the index of the last decision up to then, or -1 before the first.

        Several decisions may arrive at one instant: then the first turning point among them.
        """
        last = bisect_right(self._times_ns, at_ns) - 1
        if last < 0:
            return last
        first = max(1, bisect_left(self._times_ns, self._times_ns[last]))
        decisions = self._decisions
        turned = (k for k in range(first, last) if turning_point(decisions[k - 1], decisions[k]))
        return next(turned, last)

    def turns(self) -> Iterator[Turn]:
        """Yield the turning points in order of time."""
        pairs = pairwise(self._decisions)
        for at_ns, (before, after) in zip(self._times_ns[1:], pairs, strict=True):
            point = turning_point(before, after)
            if point is not None:
                yield Turn(at_ns, point.words)
