"""Run one trial in a world, and judge it by the properties."""

from dataclasses import dataclass
from typing import Final

from plant.model.types import World
from protocol.outcome import Outcome
from protocol.wire.reasons import Reason
from robot.core import states
from study.falsify.monitor import Monitor
from study.falsify.properties import Evaluation, scores_of, time_limit_s, violated_by
from study.trial.trial import Trial, run_trial

STILL_M: Final = 0.3
"""A robot that moved less than this during its last minute no longer drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A navigator with its side, at a level of noise."""

    navigator: str
    side: str
    noise: str
    detour: float


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
        lap=watch.lap,
        contact=watch.contact,
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
