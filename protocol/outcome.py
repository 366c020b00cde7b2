"""Outcome of a run: the keys and texts that every way of running prints."""

from dataclasses import asdict, dataclass
from math import degrees, pi, remainder

from protocol.wire.enums import GoalState
from protocol.wire.goal import WireGoal
from protocol.wire.messages import RunScore
from protocol.wire.reasons import reason_text
from runtime.elementary import hypot

ENDS = {
    GoalState.REACHED: "reached",
    GoalState.STUCK: "stuck",
    GoalState.ABORTED: "aborted",
    GoalState.REFUSED: "aborted",
}
OUTCOMES = ("reached", "collided", "stuck", "timeout", "aborted")


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
    """End of a run as the robot reported it, with its estimated position."""

    goal_state: int
    goal_reason: int
    time_s: float
    estimate_x_m: float
    estimate_y_m: float
    wall_s: float
    missed_ticks: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of a run, with errors against ground truth.

    `estimated_position_error_m` is the error of the robot's estimate against the goal it received.
    `contacts` counts every contact; `own_contacts` those that began while the robot itself moved
    towards the obstacle, so that a stopped robot would have avoided them. `wall_s` is the duration
    of the drive loop; `digest` is a SHA-256 over the trajectory, equal for equal runs.
    """

    world: str
    navigator: str
    seed: int
    noise: str
    wall_s: float
    outcome: str
    reason: str
    time_s: float
    path_m: float
    shortest_path_m: float | None
    position_error_m: float
    heading_error_rad: float | None
    estimated_position_error_m: float
    min_clearance_m: float
    contacts: int
    own_contacts: int
    ticks: int
    missed_ticks: int
    digest: str

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
        return f"{self.outcome} in {place}: {self.reason}"


def evaluated(asked: RunSettings, ended: RunEnd, score: RunScore) -> Outcome:
    """Combine the plant's score and the end reported by the robot into an outcome."""
    outcome, reason = end_of(score, ended.goal_state, ended.goal_reason, asked.timeout_s)
    heading_rad = asked.goal_heading_rad
    turned_rad = None if heading_rad is None else remainder(score.heading_rad - heading_rad, 2 * pi)
    return Outcome(
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
    )


def end_of(score: RunScore, goal_state: int, goal_reason: int, timeout_s: float) -> tuple[str, str]:
    """Return outcome and reason of a run.

    A run with a contact caused by the robot is a collision, wherever it ended. A run in which only
    other objects moved into the robot ends as its goal did: a robot cannot evade everything.
    """
    end = ENDS.get(GoalState(goal_state))
    if score.own_contacts:
        rest = f"; {reason_text(goal_reason)}" if goal_reason else f"; {end}" if end else ""
        return "collided", f"touched something {_times(score.contacts)}{rest}"
    rest = f"; was touched {_times(score.contacts)}" if score.contacts else ""
    if end is None:
        return "timeout", f"not there after {timeout_s:g} s{rest}"
    return end, f"{reason_text(goal_reason)}{rest}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _metres(value: float | None, digits: int = 3) -> str:
    return "unknown" if value is None else f"{value:.{digits}f} m"
