"""Outcome of a run: its goal and start on the wire, and the keys and texts that are printed.

All conversions are in this module, so that a run over the bus and a run without it get the same
goal and start to the last bit. Both are in world coordinates: the robot is given its start pose.
The doubt about a position is the size of the confidence ellipse of an estimate.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import degrees, isfinite, pi, radians, remainder, sqrt
from types import MappingProxyType
from typing import Final, NamedTuple

from protocol.wire.enums import GoalState, MissionState
from protocol.wire.messages import PlanarOdometry, RunScore
from protocol.wire.reasons import Reason, reason_text
from runtime.cli.terminal import printable
from runtime.elementary import hypot

DEGREE_DIGITS = 9
"""Digits that headings are rounded to, so that 45 degrees in a file become 45 again."""


class WireGoal(NamedTuple):
    """The fields of a GOAL_REQUEST that define the goal."""

    x_mm: int
    y_mm: int
    heading_urad: int
    heading_free: int
    position_tolerance_mm: int
    heading_tolerance_urad: int


def wire_goal(
    x_m: float,
    y_m: float,
    heading_rad: float | None,
    position_tolerance_m: float,
    heading_tolerance_rad: float,
) -> WireGoal:
    """Return a goal as integers; heading None: any heading. Raises ValueError unless finite."""
    turn_rad = 0.0 if heading_rad is None else heading_rad
    values = (x_m, y_m, turn_rad, position_tolerance_m, heading_tolerance_rad)
    if not all(map(isfinite, values)):
        raise ValueError(f"a goal needs finite numbers, not {values}")
    return WireGoal(
        x_mm=round(x_m * 1000),
        y_mm=round(y_m * 1000),
        heading_urad=round(turn_rad * 1e6),
        heading_free=int(heading_rad is None),
        position_tolerance_mm=round(position_tolerance_m * 1000),
        heading_tolerance_urad=round(heading_tolerance_rad * 1e6),
    )


def start_arguments(x_m: float, y_m: float, heading_rad: float) -> tuple[str, str, str]:
    """Return x in m, y in m and heading in degrees for the robot's command line."""
    return repr(x_m), repr(y_m), repr(round(degrees(heading_rad), DEGREE_DIGITS))


def rounded_heading_rad(heading_rad: float) -> float:
    """Return a heading in rad as it arrives after the conversion to degrees on the command line."""
    return radians(float(start_arguments(0.0, 0.0, heading_rad)[2]))


OUTSIDE: Final = 0.05
"""The probability that the true position is outside the ellipse."""

CHI2_2: Final = 5.991464547107982
"""The squared half axis in standard deviations: chi-square with two degrees of freedom.

It is -2 log(OUTSIDE), written out because the last bit of a logarithm differs between machines.
"""


def doubt_m(xx_m2: float, xy_m2: float, yy_m2: float) -> float | None:
    """Return the longer half axis of the ellipse in metres; None when this is no covariance."""
    middle_m2, spread_m2 = xx_m2 / 2.0 + yy_m2 / 2.0, xx_m2 / 2.0 - yy_m2 / 2.0
    most_m2 = middle_m2 + sqrt(spread_m2 * spread_m2 + xy_m2 * xy_m2)
    if not isfinite(most_m2) or most_m2 < 0.0:
        return None
    return sqrt(CHI2_2 * most_m2)


def doubt_of(pose: PlanarOdometry) -> float | None:
    """Return the doubt of an estimated pose in metres; None when its place is unknown."""
    return doubt_m(pose.cov_xx_m2, pose.cov_xy_m2, pose.cov_yy_m2)


def doubt_words(doubt_m: float | None) -> str:
    """Return the doubt in words."""
    return f"position doubt {'unknown' if doubt_m is None else f'{doubt_m:.2f} m'}"


ENDS: Final = {
    GoalState.REACHED: "reached",
    GoalState.STUCK: "stuck",
    GoalState.ABORTED: "aborted",
    GoalState.REFUSED: "aborted",
}
UNREACHABLE: Final = "unreachable"
LOST: Final = "lost"
REPLACED: Final = "replaced"
"""Outcome of a goal of which another one has taken the place. No trial ends so."""

CLAIMS: Final = {Reason.UNREACHABLE: UNREACHABLE, Reason.LOST: LOST}
"""Reasons for which a robot gave a goal up although it could move, and their outcomes."""

