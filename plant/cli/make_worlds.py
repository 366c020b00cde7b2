"""The verbs of `sidestep worlds` that write world files: generate and import."""

import argparse
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from plant.corpus import CROWD_FAMILIES, FAMILIES, GRID_FAMILIES, generate
from plant.imports.anyone import CELL_M, TAKES, ImportOptions, import_worlds
from plant.imports.barn import PITCH_M
from plant.model.errors import Problem, WorldError
from plant.model.types import World, bad_name
from plant.world.to_toml import dumps
from protocol.options import whole

EXIT_OK: Final = 0
EXIT_USAGE: Final = 2
PER_FAMILY: Final = 27
MAX_PER_FAMILY: Final = 10_000
MIN_CELL_M: Final = 0.01
MAX_CELL_M: Final = 10.0
MAX_COORDINATE_M: Final = 1e6


def add_generate(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sidestep worlds generate`."""
    others = (*GRID_FAMILIES, *CROWD_FAMILIES)
    families = (*FAMILIES, *others)
    helps = f"of {', '.join(families)}; all but the last {len(others)} by default"
    parser.add_argument("--family", nargs="+", choices=families, metavar="F", help=helps)
    parser.add_argument(
        "--per-family",
        type=whole(1, MAX_PER_FAMILY),
        default=PER_FAMILY,
        metavar="N",
        help=f"worlds of each, {PER_FAMILY} by default",
    )
    _add_common(parser)


def add_import(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sidestep worlds import`."""
    text = f"{', '.join(TAKES)}; a ROS map is given by its .yaml file"
    parser.add_argument("file", metavar="FILE", help=text)
    parser.add_argument(
        "--cell",
        type=_cell,
        metavar="M",
        help=f"the size of a cell: of a Moving AI map {CELL_M} m, of a BARN grid {PITCH_M} m by"
        " default",
    )
    for end in ("start", "goal"):
        parser.add_argument(
            f"--{end}",
            type=_place,
            nargs=2,
            metavar=("X", "Y"),
            help="in metres in the map's own frame; chosen far apart by default",
        )
    parser.add_argument(
        "--count",
        type=whole(1, MAX_PER_FAMILY),
        default=1,
        metavar="N",
        help="number of worlds, 1 by default",
    )
    parser.add_argument(
        "--window",
        type=whole(1, MAX_PER_FAMILY),
        metavar="N",
        help="use a part of N x N cells of the map",
    )
    _add_common(parser)


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=whole(0, 2**53), default=1, metavar="S", help="1 by default")
    parser.add_argument("--out", required=True, metavar="DIR", help="directory of the files")


def make(arguments: argparse.Namespace) -> int:
    """Write the files and print their number; return 2 if one cannot be made or written."""
    worlds = _generated(arguments) if arguments.verb == "generate" else _imported(arguments)
    return write(worlds, Path(arguments.out))


def _imported(arguments: argparse.Namespace) -> Iterator[tuple[World, str]]:
    wishes = ImportOptions(
        cell_m=arguments.cell,
        start=tuple(arguments.start) if arguments.start else None,
        goal=tuple(arguments.goal) if arguments.goal else None,
        seed=arguments.seed,
        count=arguments.count,
        window=arguments.window,
    )
    path = Path(arguments.file)
    for world in import_worlds(path, wishes):
        yield world, f"Made of {path.name} with seed {arguments.seed}."


def write(worlds: Iterable[tuple[World, str]], directory: Path) -> int:
    """Write each world, with its comment, to a file of its name; return their number."""
    count = 0
    try:
        for world, comment in worlds:
            if why := bad_name(world.name):
                raise WorldError([Problem(str(directory), None, "name", why, "rename the file")])
            directory.mkdir(parents=True, exist_ok=True)
            path = directory / f"{world.name}.toml"
            path.write_text(dumps(world, comment), encoding="utf-8")
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


def _generated(arguments: argparse.Namespace) -> Iterator[tuple[World, str]]:
    for family in dict.fromkeys(arguments.family or FAMILIES):
        for index in range(arguments.per_family):
            comment = f"Number {index} of the family {family} from seed {arguments.seed}."
            yield generate(family, index, arguments.seed), comment


def _cell(text: str) -> float:
    value = float(text)
    if not MIN_CELL_M <= value <= MAX_CELL_M:
        limits = f"{MIN_CELL_M:g} to {MAX_CELL_M:g} m"
        raise argparse.ArgumentTypeError(f"{text.strip()} is not within {limits}")
    return value


def _place(text: str) -> float:
    value = float(text)
    if not abs(value) <= MAX_COORDINATE_M:
        raise argparse.ArgumentTypeError(f"{text.strip()} is not within {MAX_COORDINATE_M:g} m")
    return value
