"""Read maps and scenarios of the Moving AI benchmarks (movingai.com/benchmarks/formats.html)."""

import re
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from plant.imports.cells import Cells
from plant.model.errors import read_text, refuse

MAX_BYTES: Final = 32_000_000
MAX_CELLS: Final = 4096
FREE: Final = ".GS"
BLOCKED: Final = "@OTW"
HEADER: Final = 4
FIELDS: Final = 9
NUMBER: Final = re.compile(r"\d{1,9}", re.ASCII)


class MovingAiScenario(NamedTuple):
    """One line of a .scen file: cells as (column, row), counted from the upper left one."""

    line: int
    map_name: str
    width: int
    height: int
    start: tuple[int, int]
    goal: tuple[int, int]


def load_map(path: Path, cell_m: float) -> Cells:
    """Return the map of a file; raise only WorldError."""
    return parse_map(read_text(path, MAX_BYTES), str(path), cell_m)


def parse_map(text: str, file: str, cell_m: float) -> Cells:
    """Return the map that a text describes, its first line at the top."""
    lines = text.split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    sizes = _header(lines, file)
    rows = lines[HEADER:]
    if len(rows) != sizes["height"]:
        reason = f"{len(rows)} rows of cells, but height is {sizes['height']}"
        raise refuse(file, "map", reason, "is the file truncated? write height rows")
    blocked = [
        _row(row, number, file, sizes["width"]) for number, row in enumerate(rows, HEADER + 1)
    ]
    return Cells(np.array(blocked[::-1], dtype=bool), cell_m)


def _header(lines: list[str], file: str) -> dict[str, int]:
    """Return width and height, which may be in any order."""
    head = [line.split() for line in lines[:HEADER]]
    if not head or head[0] != ["type", "octile"]:
        found = lines[0][:40] if lines else ""
        reason = f"expected type octile, found {found!r}"
        raise refuse(file, "type", reason, "give a Moving AI .map file", 1)
    sizes: dict[str, int] = {}
    for number, key in ((2, "height"), (3, "width")):
        words = head[number - 1] if number <= len(head) else []
        name = words[0] if words and words[0] in ("height", "width") else key
        value = words[1] if len(words) == 2 and NUMBER.fullmatch(words[1]) else "0"
        if not words or words[0] != name or name in sizes or not 1 <= int(value) <= MAX_CELLS:
            found = lines[number - 1][:40] if number <= len(lines) else ""
            fix = f"write {key} and a whole number of 1 to {MAX_CELLS}"
            raise refuse(file, key, f"found {found!r}", fix, number)
        sizes[name] = int(value)
    if len(head) < HEADER or head[3] != ["map"]:
        raise refuse(file, "map", "missing", "write map on the fourth line, then the rows", HEADER)
    return sizes


def _row(row: str, line: int, file: str, width: int) -> list[bool]:
    row = row.rstrip(" \t\r")
    for column, one in enumerate(row, 1):
        if one not in FREE and one not in BLOCKED:
            reason = f"{one!r} in column {column} is no terrain"
            fix = f"write {' '.join(FREE)} where it is free, {' '.join(BLOCKED)} where it is not"
            raise refuse(file, "map", reason, fix, line)
    if len(row) != width:
        reason = f"{len(row)} cells in this row, but width is {width}"
        raise refuse(file, "map", reason, "is the file truncated? write width cells", line)
    return [one in BLOCKED for one in row]


def load_scenarios(path: Path) -> list[MovingAiScenario]:
    """Return the scenarios of a file, at least one; raise WorldError."""
    return parse_scenarios(read_text(path, MAX_BYTES), str(path))


def parse_scenarios(text: str, file: str) -> list[MovingAiScenario]:
    """Return the scenarios of a text, at least one; raise WorldError."""
    lines = text.split("\n")
    if not re.fullmatch(r"version 1(\.0)?\s*", lines[0]):
        reason = f"expected version 1, found {lines[0][:40]!r}"
        raise refuse(file, "version", reason, "give a Moving AI .scen file of version 1", 1)
    found = [
        _scenario(line, number, file) for number, line in enumerate(lines[1:], 2) if line.strip()
    ]
    if not found:
        raise refuse(file, "scenario", "none in the file", "give one with scenarios in it", 1)
    return found


def _scenario(line: str, number: int, file: str) -> MovingAiScenario:
    fields = line.split("\t") if "\t" in line else line.split()
    numbers = fields[2:8]
    if len(fields) != FIELDS or not all(NUMBER.fullmatch(one.strip()) for one in numbers):
        reason = f"expected {FIELDS} fields, six of them whole numbers, found {line[:60]!r}"
        fix = "write bucket, map, width, height, start x, start y, goal x, goal y, length"
        raise refuse(file, "scenario", reason, fix, number)
    width, height, start_x, start_y, goal_x, goal_y = (int(one.strip()) for one in numbers)
    return MovingAiScenario(number, fields[1], width, height, (start_x, start_y), (goal_x, goal_y))


def fits(scenario: MovingAiScenario, cells: Cells, file: str) -> None:
    """Refuse a scenario for a map of another size, or with an end outside or on a blocked cell."""
    if (scenario.width, scenario.height) != (cells.columns, cells.rows):
        reason = f"made for {scenario.width} x {scenario.height} cells, "
        reason += f"the map has {cells.columns} x {cells.rows}"
        raise refuse(file, "map", reason, "give it the map it was made for", scenario.line)
    for key, (column, row) in (("start", scenario.start), ("goal", scenario.goal)):
        inside = column < cells.columns and row < cells.rows
        if not inside or cells.blocked[cells.rows - 1 - row, column]:
            where = "on a blocked cell" if inside else "outside the map"
            reason = f"({column}, {row}) is {where}"
            raise refuse(file, key, reason, "choose a free cell of the map", scenario.line)