BY_PERSONS: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.BY_OPERATOR: "by {}",
        Reason.DISARMED: "disarmed by {}",
        Reason.BY_HAND: "driven by hand by {}",
        Reason.REPLACED: "replaced by a new goal of {}",
    }
)
"""Ends that a person has wanted, with the name of another one than who began what has ended."""

WANTED_ENDS: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.BY_OPERATOR: "aborted",
        Reason.DISARMED: "aborted",
        Reason.BY_EMERGENCY_STOP: "aborted",
        Reason.BY_HAND: "taken over",
        Reason.REPLACED: "taken over",
    }
)
"""States of a mission by the reason of its end, if an operator wanted that: it has not failed."""

OUTCOMES: Final = (
    *("reached", "collided", UNREACHABLE, LOST),
    *("stuck", "timeout", "aborted"),
)
"""Outcomes of a run.

`unreachable`: the robot proved that no way leads to the goal. `lost`: it found neither a way nor a
proof. `stuck`: it could not move, or came no closer.
"""


WIDEST: Final = max(map(len, OUTCOMES))
"""Characters of the longest outcome, for columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """Settings of a run: the goal in world coordinates, and as sent to the robot."""

    world: str
    navigator: str
    seed: int
    noise: str
    goal_x_m: float
    goal_y_m: float
    goal_heading_rad: float | None
    wire_goal: WireGoal
    shortest_path_m: float | None
    timeout_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEnd:
    """End of a run as the robot reported it, with its estimated position.

    `doubt_m` is the longer half axis of the 95 % ellipse of that position, None where unknown. `by`
    is the person who ended the goal of another one, if one did.
    """

    goal_state: int
    goal_reason: int
    time_s: float
    estimate_x_m: float
    estimate_y_m: float
    wall_s: float
    missed_ticks: int = 0
    doubt_m: float | None = None
    by: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """Result of a run, with errors against ground truth."""

    world: str
    navigator: str
    seed: int
    noise: str
    wall_s: float
    """Duration of the drive loop."""

    outcome: str
    reason: str
    time_s: float
    path_m: float
    shortest_path_m: float | None
    position_error_m: float
    heading_error_rad: float | None
    estimated_position_error_m: float
    """Error of the robot's estimate against the goal it received."""

    min_clearance_m: float
    contacts: int
    own_contacts: int
    """Those that began while the robot itself moved towards the obstacle, so that a stopped robot
    would have avoided them."""

    ticks: int
    missed_ticks: int
    digest: str
    """SHA-256 over the trajectory, equal for equal runs."""

    doubt_m: float | None = None
    """The longer half axis of the 95 % ellipse of the estimate at the end, None where unknown."""

    @property
    def reached(self) -> bool:
        """Return whether the robot reached its goal."""
        return self.outcome == "reached"

    def as_json(self) -> dict[str, object]:
        """Return the outcome as JSON keys and values."""
        return asdict(self)

    def text(self) -> str:
        """Return the outcome as a few short lines for the terminal."""
        pace = self.time_s / self.wall_s if self.wall_s > 0 else 0.0
        turned_rad = self.heading_error_rad
        heading = "" if turned_rad is None else f" and {degrees(turned_rad):.1f} deg"
        return "\n".join(
            (
                self._headline(),
                f"  path       {self.path_m:.2f} m, shortest {_metres(self.shortest_path_m, 2)}",
                f"  error      {_metres(self.position_error_m)}{heading}",
                f"  estimated  {_metres(self.estimated_position_error_m)}",
                f"  clearance  {_metres(self.min_clearance_m)}, {self._contact_counts()}",
                f"  ticks      {self.ticks}, {self.missed_ticks} missed",
                f"  pace       {pace:.1f} x real time",
                f"  noise      {self.noise}, seed {self.seed}",
                f"  digest     {self.digest}",
            )
        )

    def _contact_counts(self) -> str:
        return f"contacts {self.contacts}" + (
            f" ({self.own_contacts} own)" if self.contacts else ""
        )

    def _headline(self) -> str:
        if self.reached:
            return f"reached the goal of {self.world} with {self.navigator} in {self.time_s:.1f} s"
        place = f"{self.world} with {self.navigator} after {self.time_s:.1f} s"
        if self.outcome == REPLACED:
            return f"{self.outcome} {self.reason} in {place}"
        return f"{self.outcome} in {place}: {detail_of(self.outcome, self.reason)}"


