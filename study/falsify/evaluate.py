"""Run one trial in a world, and judge it by the properties."""

from dataclasses import dataclass
from math import inf
from typing import Final

from plant.model.types import World
from plant.sim.simulation import Plant
from protocol.outcome import Outcome
from protocol.wire.reasons import Reason
from robot.core import states
from robot.core.values import Outputs
from runtime.elementary import hypot
from study.falsify.properties import Evaluation, scores_of, time_limit_s, violated_by
from study.runner.run_task import mahalanobis2
from study.trial.behaviour import Behaviour
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

LOOK_EVERY: Final = 10
"""Ticks between looks at the position; the estimate changes slowly."""

TOUCHING_M: Final = 1e-3
LATE: Final = 1200
"""Ticks, one minute: the distance driven in the last of them distinguishes kinds of time-out."""

STILL_M: Final = 0.3
FLOOR_M2: Final = 1e-6
"""Variance in m² that is added to the claimed one: the wire rounds positions to millimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """What is tried: a navigator with its side, at a level of noise."""

    navigator: str
    side: str
    noise: str
    detour: float


class Monitor:
    """Watch a trial: behaviour, position error, and branch at the first contact."""

    __slots__ = ("behaviour", "contact_branch", "mahalanobis2", "nearest_goal_m", "places")

    def __init__(self) -> None:
        self.behaviour = Behaviour()
        self.contact_branch: int = states.NO_BRANCH
        self.mahalanobis2 = 0.0
        self.nearest_goal_m = inf
        self.places: list[tuple[float, float]] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Watch one tick."""
        self.behaviour(plant, onboard, outputs)
        decision = outputs.decision
        untouched = self.contact_branch == states.NO_BRANCH
        if decision is not None and untouched and plant.attitude()[1] < TOUCHING_M:
            self.contact_branch = decision.branch
        if self.behaviour.ticks % LOOK_EVERY:
            return
        truth, odometry = plant.truth(), onboard.state.odometry
        self.places.append((truth.x_m, truth.y_m))
        self.nearest_goal_m = min(self.nearest_goal_m, onboard.state.goal_distance_m)
        off = truth.x_m - odometry.pose.x_m, truth.y_m - odometry.pose.y_m
        spread = odometry.pxx + FLOOR_M2, odometry.pxy, odometry.pyy + FLOOR_M2
        self.mahalanobis2 = max(self.mahalanobis2, mahalanobis2(*off, spread))

    @property
    def moved_late_m(self) -> float:
        """Largest distance from the last place during the last minute."""
        last = self.places[-1] if self.places else (0.0, 0.0)
        late = self.places[-LATE // LOOK_EVERY :]
        return max((hypot(x - last[0], y - last[1]) for x, y in late), default=0.0)


def trial_of(subject: Subject, world: World, seed: int, limit_s: float | None = None) -> Trial:
    """Return the trial of a subject in a world whose shortest path is known.

    `limit_s` None: the time limit of the world.
    """
    return Trial(
        world=world,
        navigator=subject.navigator,
        side=subject.side,
        seed=seed,
        noise=subject.noise,
        timeout_s=limit_s or time_limit_s(world),
    )


def evaluate(subject: Subject, world: World, seed: int, limit_s: float | None = None) -> Evaluation:
    """Run the trial and return its evaluation."""
    watch, trial = Monitor(), trial_of(subject, world, seed, limit_s)
    outcome = run_trial(trial, watch)
    onboard = watch.behaviour.onboard
    reason = 0 if onboard is None else onboard.state.machine.goal_reason
    reachable = bool(world.reachable)
    return Evaluation(
        world=world,
        seed=seed,
        kind=kind_of(outcome, reason, watch),
        violated=violated_by(
            outcome, reason, watch.mahalanobis2, subject.detour, reachable=reachable
        ),
        scores=scores_of(outcome, watch.mahalanobis2, trial.timeout_s, reachable=reachable),
        outcome=outcome,
        goal_reason=reason,
        avoidances=watch.behaviour.avoidances,
        side_changes=watch.behaviour.side_changes,
        mahalanobis2=watch.mahalanobis2,
        nearest_goal_m=watch.nearest_goal_m,
        contact_branch=watch.contact_branch,
        moved_late_m=watch.moved_late_m,
    )


def kind_of(outcome: Outcome, reason: int, watch: Monitor) -> str:
    """Return the kind of end in a word or two joined by a hyphen."""
    if outcome.own_contacts:
        return f"contact-{BRANCHES.get(watch.contact_branch, 'stopped')}"
    if reason == Reason.UNREACHABLE:
        return "claim"
    if outcome.reached:
        return "reached"
    if outcome.outcome != "timeout":
        return Reason(reason).name.lower().replace("_", "-")
    return "timeout-still" if watch.moved_late_m < STILL_M else "timeout-moving"


BRANCHES: Final = {
    states.TO_GOAL: "to-goal",
    states.PASS_LEFT: "passing",
    states.PASS_RIGHT: "passing",
    states.ALIGN: "aligning",
    states.GIVE_UP: "giving-up",
}
