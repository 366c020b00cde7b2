"""`python -m tests.digests`: the digests of short trials, compared with the committed ones or made.

A digest is equal to the last bit or not at all, so whoever runs this on another Python and finds
the same ones has proved it. Another processor or library may round sin and cos differently: then
`arithmetic` differs as well, and the digests say nothing about this machine.

    python -m tests.digests           compare; 1 when any differs
    python -m tests.digests --write   make them anew, after a change that means to drive differently
"""

import argparse
import hashlib
import json
import math
import struct
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import numpy as np

from plant.world_file import load
from study.trial import NAVIGATORS, Trial, run_trial

FILE = Path(__file__).with_name("data") / "digests.json"
WORLDS = ("box", "u_trap", "forest_medium")
NOISES = ("none", "default", "lossy", "harsh")
TIMEOUT_S = 15.0
LIBRARIES = ("numpy", "pymunk")


class Run(NamedTuple):
    world: str
    navigator: str
    noise: str

    def __str__(self) -> str:
        return "/".join(self)

    def digest(self) -> str:
        trial = Trial(
            world=load(self.world),
            navigator=self.navigator,
            noise=self.noise,
            seed=3,
            timeout_s=TIMEOUT_S,
        )
        return run_trial(trial).digest


def runs(navigators: Sequence[str] = tuple(NAVIGATORS)) -> Iterator[Run]:
    for navigator in navigators:
        for number, world in enumerate(WORLDS):
            for noise in NOISES[number % 2 :: 2]:
                yield Run(world, navigator, noise)


def arithmetic() -> str:
    """What this machine makes of a few thousand sines and the like, and of numpy's luck."""
    angles = [0.37 * k for k in range(-1000, 1000)]
    own = [(math.sin(a), math.cos(a), math.tanh(a), math.atan2(a, 1.7)) for a in angles]
    theirs = np.array(angles)
    luck = np.random.default_rng(1).normal(size=1000)
    arrays = (np.sin(theirs), np.cos(theirs), np.hypot(theirs, 1.7), np.arctan2(theirs, 0.3), luck)
    hashed = hashlib.sha256(b"".join(struct.pack("<4d", *row) for row in own))
    for array in arrays:
        hashed.update(array.astype("<f8").tobytes())
    return hashed.hexdigest()


def versions() -> dict[str, str]:
    return {name: metadata.version(name) for name in LIBRARIES}


def committed() -> dict[str, dict[str, str]]:
    """`digests` by run, the `libraries` and the `arithmetic` they were made with."""
    table: dict[str, dict[str, str]] = json.loads(FILE.read_text("utf-8"))
    return table


def comparable() -> str | None:
    """Why this machine's digests may differ from the committed ones, or None."""
    table = committed()
    if table["libraries"] != versions():
        return f"made with {table['libraries']}, here are {versions()}"
    if table["arithmetic"]["sha256"] != arithmetic():
        return "this machine rounds sin, cos, ... differently from the one they were made on"
    return None


def write(found: dict[str, str]) -> None:
    table = {
        "libraries": versions(),
        "arithmetic": {"sha256": arithmetic()},
        "digests": dict(sorted(found.items())),
    }
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.digests", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--navigators", nargs="+", choices=NAVIGATORS, default=list(NAVIGATORS))
    options = parser.parse_args(argv)
    python = ".".join(map(str, sys.version_info[:3]))
    found = {str(run): run.digest() for run in runs(options.navigators)}
    if options.write:
        write(found)
        print(f"{FILE.name}: {len(found)} digests, made with Python {python}")
        return 0
    known, excuse = committed()["digests"], comparable()
    differing = [name for name, digest in found.items() if known.get(name) != digest]
    print(f"Python {python}: {len(found) - len(differing)} of {len(found)} digests as committed")
    print("\n".join([f"differs: {name}" for name in differing] + ([excuse] if excuse else [])))
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
