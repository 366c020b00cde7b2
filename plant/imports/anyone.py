"""Makes worlds of a file, whatever it is: by its suffix, with what the person wishes for."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Final

from plant.imports.barn import PITCH_M, CylinderField, load_grid, load_list
from plant.imports.cells import Cells
from plant.imports.cylinder_world import cylinder_world
from plant.imports.grid_world import grid_world
from plant.imports.made import ImportedWorld
from plant.imports.moving_ai import Scenario, fits, load_map, load_scenarios
from plant.imports.refusal import refuse
from plant.imports.ros_map import load_ros_map
from plant.model.types import Point, World

CELL_M: Final = 0.4
LONGEST_STEM: Final = 40
TAKES: Final = {
    ".map": ("cell", "start", "count", "window"),
    ".scen": ("cell", "count"),
    ".yaml": ("start", "count", "window"),
    ".yml": ("start", "count", "window"),
    ".npy": ("cell", "start"),
    ".csv": ("start", "count"),
    ".txt": ("start", "count"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """How to make worlds of a file. Start and goal are in the map's own frame, in metres.

    Without them they are chosen, by the seed; `window`: of a map a square of that many cells a
    side, chosen too.
    """

    cell_m: float | None = None
    start: Point | None = None
    goal: Point | None = None
    seed: int = 1
    count: int = 1
    window: int | None = None


def import_worlds(path: Path, wishes: ImportOptions) -> Iterator[World]:
    """As many worlds as wished for; raises WorldError."""
    kind = path.suffix.lower()
    _check(path, kind, wishes)
    if kind == ".scen":
        yield from _of_scenarios(path, wishes)
    elif kind == ".npy":
        yield from _of_field(path, "barn", load_grid(path, wishes.cell_m or PITCH_M), wishes)
    elif kind in (".csv", ".txt"):
        yield from _of_field(path, "cylinders", load_list(path), wishes)
    elif kind == ".map":
        yield from _of_cells(path, "moving_ai", load_map(path, wishes.cell_m or CELL_M), wishes)
    else:
        yield from _of_cells(path, "ros_map", load_ros_map(path), wishes)


def _check(path: Path, kind: str, wishes: ImportOptions) -> None:
    """Refuse a kind of file that is not known, and wishes that do not go together."""
    file = str(path)
    if kind not in TAKES:
        fix = "give the .yaml of a ROS map" if kind in (".pgm", ".png") else "give one of these"
        reason = f"no importer for {kind or 'a file without suffix'}; there are {', '.join(TAKES)}"
        raise refuse(file, "file", reason, fix)
    wished = {
        "cell": wishes.cell_m is not None,
        "start": wishes.start is not None or wishes.goal is not None,
        "count": wishes.count > 1,
        "window": wishes.window is not None,
    }
    for name, is_wished in wished.items():
        if is_wished and name not in TAKES[kind]:
            raise refuse(file, f"--{name}", f"not for a {kind} file", f"leave --{name} out")
    if (wishes.start is None) != (wishes.goal is None):
        raise refuse(file, "--start", "start and goal go together", "give both or neither")
    if wishes.start is not None and (wished["count"] or wished["window"]):
        fix = "leave them out, or leave start and goal out"
        raise refuse(file, "--start", "with --count or --window it is chosen", fix)


def _of_cells(path: Path, family: str, whole: Cells, wishes: ImportOptions) -> Iterator[World]:
    for index in range(wishes.count):
        random = _random(path, wishes, index)
        cells = whole if wishes.window is None else whole.window(random, wishes.window)
        cells = cells.trimmed()
        ends = None
        if wishes.start is not None and wishes.goal is not None:
            ends = cells.on_floor(wishes.start), cells.on_floor(wishes.goal)
        made = _made(path, family, wishes, ends, None if ends else index)
        yield grid_world(cells, made, random)


def _of_scenarios(path: Path, wishes: ImportOptions) -> Iterator[World]:
    """Some of its scenarios, chosen by the seed, on the map beside it."""
    scenarios = load_scenarios(path)
    if wishes.count > len(scenarios):
        reason = f"{wishes.count} asked for, {len(scenarios)} in the file"
        raise refuse(str(path), "--count", reason, "ask for fewer")
    random = _random(path, wishes, 0)
    for scenario in random.sample(scenarios, wishes.count):
        whole = load_map(_map_of(path, scenario), wishes.cell_m or CELL_M)
        fits(scenario, whole, str(path))
        cells = whole.trimmed()
        start, goal = (
            cells.on_floor(whole.centre(whole.rows - 1 - row, column))
            for column, row in (scenario.start, scenario.goal)
        )
        made = _made(path, "moving_ai", wishes, (start, goal), scenario.line)
        yield grid_world(cells, made, random)


def _map_of(path: Path, scenario: Scenario) -> Path:
    """The map that lies beside the scenarios, under their name or the one that they give."""
    named = scenario.map_name.replace("\\", "/").rsplit("/", 1)[-1]
    bare = path.with_suffix("")
    for beside in (bare, bare.with_suffix(".map"), path.parent / named):
        if beside.suffix.lower() == ".map" and beside.is_file():
            return beside
    fix = f"put {named} beside it"
    raise refuse(str(path), "map", f"{named} is not beside it", fix, scenario.line)


def _of_field(
    path: Path, family: str, field: CylinderField, wishes: ImportOptions
) -> Iterator[World]:
    ends = field.ends
    if wishes.start is not None and wishes.goal is not None:
        left, low = field.corner
        (x0, y0), (x1, y1) = wishes.start, wishes.goal
        ends = (x0 - left, y0 - low), (x1 - left, y1 - low)
    for index in range(wishes.count):
        made = _made(path, family, wishes, ends, None if ends else index)
        yield cylinder_world(field, made, _random(path, wishes, index))


def _made(
    path: Path,
    family: str,
    wishes: ImportOptions,
    ends: tuple[Point, Point] | None,
    index: int | None,
) -> ImportedWorld:
    stem = _stem(path)
    name = stem if index is None else f"{stem}_{wishes.seed}_{index:03d}"
    start, goal = ends or (None, None)
    return ImportedWorld(
        file=str(path), name=name, family=family, seed=wishes.seed, start=start, goal=goal
    )


def _random(path: Path, wishes: ImportOptions, index: int) -> Random:
    return Random(f"{_stem(path)}/{wishes.seed}/{index}")


def _stem(path: Path) -> str:
    """The file's name as a world's: without its suffixes, and nothing odd in it."""
    stem = path.name.removesuffix(path.suffix).removesuffix(".map")
    clean = re.sub(r"[^A-Za-z0-9._-]|^\.", "_", stem)
    return clean[:LONGEST_STEM] or "world"
