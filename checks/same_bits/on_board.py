"""`python -m checks.same_bits.on_board`: compare trials in process and on the emulated board.

Every shipped world is driven with every navigator and noise level. The results are written after
each trial. A trial that has a result of the same image is not repeated, so a run can be interrupted
and resumed. Trials without a result come first, then those that differed, then those of other
images, the shortest first. Exits with 1 if a digest differs or is missing.
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

from firmware.board import Board, BoardError
from firmware.host import BoardCore
from firmware.image import IMAGE, core_hash
from plant.world.file import load, shipped
from protocol.navigators import NAVIGATORS
from runtime.errors import UserError
from study.trial.trial import Trial, run_trial

ROOT: Final = Path(__file__).resolve().parents[2]
RESULTS: Final = ROOT / "docs" / "evidence" / "microcontroller" / "digests.json"
NOISES: Final = ("none", "default")
SEED: Final = 1
SHOWN: Final = 12
"""Digits of a hash that are kept in the results."""


class BoardDrive(NamedTuple):
    """World, navigator and noise of a drive."""

    world: str
    navigator: str
    noise: str

    def trial(self) -> Trial:
        """Return the trial with its usual time limit."""
        world, navigator, noise = self
        return Trial(world=load(world), navigator=navigator, noise=noise, seed=SEED)


class Compared(msgspec.Struct, frozen=True):
    """Outcome of a drive in this process, and the digests there and on the board, or an error.

    `image` is the beginning of the SHA-256 of the board's image, `core` that of its core.
    """

    world: str
    navigator: str
    noise: str
    outcome: str
    time_s: float
    digest: str
    on_board: str
    image: str
    core: str

    @property
    def drive(self) -> BoardDrive:
        """World, navigator and noise."""
        return BoardDrive(self.world, self.navigator, self.noise)

    @property
    def is_equal(self) -> bool:
        """True if both digests are the same."""
        return self.digest == self.on_board


class BoardComparison(msgspec.Struct):
    """The newest result of each drive."""

    seed: int
    drives: list[Compared]

    def missing(self) -> list[BoardDrive]:
        """Return the drives that have no result."""
        done = {one.drive for one in self.drives}
        return [drive for drive in all_drives() if drive not in done]

    def differing(self) -> list[Compared]:
        """Return the results with two digests."""
        return [one for one in self.drives if not one.is_equal]

    def todo(self, image: str) -> list[BoardDrive]:
        """Return the drives without an equal result of an image, in the order of the run."""
        old = [one for one in self.drives if not one.is_equal or one.image != image]
        old.sort(key=lambda one: (one.is_equal, one.time_s))
        return [*self.missing(), *(one.drive for one in old)]

    def put(self, one: Compared) -> None:
        """Put a result in the place of that of the same drive."""
        self.drives = [other for other in self.drives if other.drive != one.drive] + [one]


def all_drives() -> Iterator[BoardDrive]:
    """Yield all drives."""
    return (BoardDrive(*words) for words in product(shipped(), NAVIGATORS, NOISES))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the missing drives and return the exit code."""
    command = "python -m checks.same_bits.on_board"
    parser = argparse.ArgumentParser(prog=command, description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="FILE")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N")
    parser.add_argument("--minutes", type=float, default=1e6, help="start no drive after this time")
    options = parser.parse_args(argv)
    last_s = monotonic() + 60.0 * options.minutes
    found, image = resumed(options.results), image_hash()
    with ProcessPoolExecutor(options.jobs) as pool:
        runs = [pool.submit(compared, drive, image, last_s) for drive in found.todo(image)]
        for run in as_completed(runs):
            if (one := run.result()) is not None:
                found.put(one)
                write(options.results, found)
                state = "equal" if one.is_equal else f"DIFFERS: {one.on_board}"
                print(f"{one.world} {one.navigator} {one.noise}: {state}", flush=True)
    differing, missing = len(found.differing()), len(found.missing())
    print(f"{differing} of {len(found.drives)} differ, {missing} are missing")
    return 1 if differing or missing else 0


def resumed(path: Path) -> BoardComparison:
    """Return the results in a file, if there are any."""
    return read(path) if path.exists() else BoardComparison(SEED, [])


def image_hash() -> str:
    """Return the first digits of the hash of the image; raise UserError if there is none."""
    if not IMAGE.elf.exists():
        raise UserError(f"no firmware at {IMAGE.elf}: build it with `make firmware`")
    return sha256(IMAGE.elf.read_bytes()).hexdigest()[:SHOWN]


def compared(drive: BoardDrive, image: str, last_s: float) -> Compared | None:
    """Run a drive in this process and on the board; None if it is too late to start."""
    if monotonic() > last_s:
        return None
    expected = run_trial(drive.trial())
    try:
        with Board.emulated() as board:
            digest = run_trial(drive.trial(), new_core=partial(BoardCore, board)).digest
    except BoardError as error:
        digest = str(error)
    core = core_hash().hex()[:SHOWN]
    return Compared(*drive, expected.outcome, expected.time_s, expected.digest, digest, image, core)


def read(path: Path) -> BoardComparison:
    """Return the results in a file."""
    return msgspec.json.decode(path.read_bytes(), type=BoardComparison)


def write(path: Path, comparison: BoardComparison) -> None:
    """Replace a file by the results, in the order of the drives."""
    comparison.drives.sort(key=lambda one: one.drive)
    new = path.with_suffix(".new")
    new.write_bytes(msgspec.json.format(msgspec.json.encode(comparison), indent=1) + b"\n")
    new.replace(path)


if __name__ == "__main__":
    sys.exit(main())
