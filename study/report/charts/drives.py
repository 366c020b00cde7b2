"""Run a trial once more with its trajectory; trials are deterministic, so none is stored."""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from math import hypot, remainder, tau
from typing import TypeAlias, TypeVar

from plant.sim.simulation import Plant
from protocol.outcome import Outcome
from robot.core import states
from robot.core.values import Outputs
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

Pose: TypeAlias = tuple[float, float, float]
"""x_m, y_m, heading_rad."""


Found = TypeVar("Found")


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivenTrial:
    """True and estimated poses tick by tick; `covariance` is the last xx, xy, yy in m²."""

    trial: Trial
    outcome: Outcome
    true: tuple[Pose, ...]
    believed: tuple[Pose, ...]
    branches: tuple[int, ...]
    covariance: tuple[float, float, float]

    @property
    def heading_error_on_arrival_rad(self) -> float | None:
        """Remaining turn at the first tick that only aligns the heading.

        None when the goal was not reached or accepts any heading.
        """
        wanted_rad = self.trial.world.goal.heading_rad
        if wanted_rad is None or not self.outcome.reached:
            return None
        aligning = (index for index, branch in enumerate(self.branches) if branch == states.ALIGN)
        heading_rad = self.believed[next(aligning, -1)][2]
        return abs(remainder(heading_rad - wanted_rad, tau))

    def offsets_m(self) -> list[tuple[float, float]]:
        """Return distances along and to the left of the line from start to goal, per tick."""
        world = self.trial.world
        x0, y0 = world.start.x_m, world.start.y_m
        dx, dy = world.goal.x_m - x0, world.goal.y_m - y0
        length_m = hypot(dx, dy)
        ux, uy = dx / length_m, dy / length_m
        return [
            ((x - x0) * ux + (y - y0) * uy, (y - y0) * ux - (x - x0) * uy) for x, y, _ in self.true
        ]


@dataclass(slots=True)
class DriveRecorder:
    """Record one trial."""

    true: list[Pose] = field(default_factory=list)
    believed: list[Pose] = field(default_factory=list)
    branches: list[int] = field(default_factory=list)
    covariance: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Record one tick."""
        truth, odometry = plant.truth(), onboard.state.odometry
        self.true.append((truth.x_m, truth.y_m, truth.heading_rad))
        pose = odometry.pose
        self.believed.append((pose.x_m, pose.y_m, pose.heading_rad))
        self.branches.append(0 if outputs.decision is None else outputs.decision.branch)
        self.covariance = odometry.pxx, odometry.pxy, odometry.pyy


def drive_trial(trial: Trial) -> DrivenTrial:
    """Run a trial and return its trajectory."""
    seen = DriveRecorder()
    outcome = run_trial(trial, seen)
    return DrivenTrial(
        trial=trial,
        outcome=outcome,
        true=tuple(seen.true),
        believed=tuple(seen.believed),
        branches=tuple(seen.branches),
        covariance=seen.covariance,
    )


def attempt_trial(trial: Trial) -> DrivenTrial | str:
    """Run a trial; return an error as text, so that one bad row does not end the report."""
    try:
        return drive_trial(trial)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def drive_all(trials: list[Trial], jobs: int) -> list[DrivenTrial]:
    """Run trials in the given order on `jobs` processes; in this one for 1."""
    return _each(drive_trial, trials, jobs)


def attempt_all(trials: list[Trial], jobs: int) -> list[DrivenTrial | str]:
    """Run trials as `drive_all` does, with errors as text."""
    return _each(attempt_trial, trials, jobs)


def _each(run: Callable[[Trial], Found], trials: list[Trial], jobs: int) -> list[Found]:
    pool = nullcontext(None) if jobs <= 1 or len(trials) < 2 else ProcessPoolExecutor(jobs)
    with pool as workers:
        return list(map(run, trials) if workers is None else workers.map(run, trials))
