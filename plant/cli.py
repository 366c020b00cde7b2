"""`sidestep worlds`: list, check and show worlds, generate them, and import maps."""

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

from plant.corpus import EVERY_FAMILY, FAMILIES, generate
from plant.imports.barn import PITCH_M
from plant.imports.cells import MAX_COORDINATE_M
from plant.imports.importer import BAG, CELL_M, TAKES, ImportOptions, import_worlds
from plant.imports.ros_bag import CELL_M as BAG_CELL_M
from plant.model.configuration import KINDS, body_of
from plant.model.errors import WorldError, WorldProblem
from plant.placement import goals, starts
from plant.shortest_path import known_length_m, shortest_path
from plant.world.file import SHIPPED_DIR, load, shipped
from plant.world.writer import Json, draw, dumps, places_json
from protocol.options import finite, numbers_kept, whole
from protocol.world import Point, World, WorldCircle, as_json, bad_name
from runtime.cli.parsers import add_subcommands, new_parser
from runtime.errors import EXIT_OK, EXIT_USAGE
from runtime.files import replace

PER_FAMILY: Final = 27
MAX_PER_FAMILY: Final = 10_000
MIN_CELL_M: Final = 0.01
MAX_CELL_M: Final = 10.0


def add_generate(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `sidestep worlds generate`."""
    helps = f"of {', '.join(EVERY_FAMILY)}; the first {len(FAMILIES)} by default"
    parser.add_argument("--family", nargs="+", choices=EVERY_FAMILY, metavar="F", help=helps)
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
    kinds = ", ".join(kind for kind in TAKES if kind != BAG)
    text = f"{kinds}, or the folder of a bag of ROS 2; a ROS map is given by its .yaml file"
    parser.add_argument("file", metavar="FILE", help=text)
    parser.add_argument(
        "--cell",
        type=_cell,
        metavar="M",
        help=f"the size of a cell: of a Moving AI map {CELL_M} m, of a BARN grid {PITCH_M} m,"
        f" of the drive in a bag {BAG_CELL_M} m by default",
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
    text = "replace files of other worlds of these names"
    parser.add_argument("--force", action="store_true", help=text)


def make(arguments: argparse.Namespace) -> int:
    """Write the files and print their number; return 2 if one cannot be made or written."""
    worlds = _generated(arguments) if arguments.verb == "generate" else _imported(arguments)
    return write(worlds, Path(arguments.out), force=arguments.force)


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


def write(worlds: Iterable[tuple[World, str]], directory: Path, *, force: bool = False) -> int:
    """Write each world, with its comment, to a file of its name, and print their number.

    A file with another world is only replaced by `force`. Returns the exit code.
    """
    count, path = 0, directory
    try:
        for world, comment in worlds:
            if why := bad_name(world.name):
                raise WorldError(
                    [WorldProblem(str(directory), None, "name", why, "rename the file")]
                )
            directory.mkdir(parents=True, exist_ok=True)
            path, text = directory / f"{world.name}.toml", dumps(world, comment)
            if not force and path.exists() and path.read_bytes() != text.encode():
                fix = "give another --out, rename the map, or --force to replace it"
                problem = WorldProblem(str(path), None, "name", "another world is there", fix)
                raise WorldError([problem])
            replace(path, text)
            count += 1
    except WorldError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    except OSError as error:
        reason = error.strerror or str(error)
        fix = "give a directory that can be written to"
        print(f"{error.filename or directory}: --out: {reason}; fix: {fix}", file=sys.stderr)
        return EXIT_USAGE
    print(
        f"1 world in {directory}: {path.name}" if count == 1 else f"{count} worlds in {directory}"
    )
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


MANY_CORNERS: Final = 120


def main(argv: Sequence[str]) -> int:
    """Run one of the verbs; return 0, or 2 for a bad file or wrong usage."""
    try:
        arguments = parser().parse_args(numbers_kept(argv))
    except SystemExit as done:
        return EXIT_OK if done.code in (0, None) else EXIT_USAGE
    if arguments.verb == "list":
        return _list(arguments.json)
    if arguments.verb == "faults":
        return _faults(arguments.json)
    if arguments.verb in ("generate", "import"):
        return make(arguments)
    try:
        world = load(arguments.world)
    except WorldError as error:
        return _refuse(arguments, error)
    if arguments.verb == "check":
        return _check(arguments.world, world, arguments.json)
    return _show(world, arguments)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    parser = new_parser("worlds")
    verbs = add_subcommands(parser, "worlds", dest="verb", allow_abbrev=False)
    for verb in ("check", "show"):
        verbs[verb].add_argument("world", metavar="FILE", help="a .toml file or a shipped name")
    for verb in ("list", "faults", "check", "show"):
        verbs[verb].add_argument("--json", action="store_true", help="print one JSON object")
    verbs["show"].add_argument(
        "--robots", type=int, metavar="K", help="with --json: their starts and goals, too"
    )
    verbs["show"].add_argument(
        "--goal", type=finite, nargs=2, metavar=("X", "Y"), help="instead of the world's"
    )
    add_generate(verbs["generate"])
    add_import(verbs["import"])
    return parser


def _print_json(found: dict[str, Json]) -> None:
    print(json.dumps(found, allow_nan=False))


def _first_comment(name: str) -> str:
    """Return the comment in the first line of a shipped file."""
    with (SHIPPED_DIR / f"{name}.toml").open(encoding="utf-8") as file:
        return file.readline().removeprefix("#").strip()


def _list(as_object: bool) -> int:
    names = shipped()
    if as_object:
        _print_json({"worlds": [{"name": name, "says": _first_comment(name)} for name in names]})
    else:
        width = max(len(name) for name in names)
        for name in names:
            print(f"{name:<{width}}  {_first_comment(name)}")
    return EXIT_OK


def _faults(as_object: bool) -> int:
    if as_object:
        faults: list[Json] = [
            {"kind": kind, "targets": list(about.targets), "unit": about.unit, "says": about.doc}
            for kind, about in KINDS.items()
        ]
        _print_json({"faults": faults})
    else:
        for kind, about in KINDS.items():
            print(f"{kind:<14}  {about.doc}")
    return EXIT_OK


def _refuse(arguments: argparse.Namespace, error: WorldError) -> int:
    print(error, file=sys.stderr)
    if arguments.json and arguments.verb == "check":
        problems: list[Json] = [dict(problem._asdict()) for problem in error.problems]
        _print_json({"ok": False, "file": arguments.world, "problems": problems})
    return EXIT_USAGE


def _check(file: str, world: World, as_object: bool) -> int:
    length_m = known_length_m(world)
    if as_object:
        _print_json({"ok": True, "file": file, "name": world.name, "problems": []})
        return EXIT_OK
    way = "the goal cannot be reached" if length_m is None else f"shortest way {length_m:.2f} m"
    print(f"{file}: ok: {world.name}, {len(world.obstacles)} obstacles, {way}")
    return EXIT_OK


def _show(world: World, arguments: argparse.Namespace) -> int:
    try:
        places = _places(world, arguments)
    except ValueError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    if arguments.json:
        _print_json(as_json(world, known_length_m(world)) | places)
    else:
        print(draw(world, _path_to_draw(world)))
    return EXIT_OK


def _path_to_draw(world: World) -> list[Point] | None:
    """Return the shortest path; None if it is slow to compute and its length is known."""
    corners = sum(
        1 if isinstance(one, WorldCircle) else len(one.points_m) for one in world.obstacles
    )
    is_length_known = world.reachable is False or world.shortest_path_m is not None
    return None if is_length_known and corners > MANY_CORNERS else shortest_path(world)


def _places(world: World, arguments: argparse.Namespace) -> dict[str, Json]:
    """Return start and goal of each robot. Raises ValueError without enough room."""
    if arguments.robots is None:
        return {}
    body = body_of(world)
    found = starts(world, body, arguments.robots)
    goal = tuple(arguments.goal) if arguments.goal else (world.goal.x_m, world.goal.y_m)
    return places_json(found, goals(world, body, found, goal))
