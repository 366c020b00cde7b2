"""A trial run once more with its trajectory: trials are deterministic, so none needs keeping."""

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
class Drive:
    """`true` and `believed` tick by tick; `covariance` xx, xy, yy in m² as it ended."""

    trial: Trial
    outcome: Outcome
    true: tuple[Pose, ...]
    believed: tuple[Pose, ...]
    branches: tuple[int, ...]
    covariance: tuple[float, float, float]

    @property
    def heading_error_on_arrival_rad(self) -> float | None:
        """What was left to turn on the spot: at the first tick at which it only aligned.

        None when it did not arrive or any heading would do.
        """
        wanted_rad = self.trial.world.goal.heading_rad
        if wanted_rad is None or not self.outcome.reached:
            return None
        aligning = (index for index, branch in enumerate(self.branches) if branch == states.ALIGN)
        heading_rad = self.believed[next(aligning, -1)][2]
        return abs(remainder(heading_rad - wanted_rad, tau))

    def offsets_m(self) -> list[tuple[float, float]]:
        """Along and to the left of the straight line from start to goal, tick by tick."""
        world = self.trial.world
        x0, y0 = world.start.x_m, world.start.y_m
        dx, dy = world.goal.x_m - x0, world.goal.y_m - y0
        length_m = hypot(dx, dy)
        ux, uy = dx / length_m, dy / length_m
        return [
            ((x - x0) * ux + (y - y0) * uy, (y - y0) * ux - (x - x0) * uy) for x, y, _ in self.true
        ]


@dataclass(slots=True)
class Recorder:
    """Watches one trial."""

    true: list[Pose] = field(default_factory=list)
    believed: list[Pose] = field(default_factory=list)
    branches: list[int] = field(default_factory=list)
    covariance: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        truth, odometry = plant.truth(), onboard.state.odometry
        self.true.append((truth.x_m, truth.y_m, truth.heading_rad))
        pose = odometry.pose
        self.believed.append((pose.x_m, pose.y_m, pose.heading_rad))
        self.branches.append(0 if outputs.decision is None else outputs.decision.branch)
        self.covariance = odometry.pxx, odometry.pxy, odometry.pyy


def driven(trial: Trial) -> Drive:
    seen = Recorder()
    outcome = run_trial(trial, seen)
    return Drive(
        trial=trial,
        outcome=outcome,
        true=tuple(seen.true),
        believed=tuple(seen.believed),
        branches=tuple(seen.branches),
        covariance=seen.covariance,
    )


def attempted(trial: Trial) -> Drive | str:
    """The drive; in words why there is none: one bad row must not cost the whole report."""
    try:
        return driven(trial)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def all_driven(trials: list[Trial], jobs: int) -> list[Drive]:
    """In the order given, on so many processes; in this one when `jobs` is 1."""
    return _each(driven, trials, jobs)


def all_attempted(trials: list[Trial], jobs: int) -> list[Drive | str]:
    return _each(attempted, trials, jobs)


def _each(run: Callable[[Trial], Found], trials: list[Trial], jobs: int) -> list[Found]:
    pool = nullcontext(None) if jobs <= 1 or len(trials) < 2 else ProcessPoolExecutor(jobs)
    with pool as workers:
        return list(map(run, trials) if workers is None else workers.map(run, trials))
