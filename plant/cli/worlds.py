"""`sidestep worlds`: list shipped worlds, check a world file, show a world as map or JSON."""

import argparse
import json
import sys
from collections.abc import Sequence
from math import isfinite
from typing import Final

from plant.cli.make_worlds import add_generate, add_import, make
from plant.model.configuration import body_of
from plant.model.errors import WorldError
from plant.model.faults import KINDS
from plant.model.types import Circle, Point, World
from plant.placement.fleet_goals import goals
from plant.placement.shortest_path import known_length_m, shortest_path
from plant.placement.start_positions import starts
from plant.world.file import SHIPPED_DIR, load, shipped
from plant.world.text import draw
from plant.world.to_json import Json, as_json, places_json
from protocol.options import numbers_kept
from runtime.cli.parsers import add_subcommands, new_parser

MANY_CORNERS: Final = 120
EXIT_OK = 0
EXIT_USAGE = 2


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
        "--goal", type=_finite, nargs=2, metavar=("X", "Y"), help="instead of the world's"
    )
    add_generate(verbs["generate"])
    add_import(verbs["import"])
    return parser


def _finite(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"{text.strip()} is not a finite number")
    return value


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
    corners = sum(1 if isinstance(one, Circle) else len(one.points_m) for one in world.obstacles)
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
