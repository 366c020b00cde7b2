"""Consistency of the odometry's covariance: normalised estimation error squared over many drives.

Per noise level, a robot calibrated for it drives straight, in curves, stop-and-go and among
obstacles. The expected means are 3 for the pose and 2 for the position, within their 95 % bounds.
Noise `none` is compared with its ellipse only: its errors, fractions of encoder ticks, are bounded.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from os import cpu_count

from checks.harness.figures import Figure, Report
from checks.speed.odometry.consistency import KINDS, Array, Consistency, consistency_of, drive
from plant.model.configuration import LEVELS

DRIVES = 400
MIN_INSIDE = 0.93


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--drives", type=int, default=DRIVES, help=f"per noise level ({DRIVES})")
    parser.add_argument("--noise", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--seed", type=int, default=0, help="of the first drive (0)")
    parser.add_argument("--jobs", type=int, default=cpu_count())


def measure(options: argparse.Namespace) -> Report:
    """Measure all noise levels."""
    figures: list[Figure] = []
    notes: list[str] = []
    each = -(-options.drives // len(KINDS))
    with ProcessPoolExecutor(options.jobs) as pool:
        for place, level in enumerate(options.noise):
            first = options.seed + 100_000 * place
            errors: list[tuple[Array, Array]] = []
            for kind in KINDS:
                run = partial(drive, kind, level)
                ended = list(pool.map(run, range(first, first + each), chunksize=8))
                errors += ended
                notes.append(note_of(level, kind, ended))
            figures += figures_of(level, consistency_of(errors))
    return Report(benchmark="nees", figures=tuple(figures), notes=tuple(notes))


def note_of(level: str, kind: str, ended: Sequence[tuple[Array, Array]]) -> str:
    """Return a note on one kind of drive."""
    found = consistency_of(ended)
    return (
        f"{level}, {kind}: pose {found.pose:.2f}, position {found.position:.2f},"
        f" {100.0 * found.inside:.1f} % inside, {found.drives} drives"
    )


def figures_of(level: str, found: Consistency) -> Iterator[Figure]:
    """Yield a figure for each of the two bounds, as a figure has one threshold."""
    for name, mean, (low, high) in (
        ("pose, 3 expected", found.pose, found.pose_bounds),
        ("position, 2 expected", found.position, found.position_bounds),
    ):
        whole = f"{level}: NEES of the {name}"
        held = level != "none"
        yield Figure(name=whole, unit="", values=(mean,), at_least=low if held else None)
        yield Figure(name=whole, unit="", values=(mean,), at_most=high if held else None)
    name = f"{level}: true position inside its 95 % ellipse"
    yield Figure(name=name, unit="", values=(found.inside,), at_least=MIN_INSIDE)
