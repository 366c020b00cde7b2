"""What a run came to: the one set of keys and words that every way of running prints."""

from dataclasses import asdict, dataclass
from math import degrees, hypot, pi, remainder

from protocol.wire.enums import GoalState
from protocol.wire.goal import WireGoal
from protocol.wire.messages import RunScore
from protocol.wire.reasons import reason_text

ENDS = {
    GoalState.REACHED: "reached",
    GoalState.STUCK: "stuck",
    GoalState.ABORTED: "aborted",
    GoalState.REFUSED: "aborted",
}
OUTCOMES = ("reached", "collided", "stuck", "timeout", "aborted")


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What was to be run; goal as the world has it, and as the robot was given it."""

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
class Ended:
    """How it ended by the robot's own account; the estimate is what it believed."""

    goal_state: int
    goal_reason: int
    time_s: float
    estimate_x_m: float
    estimate_y_m: float
    wall_s: float
    missed_ticks: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Errors against ground truth; `estimated_position_error_m` is what the robot believed.

    `contacts` counts every touch; `own_contacts` those that began while the robot itself moved
    towards what it touched, so that standing still would have spared them.
    `wall_s` is the drive loop alone; `digest` a SHA-256 over the trajectory, equal for equal runs.
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
        return self.outcome == "reached"

    def as_json(self) -> dict[str, object]:
        return asdict(self)

    def text(self) -> str:
        """For a person, in a few short lines."""
        pace = self.time_s / self.wall_s if self.wall_s > 0 else 0.0
        turned_rad = self.heading_error_rad
        heading = "" if turned_rad is None else f" and {degrees(turned_rad):.1f} deg"
        return "\n".join(
            (
                self._headline(),
                f"  way        {self.path_m:.2f} m, shortest {_metres(self.shortest_path_m, 2)}",
                f"  stands     {_metres(self.position_error_m)}{heading} off",
                f"  believes   {_metres(self.estimated_position_error_m)} off",
                f"  clearance  {_metres(self.min_clearance_m)}, {self._touches()}",
                f"  ticks      {self.ticks}, {self.missed_ticks} missed",
                f"  pace       {pace:.1f} x real time",
                f"  noise      {self.noise}, seed {self.seed}",
                f"  digest     {self.digest}",
            )
        )

    def _touches(self) -> str:
        return f"contacts {self.contacts}" + (
            f" ({self.own_contacts} own)" if self.contacts else ""
        )

    def _headline(self) -> str:
        if self.reached:
            return f"reached the goal of {self.world} with {self.navigator} in {self.time_s:.1f} s"
        place = f"{self.world} with {self.navigator} after {self.time_s:.1f} s"
        return f"{self.outcome} in {place}: {self.reason}"


def judged(asked: Asked, ended: Ended, score: RunScore) -> Outcome:
    """Put the plant's score and the robot's account together."""
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
    """Outcome and reason. A run in which the robot ran into anything is a collision, wherever it
    ended. One that was only run into ends as its goal did: a robot cannot get out of every way."""
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
