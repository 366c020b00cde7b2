"""`python -m verification.same_bits.board`: compare trials in process and on the emulated board.

Every shipped world is driven with every navigator and noise level, the shortest trials first. The
results are written after each trial. A trial that has a result of the same image is not repeated,
so a run can be interrupted and resumed. Exits with 1 if a digest differs or is missing.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from hashlib import sha256
from itertools import product
from pathlib import Path
from time import monotonic
from typing import Final, NamedTuple

import msgspec

from plant.world.file import load, shipped
from protocol.outcome import Outcome
from robot.hosting.on_board import BoardCore
from robot.mcu.board import Board, BoardError
from robot.mcu.image import IMAGE, core_hash
from runtime.errors import UserError
from study.trial.trial import NAVIGATORS, Trial, run_trial
from verification.same_bits.variants import ROOT

RESULTS: Final = ROOT / "docs" / "evidence" / "microcontroller" / "digests.json"
NOISES: Final = ("none", "default")
SEED: Final = 1
SHOWN: Final = 12
"""Digits of a hash that are kept in the results."""


class Drive(NamedTuple):
    """What is driven."""

    world: str
    navigator: str
    noise: str

    def trial(self) -> Trial:
        """Return the trial with its usual time limit."""
        world, navigator, noise = self
        return Trial(world=load(world), navigator=navigator, noise=noise, seed=SEED)


class Compared(msgspec.Struct, frozen=True):
    """The end of a drive in this process, and the digests of both; an error in place of one."""

    world: str
    navigator: str
    noise: str
    outcome: str
    time_s: float
    digest: str
    on_board: str

    @property
    def drive(self) -> Drive:
        """What was driven."""
        return Drive(self.world, self.navigator, self.noise)

    @property
    def is_equal(self) -> bool:
        """Whether both digests are the same."""
        return self.digest == self.on_board


class Comparison(msgspec.Struct):
    """All results with one image; `image` and `core` are the beginnings of SHA-256 hashes."""

    image: str
    core: str
    seed: int
    drives: list[Compared]

    def missing(self) -> list[Drive]:
        """Return the drives that have no result."""
        done = {one.drive for one in self.drives}
        return [drive for drive in all_drives() if drive not in done]


def all_drives() -> Iterator[Drive]:
    """Yield all drives."""
    return (Drive(*words) for words in product(shipped(), NAVIGATORS, NOISES))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the missing drives and return the exit code."""
    command = "python -m verification.same_bits.board"
    parser = argparse.ArgumentParser(prog=command, description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="FILE")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N")
    parser.add_argument("--minutes", type=float, default=1e6, help="start no drive after this time")
    options = parser.parse_args(argv)
    last_s = monotonic() + 60.0 * options.minutes
    found = resumed(options.results)
    with ProcessPoolExecutor(options.jobs) as pool:
        todo = found.missing()
        expected = dict(zip(todo, pool.map(in_process, todo), strict=True))
        todo.sort(key=lambda drive: expected[drive].time_s)
        runs = [pool.submit(compared, drive, expected[drive], last_s) for drive in todo]
        for run in as_completed(runs):
            if (one := run.result()) is not None:
                found.drives.append(one)
                write(options.results, found)
                state = "equal" if one.is_equal else f"DIFFERS: {one.on_board}"
                print(f"{one.world} {one.navigator} {one.noise}: {state}", flush=True)
    differing, missing = sum(not one.is_equal for one in found.drives), len(found.missing())
    print(f"{differing} of {len(found.drives)} differ, {missing} are missing")
    return 1 if differing or missing else 0


def resumed(path: Path) -> Comparison:
    """Return the results in a file if they are of the present image, else empty results."""
    if not IMAGE.elf.exists():
        raise UserError(f"no firmware at {IMAGE.elf}: build it with `make firmware`")
    image = sha256(IMAGE.elf.read_bytes()).hexdigest()[:SHOWN]
    if path.exists() and (before := read(path)).image == image:
        return before
    return Comparison(image, core_hash().hex()[:SHOWN], SEED, [])


def in_process(drive: Drive) -> Outcome:
    """Run a drive in this process."""
    return run_trial(drive.trial())


def compared(drive: Drive, expected: Outcome, last_s: float) -> Compared | None:
    """Run a drive on the board; None if it is too late to start."""
    if monotonic() > last_s:
        return None
    try:
        with Board.emulated() as board:
            digest = run_trial(drive.trial(), new_core=partial(BoardCore, board)).digest
    except BoardError as error:
        digest = str(error)
    return Compared(*drive, expected.outcome, expected.time_s, expected.digest, digest)


def read(path: Path) -> Comparison:
    """Return the results in a file."""
    return msgspec.json.decode(path.read_bytes(), type=Comparison)


def write(path: Path, comparison: Comparison) -> None:
    """Replace a file by the results, in the order of the drives."""
    comparison.drives.sort(key=lambda one: one.drive)
    new = path.with_suffix(".new")
    new.write_bytes(msgspec.json.format(msgspec.json.encode(comparison), indent=1) + b"\n")
    new.replace(path)


if __name__ == "__main__":
    sys.exit(main())