def evaluated(asked: RunSettings, ended: RunEnd, score: RunScore) -> RunOutcome:
    """Combine the plant's score and the end reported by the robot into an outcome."""
    outcome, reason = end_of(score, ended, asked.timeout_s)
    heading_rad = asked.goal_heading_rad
    turned_rad = None if heading_rad is None else remainder(score.heading_rad - heading_rad, 2 * pi)
    return RunOutcome(
        world=asked.world,
        navigator=asked.navigator,
        seed=asked.seed,
        noise=asked.noise,
        wall_s=ended.wall_s,
        outcome=outcome,
        reason=reason,
        time_s=ended.time_s,
        path_m=score.path_m,
        shortest_path_m=asked.shortest_path_m,
        position_error_m=hypot(score.x_m - asked.goal_x_m, score.y_m - asked.goal_y_m),
        heading_error_rad=None if turned_rad is None else abs(turned_rad),
        estimated_position_error_m=hypot(
            ended.estimate_x_m - asked.wire_goal.x_mm / 1000,
            ended.estimate_y_m - asked.wire_goal.y_mm / 1000,
        ),
        min_clearance_m=score.min_clearance_m,
        contacts=score.contacts,
        own_contacts=score.own_contacts,
        ticks=score.ticks,
        missed_ticks=ended.missed_ticks,
        digest=bytes(score.digest).hex(),
        doubt_m=ended.doubt_m,
    )


def end_of(score: RunScore, ended: RunEnd, timeout_s: float) -> tuple[str, str]:
    """Return outcome and reason of a run.

    A run with a contact caused by the robot is a collision, wherever it ended. A run in which only
    other objects moved into the robot ends as its goal did: a robot cannot evade everything.
    """
    end, why = goal_end(ended.goal_state, ended.goal_reason), reason_of(ended)
    if score.own_contacts:
        rest = f"; {why}" if ended.goal_reason else f"; {end}" if end else ""
        return "collided", f"touched something {_times(score.contacts)}{rest}"
    rest = f"; was touched {_times(score.contacts)}" if score.contacts else ""
    if end is None:
        return "timeout", f"not there after {timeout_s:g} s{rest}"
    return end, f"{why}{rest}"


def goal_end(goal_state: int, goal_reason: int) -> str | None:
    """Return how a goal ended, as an outcome; None while the robot drives to it.

    An unknown state has not ended.
    """
    if goal_state == GoalState.STUCK:
        claim = next((claim for reason, claim in CLAIMS.items() if reason == goal_reason), None)
        return claim or ENDS[GoalState.STUCK]
    return next((end for state, end in ENDS.items() if state == goal_state), None)


def mission_state(state: int, reason: int) -> str:
    """Return the state of a mission in words; one that an operator ended has not failed."""
    if state == MissionState.FAILED and reason in WANTED_ENDS:
        return WANTED_ENDS[reason]
    return MissionState(state).name if state in list(MissionState) else f"state {state}"


def reason_of(ended: RunEnd) -> str:
    """Return the reason of an end; that of a lost robot names the doubt about its position."""
    words = reason_words(ended.goal_reason, ended.by)
    if goal_end(ended.goal_state, ended.goal_reason) != LOST:
        return words
    return f"{words}; {doubt_words(ended.doubt_m)}"


def reason_words(reason: int, by: str) -> str:
    """Return a reason, with the name of who it was, if that is known and another person."""
    words = BY_PERSONS.get(reason) if by else None
    return reason_text(reason) if words is None else words.format(printable(by))


def joined(what: str, reason: str) -> str:
    """Return an end with its reason, as in `stuck: has not moved` or `aborted by anna`."""
    is_named = reason.startswith("by ") and reason != reason_text(Reason.BY_OPERATOR)
    return f"{what}{' ' if is_named else ': '}{reason}"


def detail_of(outcome: str, reason: str) -> str:
    """Return a reason without the outcome that it begins with, to be printed after the outcome."""
    return reason.removeprefix(f"{outcome}: ")


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _metres(value: float | None, digits: int = 3) -> str:
    return "unknown" if value is None else f"{value:.{digits}f} m"
