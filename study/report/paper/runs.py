"""The paper's experiments run again, and measures of a trajectory.

Figures 11 and 12 show one place, with vgm and with bug; figure 13 another. Every navigator drives
both, so that each drive has a counterpart at the same noise and seed.
"""

from dataclasses import dataclass
from math import degrees
from typing import Final

from plant.model.configuration import LEVELS
from plant.world.file import load
from study.report.charts.drives import DrivenTrial, drive_all
from study.trial.trial import Trial

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
