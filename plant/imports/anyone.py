"""Import worlds from a file of any supported format, chosen by its suffix."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from plant.imports.barn import PITCH_M, CylinderField, load_grid, load_list
from plant.imports.cells import Cells
from plant.imports.cylinder_world import cylinder_world
from plant.imports.grid_world import grid_world
from plant.imports.made import ImportedWorld
from plant.imports.moving_ai import Scenario, fits, load_map, load_scenarios
from plant.imports.refusal import refuse
from plant.imports.ros_map import load_ros_map
from plant.model.draws import Draws
from plant.model.types import Point, World

CELL_M: Final = 0.4
MAX_STEM_LENGTH: Final = 40
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
    """Options of an import. Start and goal are in the map's own frame, in metres.

    Without them the seed selects both. `window`: use a square part of the map with that many cells
    a side, also selected by the seed.
    """

    cell_m: float | None = None
    start: Point | None = None
    goal: Point | None = None
    seed: int = 1
    count: int = 1
    window: int | None = None


def import_worlds(path: Path, options: ImportOptions) -> Iterator[World]:
    """Yield the requested number of worlds; raise WorldError."""
    kind = path.suffix.lower()
    _check(path, kind, options)
    if kind == ".scen":
        yield from _of_scenarios(path, options)
    elif kind == ".npy":
        yield from _of_field(path, "barn", load_grid(path, options.cell_m or PITCH_M), options)
    elif kind in (".csv", ".txt"):
        yield from _of_field(path, "cylinders", load_list(path), options)
    elif kind == ".map":
        yield from _of_cells(path, "moving_ai", load_map(path, options.cell_m or CELL_M), options)
    else:
        yield from _of_cells(path, "ros_map", load_ros_map(path), options)


def _check(path: Path, kind: str, options: ImportOptions) -> None:
    """Refuse unknown kinds of files, and options that cannot be combined."""
    file = str(path)
    if kind not in TAKES:
        fix = "give the .yaml of a ROS map" if kind in (".pgm", ".png") else "give one of these"
        reason = f"no importer for {kind or 'a file without suffix'}; there are {', '.join(TAKES)}"
        raise refuse(file, "file", reason, fix)
    wished = {
        "cell": options.cell_m is not None,
        "start": options.start is not None or options.goal is not None,
        "count": options.count > 1,
        "window": options.window is not None,
    }
    for name, is_wished in wished.items():
        if is_wished and name not in TAKES[kind]:
            raise refuse(file, f"--{name}", f"not for a {kind} file", f"leave --{name} out")
    if (options.start is None) != (options.goal is None):
        raise refuse(file, "--start", "start and goal go together", "give both or neither")
    if options.start is not None and (wished["count"] or wished["window"]):
        fix = "leave them out, or leave start and goal out"
        raise refuse(file, "--start", "with --count or --window it is chosen", fix)


def _of_cells(path: Path, family: str, whole: Cells, options: ImportOptions) -> Iterator[World]:
    for index in range(options.count):
        random = _random(path, options, index)
        cells = whole if options.window is None else whole.window(random, options.window)
        cells = cells.trimmed()
        ends = None
        if options.start is not None and options.goal is not None:
            ends = cells.on_floor(options.start), cells.on_floor(options.goal)
        made = _made(path, family, options, ends, None if ends else index)
        yield grid_world(cells, made, random)


def _of_scenarios(path: Path, options: ImportOptions) -> Iterator[World]:
    """Yield worlds of some scenarios, selected by the seed, on the map beside their file."""
    scenarios = load_scenarios(path)
    if options.count > len(scenarios):
        reason = f"{options.count} asked for, {len(scenarios)} in the file"
        raise refuse(str(path), "--count", reason, "ask for fewer")
    random = _random(path, options, 0)
    for scenario in random.sample(scenarios, options.count):
        whole = load_map(_map_of(path, scenario), options.cell_m or CELL_M)
        fits(scenario, whole, str(path))
        cells = whole.trimmed()
        start, goal = (
            cells.on_floor(whole.centre(whole.rows - 1 - row, column))
            for column, row in (scenario.start, scenario.goal)
        )
        made = _made(path, "moving_ai", options, (start, goal), scenario.line)
        yield grid_world(cells, made, random)


def _map_of(path: Path, scenario: Scenario) -> Path:
    """Return the map beside the scenarios, with their name or the name they contain."""
    named = scenario.map_name.replace("\\", "/").rsplit("/", 1)[-1]
    bare = path.with_suffix("")
    for beside in (bare, bare.with_suffix(".map"), path.parent / named):
        if beside.suffix.lower() == ".map" and beside.is_file():
            return beside
    fix = f"put {named} beside it"
    raise refuse(str(path), "map", f"{named} is not beside it", fix, scenario.line)


def _of_field(
    path: Path, family: str, field: CylinderField, options: ImportOptions
) -> Iterator[World]:
    ends = field.ends
    if options.start is not None and options.goal is not None:
        left, low = field.corner
        (x0, y0), (x1, y1) = options.start, options.goal
        ends = (x0 - left, y0 - low), (x1 - left, y1 - low)
    for index in range(options.count):
        made = _made(path, family, options, ends, None if ends else index)
        yield cylinder_world(field, made, _random(path, options, index))


def _made(
    path: Path,
    family: str,
    options: ImportOptions,
    ends: tuple[Point, Point] | None,
    index: int | None,
) -> ImportedWorld:
    stem = _stem(path)
    name = stem if index is None else f"{stem}_{options.seed}_{index:03d}"
    start, goal = ends or (None, None)
    return ImportedWorld(
        file=str(path), name=name, family=family, seed=options.seed, start=start, goal=goal
    )


def _random(path: Path, options: ImportOptions, index: int) -> Draws:
    return Draws(f"{_stem(path)}/{options.seed}/{index}")


def _stem(path: Path) -> str:
    """Return a valid name of a world from the file's name without suffixes."""
    stem = path.name.removesuffix(path.suffix).removesuffix(".map")
    clean = re.sub(r"[^A-Za-z0-9._-]|^\.", "_", stem)
    return clean[:MAX_STEM_LENGTH] or "world"
