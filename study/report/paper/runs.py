"""The paper's experiments run again, and what can be measured on a trajectory.

Figures 11 and 12 show one place, with vgm and with bug; figure 13 another. Every navigator drives
both, so that each drive has its counterpart at the same noise and seed.
"""

from dataclasses import dataclass
from math import degrees
from typing import Final

from plant.model.noise import LEVELS
from plant.world.file import load
from study.report.charts.drives import Drive, all_driven
from study.trial.trial import Trial

SEEDS: Final = 20
TRAP_SHARE: Final = 4
TRAPS: Final = ("corner", "u_trap")
DRIVERS: Final = (("bug", "left"), ("bug", "right"), ("vgm", "left"), ("vgm_memory", "left"))
PAPERS_OWN: Final = DRIVERS[:3]
PLACES: Final = {"11 and 12": "paper_fig11", "13": "paper_fig13"}
"""The figures of the paper, and the world they are driven in."""

MIN_DEVIATION_M: Final = 0.10
"""Who never left the line by more has nothing to return from."""


@dataclass(frozen=True, slots=True)
class Runs:
    """`figures` in the two places, `traps` in the shipped corner and U-trap."""

    figures: tuple[Drive, ...] = ()
    traps: tuple[Drive, ...] = ()

    def of(self, label: str) -> list[Drive]:
        return [drive for drive in self.figures if label_of(drive) == label]


def run_paper(jobs: int, seeds: int = SEEDS) -> Runs:
    """So many seeds at each noise level, a quarter as many in the traps; none for 0."""
    figures, traps = figure_trials(seeds), trap_trials(-(-seeds // TRAP_SHARE))
    found = all_driven([*figures, *traps], jobs)
    return Runs(tuple(found[: len(figures)]), tuple(found[len(figures) :]))


def figure_trials(seeds: int) -> list[Trial]:
    return [
        trial
        for world in PLACES.values()
        for navigator, side in DRIVERS
        for trial in _trials(world, navigator, side, seeds)
    ]


def trap_trials(seeds: int) -> list[Trial]:
    return [
        trial
        for world in TRAPS
        for navigator, side in PAPERS_OWN
        for trial in _trials(world, navigator, side, seeds)
    ]


def _trials(world: str, navigator: str, side: str, seeds: int) -> list[Trial]:
    """All noise levels; without noise a seed changes nothing."""
    return [
        Trial(world=load(world), navigator=navigator, side=side, seed=seed, noise=noise)
        for noise in LEVELS
        for seed in range(min(1, seeds) if noise == "none" else seeds)
    ]


def label_of(drive: Drive) -> str:
    navigator, side = drive.trial.navigator, drive.trial.side
    return f"bug, {side}" if navigator == "bug" else navigator


def untouched(drive: Drive) -> bool:
    return drive.outcome.reached and not drive.outcome.contacts


def deviation_m(drive: Drive) -> float:
    """The farthest it was from the straight line between start and goal."""
    return max(abs(left_m) for _, left_m in drive.offsets_m())


def left_of_deviation(drive: Drive) -> float | None:
    """Half way from where it deviated most to the goal: the deviation then over the largest.

    0: it is back on the straight line; 0.5: it heads straight for the goal. None when it never
    arrived or never deviated.
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


def turn_left_deg(drive: Drive) -> float | None:
    """What was left to turn when it had come to the place."""
    error_rad = drive.heading_error_on_arrival_rad
    return None if error_rad is None else degrees(error_rad)


def ways(runs: Runs, first: str, second: str) -> list[float]:
    """First's way over second's where both arrived, at the same place, noise and seed."""
    others = {_key(drive): drive for drive in runs.of(second) if drive.outcome.reached}
    return [
        drive.outcome.path_m / others[_key(drive)].outcome.path_m
        for drive in runs.of(first)
        if drive.outcome.reached and _key(drive) in others
    ]


def _key(drive: Drive) -> tuple[str, str, int]:
    return drive.trial.world.name, drive.outcome.noise, drive.trial.seed
