"""The verbs of `sidestep worlds` that make world files: generate, and import from elsewhere."""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from plant.corpus import FAMILIES, generate
from plant.world_problems import WorldError
from plant.world_toml import dumps
from plant.world_types import World

EXIT_OK: Final = 0
EXIT_USAGE: Final = 2
PER_FAMILY: Final = 27
MOST_PER_FAMILY: Final = 10_000


def add_verbs(verbs: "argparse._SubParsersAction[Any]") -> None:
    """Teach the command line of `sidestep worlds` to make files."""
    says = "make world files of the corpus: the same family, number and seed, the same world"
    one = verbs.add_parser("generate", help=says, description=says, allow_abbrev=False)
    one.add_argument(
        "--family", nargs="+", choices=FAMILIES, metavar="F", help=f"of {', '.join(FAMILIES)}; all"
    )
    one.add_argument(
        "--per-family",
        type=_count,
        default=PER_FAMILY,
        metavar="N",
        help=f"worlds of each, {PER_FAMILY} by default",
    )
    one.add_argument("--seed", type=_seed, default=1, metavar="S", help="1 by default")
    one.add_argument("--out", required=True, metavar="DIR", help="where the files go")


def make(arguments: argparse.Namespace) -> int:
    """Write the files and say how many; 2 when one cannot be written."""
    return write(_generated(arguments), Path(arguments.out))


def write(worlds: Iterable[tuple[World, str]], directory: Path) -> int:
    """Each world, with what its file opens with, as a file of its name."""
    count = 0
    try:
        for world, says in worlds:
            directory.mkdir(parents=True, exist_ok=True)
            path = directory / f"{world.name}.toml"
            path.write_text(dumps(world, says), encoding="utf-8")
            count += 1
    except WorldError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    except OSError as error:
        reason = error.strerror or str(error)
        fix = "give a directory that can be written to"
        print(f"{error.filename or directory}: --out: {reason}; fix: {fix}", file=sys.stderr)
        return EXIT_USAGE
    print(f"{count} worlds in {directory}")
    return EXIT_OK


def _generated(arguments: argparse.Namespace) -> Iterable[tuple[World, str]]:
    for family in dict.fromkeys(arguments.family or FAMILIES):
        for index in range(arguments.per_family):
            says = f"Number {index} of the family {family} from seed {arguments.seed}."
            yield generate(family, index, arguments.seed), says


def _count(text: str) -> int:
    return _whole(text, 1, MOST_PER_FAMILY)


def _seed(text: str) -> int:
    return _whole(text, 0, 2**53)


def _whole(text: str, low: int, high: int) -> int:
    value = int(text)
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text.strip()} is not within {low} to {high}")
    return value
