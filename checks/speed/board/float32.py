"""Drive with single precision on the emulated board: `python -m checks.speed.board.float32`.

The same core runs in a firmware whose floats have 32 bits. The inputs are those of the plant, which
keeps double precision. The trials without a result come first, and the run can be interrupted.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from itertools import product
from math import hypot
from pathlib import Path
from time import monotonic
from typing import Final

import msgspec

from checks.speed.board.measure import FOLDER
from firmware.board import Board
from firmware.host import BoardCore
from firmware.image import IMAGES
from plant.sim.simulation import Plant
from plant.world.file import load, shipped
from protocol.navigators import NAVIGATORS
from robot.core.values import Outputs
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

RESULTS: Final = FOLDER / "float32.json"
IMAGE: Final = IMAGES["lpc1768-float32"]
NOISE: Final = "default"
SEED: Final = 1
LIMIT_S: Final = 40.0


class Precision(msgspec.Struct, frozen=True, kw_only=True):
    """A drive with double and with single precision.

    `equal_ticks` is the number of ticks before the first different wheel command, `apart_m` the
    largest distance between the two estimated positions of a tick until then, and the errors are
    those of the true position at the end.
    """

    navigator: str
    world: str
    double_outcome: str
    single_outcome: str
    double_s: float
    single_s: float
    double_error_m: float
    single_error_m: float
    equal_ticks: int
    apart_m: float


class Steps:
    """Wheel commands and estimated positions, tick by tick."""

    def __init__(self) -> None:
        self.commands: list[tuple[int, int]] = []
        self.places: list[tuple[float, float]] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Append wheel commands and estimated position of one tick."""
        pose = onboard.state.odometry.pose
        self.commands.append((outputs.left_mrad_s, outputs.right_mrad_s))
        self.places.append((pose.x_m, pose.y_m))


def compared(world: str, navigator: str, last_s: float) -> Precision | None:
    """Drive with both precisions; None if it is too late to start."""
    if monotonic() > last_s:
        return None
    trial = Trial(world=load(world), navigator=navigator, noise=NOISE, seed=SEED, timeout_s=LIMIT_S)
    double, single = Steps(), Steps()
    ours = run_trial(trial, double)
    with Board.emulated(IMAGE.elf) as board:
        theirs = run_trial(trial, single, partial(BoardCore, board))
    pairs = zip(double.commands, single.commands, strict=False)
    equal = next((tick for tick, (one, other) in enumerate(pairs) if one != other), None)
    shared = min(len(double.places), len(single.places)) if equal is None else equal
    places = zip(double.places[:shared], single.places[:shared], strict=True)
    return Precision(
        navigator=navigator,
        world=world,
        double_outcome=ours.outcome,
        single_outcome=theirs.outcome,
        double_s=ours.time_s,
        single_s=theirs.time_s,
        double_error_m=ours.position_error_m,
        single_error_m=theirs.position_error_m,
        equal_ticks=shared,
        apart_m=max([hypot(a[0] - b[0], a[1] - b[1]) for a, b in places], default=0.0),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the trials without a result and write the results."""
    parser = argparse.ArgumentParser(
        prog="python -m checks.speed.board.float32", description=__doc__
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N")
    parser.add_argument("--minutes", type=float, default=1e6, help="start no drive after this time")
    parser.add_argument("--output", type=Path, default=RESULTS, metavar="FILE")
    options = parser.parse_args(argv)
    last_s = monotonic() + 60.0 * options.minutes
    found = read(options.output) if options.output.exists() else []
    done = {(one.world, one.navigator) for one in found}
    todo = [one for one in product(shipped(), NAVIGATORS) if one not in done]
    with ProcessPoolExecutor(options.jobs) as pool:
        runs = [pool.submit(compared, *one, last_s) for one in todo]
        for run in as_completed(runs):
            if (one := run.result()) is not None:
                found.append(one)
                write(found, options.output)
                print(one, flush=True)
    return 0


def read(path: Path = RESULTS) -> list[Precision]:
    """Return the results in a file."""
    return msgspec.json.decode(path.read_bytes(), type=list[Precision])


def write(found: list[Precision], path: Path) -> None:
    """Replace the results in a file."""
    found.sort(key=lambda one: (one.navigator, one.world))
    new = path.with_suffix(".new")
    new.write_bytes(msgspec.json.format(msgspec.json.encode(found), indent=1) + b"\n")
    new.replace(path)


if __name__ == "__main__":
    sys.exit(main())
