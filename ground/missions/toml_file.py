"""Read and write TOML mission files: `[[waypoint]]` tables, optional `[fence]` and `[home]`."""

import re
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final, TypeVar

from ground.missions.mission import Circle, Fence, Home, Mission, Polygon, Waypoint
from ground.missions.outline import fault_of
from ground.missions.problems import MissionError, Problem, line_of
from runtime.config import parse, unknown_key
from runtime.errors import ConfigError
from runtime.toml_reader import Key, key_lines, table_in

T = TypeVar("T")
PART: Final = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
TOP: Final = ("waypoint", "fence", "home")
FENCE_FIX: Final = (
    "circle = { x_m = 0, y_m = 0, radius_m = 5 } or corners = [[0, 0], [4, 0], [4, 3]]"
)


def read_text(text: str, file: str, *, bare: bool = False) -> Mission:
    """Parse a mission; MissionError lists every wrong key with its line.

    `bare` allows a file without waypoints.
    """
    try:
        table = table_in(text)
    except ValueError as error:
        problem = Problem("", str(error), "correct the TOML syntax there")
        raise MissionError(file, [problem]) from error
    return _Reader(file, key_lines(text)).mission(table, bare=bare)


class _Reader:
    """Reads the tables of one file and collects their problems."""

    def __init__(self, file: str, lines: Mapping[Key, int]) -> None:
        self._file = file
        self._lines = lines
        self._problems: list[Problem] = []

    def mission(self, table: Mapping[str, Any], *, bare: bool) -> Mission:
        """Return the mission; MissionError lists the problems."""
        for key in table:
            if key not in TOP:
                error = unknown_key(key, key, list(TOP), file=self._file)
                self._blame((key,), error.reason, error.fix)
        none_needed = bare and "waypoint" not in table
        waypoints = () if none_needed else self._waypoints(table.get("waypoint"))
        fence = self._fence(table["fence"]) if "fence" in table else None
        home = self._table(table["home"], Home, ("home",)) if "home" in table else None
        if self._problems:
            raise MissionError(self._file, self._problems)
        return Mission(waypoints=waypoints, fence=fence, home=home)

    def _waypoints(self, tables: object) -> tuple[Waypoint, ...]:
        if not isinstance(tables, list) or not tables:
            what = "there is none" if tables in (None, []) else "is not a list of tables"
            self._blame(("waypoint",), what, "add [[waypoint]] with x_m and y_m")
            return ()
        read = [self._table(one, Waypoint, ("waypoint", at)) for at, one in enumerate(tables)]
        return tuple(waypoint for waypoint in read if waypoint is not None)

    def _fence(self, table: object) -> Fence | None:
        if not isinstance(table, dict) or set(table) not in ({"circle"}, {"corners"}):
            self._blame(("fence",), "is neither a circle nor corners", f"write {FENCE_FIX}")
            return None
        if "circle" in table:
            return self._table(table["circle"], Circle, ("fence", "circle"))
        polygon = self._table(table, Polygon, ("fence",))
        fault = "" if polygon is None else fault_of(polygon.corners)
        if fault:
            self._blame(("fence", "corners"), fault, "put the corners in order, round the place")
        return polygon

    def _table(self, table: object, schema: type[T], key: Key) -> T | None:
        if not isinstance(table, dict):
            names = ", ".join(field.name for field in fields(schema))  # type: ignore[arg-type]
            self._blame(key, "is not a table", f"it has {names}")
            return None
        rest, blamed = dict(table), set[str]()
        for _ in range(2 * (len(table) + len(fields(schema)))):  # type: ignore[arg-type]
            try:
                found = parse(rest, schema, file=self._file)
            except ConfigError as error:
                parts = _parts(error.key)
                name = str(parts[0]) if parts else ""
                if name not in blamed:
                    self._blame((*key, *parts), error.reason, error.fix)
                blamed.add(name)
                if name in rest:
                    del rest[name]  # the next round finds the next fault
                else:
                    rest[name] = 0.0  # stands in for a key that must be there
            else:
                return None if blamed else found
        return None

    def _blame(self, key: Key, reason: str, fix: str) -> None:
        self._problems.append(Problem(_words(key), reason, fix, line_of(self._lines, key)))


def _parts(words: str) -> Key:
    """Return the key of a text such as `corners[0][1]`."""
    parts = PART.findall(words)
    return tuple(int(index) if index else name for name, index in parts)


def _words(key: Key) -> str:
    """Return a key as text such as `waypoint[2].x_m`."""
    words = ""
    for part in key:
        words += f"[{part}]" if isinstance(part, int) else f"{'.' if words else ''}{part}"
    return words


def text_of(mission: Mission) -> str:
    """Return the text of a file that reads back as the same mission."""
    blocks = [_block("[[waypoint]]", waypoint, Waypoint) for waypoint in mission.waypoints]
    if isinstance(mission.fence, Circle):
        blocks.append(_block("[fence.circle]", mission.fence, Circle))
    elif mission.fence is not None:
        corners = "".join(f"  [{x!r}, {y!r}],\n" for x, y in mission.fence.corners)
        blocks.append(f"[fence]\ncorners = [\n{corners}]\n")
    if mission.home is not None:
        blocks.append(_block("[home]", mission.home, Home))
    return "\n".join(blocks)


def _block(header: str, value: object, schema: type[Any]) -> str:
    """Return a table without values that equal their defaults."""
    lines = [header]
    for field in fields(schema):
        number = getattr(value, field.name)
        if number is not None and number != field.default:
            lines.append(f"{field.name} = {float(number)!r}")
    return "\n".join(lines) + "\n"
