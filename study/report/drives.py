"""Run a trial once more with its trajectory; trials are deterministic, so none is stored.

The paper's experiments are run in the same way. Figures 11 and 12 show one place, with vgm and with
bug; figure 13 another. Every navigator drives both, so that each drive has a counterpart at the
same noise and seed.
"""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from math import degrees, hypot, remainder, tau
from typing import Final, TypeAlias, TypeVar

from plant.model.configuration import LEVELS
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.outcome import RunOutcome
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
    outcome: RunOutcome
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


SEEDS: Final = 20
TRAP_SHARE: Final = 4
TRAPS: Final = ("corner", "u_trap")
DRIVERS: Final = (("bug", "left"), ("bug", "right"), ("vgm", "left"), ("vgm_memory", "left"))
PAPERS_OWN: Final = DRIVERS[:3]
PLACES: Final = {"11 and 12": "paper_fig11", "13": "paper_fig13"}
"""Figures of the paper, and the world they are driven in."""

MIN_DEVIATION_M: Final = 0.10
"""A drive that never left the line by more has no deviation to return from."""


@dataclass(frozen=True, slots=True)
class PaperRuns:
    """Drives of the paper's figures, and `traps` in the shipped corner and U-trap."""

    figures: tuple[DrivenTrial, ...] = ()
    traps: tuple[DrivenTrial, ...] = ()

    def of(self, label: str) -> list[DrivenTrial]:
        """Return the drives of a navigator in the paper's figures."""
        return [drive for drive in self.figures if label_of(drive) == label]


def run_paper(jobs: int, seeds: int = SEEDS) -> PaperRuns:
    """Run the figures with this many seeds per noise level, the traps with a quarter of them.

    No drives for 0 seeds.
    """
    figures, traps = figure_trials(seeds), trap_trials(-(-seeds // TRAP_SHARE))
    found = drive_all([*figures, *traps], jobs)
    return PaperRuns(tuple(found[: len(figures)]), tuple(found[len(figures) :]))


def figure_trials(seeds: int) -> list[Trial]:
    """Return the trials of the paper's figures."""
    return [
        trial
        for world in PLACES.values()
        for navigator, side in DRIVERS
        for trial in _trials(world, navigator, side, seeds)
    ]


def trap_trials(seeds: int) -> list[Trial]:
    """Return the trials in the traps."""
    return [
        trial
        for world in TRAPS
        for navigator, side in PAPERS_OWN
        for trial in _trials(world, navigator, side, seeds)
    ]


def _trials(world: str, navigator: str, side: str, seeds: int) -> list[Trial]:
    """Return trials at all noise levels; without noise a seed changes nothing."""
    return [
        Trial(world=load(world), navigator=navigator, side=side, seed=seed, noise=noise)
        for noise in LEVELS
        for seed in range(min(1, seeds) if noise == "none" else seeds)
    ]


def label_of(drive: DrivenTrial) -> str:
    """Return the navigator, with its side if it is bug."""
    navigator, side = drive.trial.navigator, drive.trial.side
    return f"bug, {side}" if navigator == "bug" else navigator


def arrived_untouched(drive: DrivenTrial) -> bool:
    """Return whether the goal was reached without a contact."""
    return drive.outcome.reached and not drive.outcome.contacts


def deviation_m(drive: DrivenTrial) -> float:
    """Return the largest distance from the straight line between start and goal."""
    return max(abs(left_m) for _, left_m in drive.offsets_m())


def remaining_deviation(drive: DrivenTrial) -> float | None:
    """Return the deviation half way from the largest one to the goal, over the largest.

    0: back on the straight line; 0.5: straight towards the goal. None when the goal was not reached
    or there was no deviation.
    """
    offsets = drive.offsets_m()
    sizes = [abs(left_m) for _, left_m in offsets]
    worst = max(range(len(sizes)), key=lambda index: sizes[index])
    if not drive.outcome.reached or sizes[worst] < MIN_DEVIATION_M:
        return None
    goal = drive.trial.world.goal
    start = drive.trial.world.start
    length_m = ((goal.x_m - start.x_m) ** 2 + (goal.y_m - start.y_m) ** 2) ** 0.5
    half_m = (offsets[worst][0] + length_m) / 2.0
    after = (sizes[i] for i in range(worst, len(sizes)) if offsets[i][0] >= half_m)
    return next(after, sizes[-1]) / sizes[worst]


def remaining_turn_deg(drive: DrivenTrial) -> float | None:
    """Return the remaining turn on arrival at the goal position."""
    error_rad = drive.heading_error_on_arrival_rad
    return None if error_rad is None else degrees(error_rad)


def path_ratios(runs: PaperRuns, first: str, second: str) -> list[float]:
    """Return path length of `first` over that of `second` where both arrived in the same trial."""
    others = {_key(drive): drive for drive in runs.of(second) if drive.outcome.reached}
    return [
        drive.outcome.path_m / others[_key(drive)].outcome.path_m
        for drive in runs.of(first)
        if drive.outcome.reached and _key(drive) in others
    ]


def _key(drive: DrivenTrial) -> tuple[str, str, int]:
    return drive.trial.world.name, drive.outcome.noise, drive.trial.seed
