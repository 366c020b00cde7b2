"""`python -m tests.support.digests`: compare digests of short trials, or write them.

A digest hashes the true poses: it is equal to the last bit or it differs. It holds on every
supported Python with the C library glibc and the pinned libraries, whether or not the processor has
FMA and AVX instructions.

    python -m tests.support.digests           compare; 1 when any differs
    python -m tests.support.digests --write   make them anew, after a change meant to alter drives
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from plant.world.file import load
from protocol.navigators import NAVIGATORS
from study.trial.trial import Trial, run_trial

FILE = Path(__file__).parents[1] / "data" / "digests.json"
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


def versions() -> dict[str, str]:
    return {name: metadata.version(name) for name in LIBRARIES}


def committed() -> dict[str, dict[str, str]]:
    """`digests` by run, and the `libraries` they were made with."""
    table: dict[str, dict[str, str]] = json.loads(FILE.read_text("utf-8"))
    return table


def difference(run: str, digest: str) -> str:
    """Return which digest differs, and whether other library versions may be the reason."""
    table = committed()
    known, made_with, here = table["digests"].get(run), table["libraries"], versions()
    libraries = "" if here == made_with else f"; made with {made_with}, here are {here}"
    return f"{run}: {digest} instead of the committed {known}{libraries}"


def write(found: dict[str, str]) -> None:
    table = {"libraries": versions(), "digests": dict(sorted(found.items()))}
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.support.digests", description=__doc__)
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
    known = committed()["digests"]
    differing = [name for name, digest in found.items() if known.get(name) != digest]
    print(f"Python {python}: {len(found) - len(differing)} of {len(found)} digests as committed")
    for name in differing:
        print(difference(name, found[name]))
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
