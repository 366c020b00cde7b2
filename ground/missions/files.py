"""Read and write mission files: `.toml`, and `.plan` and `.waypoints` of QGroundControl.

A `.toml` file has `[[waypoint]]` tables, and optionally `[fence]` and `[home]`. A table with a
`command` is an item of MAVLink without a place.

Edit a mission waypoint by waypoint before it is saved or sent.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final, TypeVar

from ground.missions import qgroundcontrol
from ground.missions.mission import (
    EVERYWHERE,
    Circle,
    Fence,
    Home,
    MavlinkItem,
    Mission,
    MissionError,
    Outline,
    Polygon,
    Problem,
    Step,
    Waypoint,
    Zones,
    fault_of,
    fence_with,
    is_allowed,
    line_of,
    zones_of,
)
from ground.missions.qgroundcontrol import (
    PLACED,
    Foreign,
    Item,
    UnsupportedItemError,
    kept,
    lost,
    step_of,
    target_of,
    waypoint_in,
)
from runtime.config import parse, unknown_key
from runtime.errors import ConfigError, UserError
from runtime.files import replace_named, text_in
from runtime.toml_reader import Key, key_lines, table_in

ENDINGS: Final = (".toml", ".plan", ".waypoints")
LARGEST_BYTES: Final = 1_000_000
DASH: Final = Path("-")
"""Path of TOML text without a file: standard input, or the draft of a console."""


def read(path: Path, *, home: Home | None = None, drop: bool = False) -> Foreign:
    """Read a mission file; MissionError lists all problems."""
    return read_text(_text(path), path, home=home, drop=drop)


def read_text(text: str, path: Path, *, home: Home | None = None, drop: bool = False) -> Foreign:
    """Read a mission from text; DASH means TOML."""
    ending = ".toml" if path == DASH else ending_of(path)
    if ending == ".plan":
        found = qgroundcontrol.read_plan(text, str(path), home=home, drop=drop)
    elif ending == ".waypoints":
        found = qgroundcontrol.read_waypoints(text, str(path), home=home, drop=drop)
    else:
        mission = read_toml(text, str(path))
        found = Foreign(replace(mission, home=home or mission.home))
    _judge_places(found.mission, str(path))
    return found


def read_fence(path: Path) -> Fence:
    """Read the fence of a mission file, which needs no waypoints."""
    text, ending = _text(path), ending_of(path)
    fix = "draw one in QGroundControl" if ending == ".plan" else f"add [fence] with {FENCE_FIX}"
    if ending == ".waypoints":
        raise UserError(f"{path}: a .waypoints file has no fence; give a .plan or a .toml")
    if ending == ".plan":
        fence = qgroundcontrol.read_plan_fence(text, str(path))
    else:
        fence = read_toml(text, str(path), bare=True).fence
    if fence is None:
        raise UserError(f"{path}: has no fence; {fix}")
    return fence


def _judge_places(mission: Mission, file: str) -> None:
    """Raise MissionError for waypoints outside the mission's own fence, and jumps out of it."""
    problems = [
        Problem(f"waypoint {at}", f"{waypoint} is outside of the fence", "move it or the fence")
        for at, waypoint in mission.places
        if mission.fence is not None and not is_allowed(mission.fence, (waypoint.x_m, waypoint.y_m))
    ]
    count = len(mission.waypoints)
    problems += [
        Problem(f"item {at}", f"{step}, but there are only {count} items", "correct the item")
        for at, step in enumerate(mission.waypoints, start=1)
        if isinstance(step, MavlinkItem) and (target_of(step) or 0) > count
    ]
    if problems:
        raise MissionError(file, problems)


def write(path: Path, mission: Mission) -> tuple[str, ...]:
    """Write a file completely or not at all; return what the format cannot hold, in words."""
    ending = ending_of(path)
    if ending == ".toml":
        text, without = toml_text(mission), []
    else:
        if mission.home is None:
            fix = "add [home] to the TOML, or use --home LATITUDE LONGITUDE"
            raise MissionError(str(path), [Problem("", f"a {ending} needs a home", fix)])
        without = lost(mission)
        if ending == ".plan":
            text = qgroundcontrol.plan_text(mission, mission.home)
        else:
            text = qgroundcontrol.waypoints_text(mission, mission.home)
            without += ["the fence"] if mission.fence else []
    replace_named(path, text)
    return tuple(without)


def written(path: Path, mission: Mission, without: Sequence[str]) -> str:
    """Report a written file, in words."""
    return f"{path}: {mission}{''.join(f'; {what} is lost' for what in without)}"


def ending_of(path: Path) -> str:
    """Return the suffix; UserError for one that is not supported."""
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        *others, last = ENDINGS
        raise UserError(f"{path}: a mission file ends in {', '.join(others)} or {last}")
    return ending


def _text(path: Path) -> str:
    ending_of(path)
    try:
        return text_in(path, LARGEST_BYTES)
    except OSError as error:
        why = (error.strerror or "cannot be read").lower()
        fix = "name a mission file, such as one that `sidestep mission download FILE` has written"
        raise UserError(f"{path}: {why}: {fix}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: is not UTF-8 text; save it as UTF-8") from error


T = TypeVar("T")
PART: Final = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
TOP: Final = ("waypoint", "fence", "home")
FENCE_FIX: Final = (
    "circle = { x_m = 0, y_m = 0, radius_m = 5 } or corners = [[0, 0], [4, 0], [4, 3]]"
)


def read_toml(text: str, file: str, *, bare: bool = False) -> Mission:
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

    def _waypoints(self, tables: object) -> tuple[Step, ...]:
        if not isinstance(tables, list) or not tables:
            what = "there is none" if tables in (None, []) else "is not a list of tables"
            self._blame(("waypoint",), what, "add [[waypoint]] with x_m and y_m")
            return ()
        read = [self._step(one, ("waypoint", at)) for at, one in enumerate(tables)]
        return tuple(step for step in read if step is not None)

    def _step(self, table: object, key: Key) -> Step | None:
        """Return a waypoint, or an item without a place.

        The item that a waypoint was is kept while the other values follow from it.
        """
        if not isinstance(table, dict) or "command" not in table:
            found = self._table(table, Waypoint, key)
            return None if found is None else as_read(found)
        item = self._table(table, MavlinkItem, key)
        try:
            if item is None or item.command not in PLACED:
                return item and step_of(
                    Item(0, item.command, item.frame, item.params, item.autocontinue), None
                )
            self._blame(key, f"command {item.command} needs a place", "write x_m and y_m instead")
        except UnsupportedItemError as error:
            self._blame((*key, "params"), str(error), "correct the item")
        return None

    def _fence(self, table: object) -> Fence | None:
        """Return the fence, with the exclusions in it."""
        if not isinstance(table, dict) or "exclusion" not in table:
            return self._outline(table, ("fence",))
        listed, key = table["exclusion"], ("fence", "exclusion")
        if not isinstance(listed, list):
            self._blame(key, "is not a list of tables", "write [[fence.exclusion]]")
            return None
        rest = {name: value for name, value in table.items() if name != "exclusion"}
        drawn = [(True, self._outline(rest, ("fence",)))] if rest else []
        drawn += [(False, self._outline(one, (*key, at))) for at, one in enumerate(listed)]
        return fence_with([(stays, outline) for stays, outline in drawn if outline is not None])

    def _outline(self, table: object, key: Key) -> Outline | None:
        if not isinstance(table, dict) or set(table) not in ({"circle"}, {"corners"}):
            self._blame(key, "is neither a circle nor corners", f"write {FENCE_FIX}")
            return None
        if "circle" in table:
            return self._table(table["circle"], Circle, (*key, "circle"))
        polygon = self._table(table, Polygon, key)
        fault = "" if polygon is None else fault_of(polygon.corners)
        if fault:
            self._blame((*key, "corners"), fault, "put the corners in order, round the place")
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


def as_read(waypoint: Waypoint) -> Waypoint:
    """Return a waypoint without the item that it was, if other values were typed since."""
    if (mavlink := waypoint.mavlink) is None:
        return waypoint
    with suppress(UnsupportedItemError):
        item = Item(0, mavlink.command, mavlink.frame, mavlink.params, mavlink.autocontinue)
        found = waypoint_in(kept(item, mavlink.params), waypoint.x_m, waypoint.y_m)
        if found == waypoint:
            return found
    return replace(waypoint, mavlink=None)


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


def toml_text(mission: Mission) -> str:
    """Return the text of a file that reads back as the same mission."""
    blocks = [_step_block(step) for step in mission.waypoints]
    if mission.fence is not None:
        blocks += _fence_blocks(zones_of(mission.fence))
    if mission.home is not None:
        blocks.append(_block("[home]", mission.home, Home))
    return "\n".join(blocks)


def _fence_blocks(zones: Zones) -> list[str]:
    shown = [] if zones.outline == EVERYWHERE else [_outline_block("[fence]", zones.outline)]
    return shown + [_outline_block("[[fence.exclusion]]", one) for one in zones.exclusions]


def _outline_block(header: str, outline: Outline) -> str:
    if isinstance(outline, Polygon):
        corners = "".join(f"  [{x!r}, {y!r}],\n" for x, y in outline.corners)
        return f"{header}\ncorners = [\n{corners}]\n"
    inner = _block("", outline, Circle).strip().replace("\n", ", ")
    return f"{header}\ncircle = {{ {inner} }}\n"


def _step_block(step: Step) -> str:
    if isinstance(step, MavlinkItem):
        return _mavlink_block("[[waypoint]]", step)
    block = _block("[[waypoint]]", step, Waypoint)
    return block if step.mavlink is None else block + _mavlink_block(MAVLINK, step.mavlink)


MAVLINK: Final = "[waypoint.mavlink]"


def _mavlink_block(header: str, item: MavlinkItem) -> str:
    params = ", ".join(repr(float(value)) for value in item.params)
    lines = [header, f"command = {item.command}", f"frame = {item.frame}", f"params = [{params}]"]
    lines += [] if item.autocontinue else ["autocontinue = false"]
    return "\n".join(lines) + "\n"


def _block(header: str, value: object, schema: type[Any]) -> str:
    """Return a table without values that equal their defaults."""
    lines = [header]
    for field in fields(schema):
        number = getattr(value, field.name)
        if isinstance(number, int | float) and number != field.default:
            lines.append(f"{field.name} = {float(number)!r}")
    return "\n".join(lines) + "\n"


EMPTY: Final = Mission(waypoints=())
NOTHING: Final = "the draft is empty: wp add X Y [DEG]"


class Draft:
    """A mission under construction; each edit replaces it, so any thread may read it."""

    def __init__(self) -> None:
        self.mission = EMPTY

    @property
    def ready(self) -> Mission:
        """The mission, to be sent; UserError when it is empty or leaves its own fence."""
        if not self.mission.waypoints:
            raise UserError(NOTHING)
        _judge_places(self.mission, str(DASH))
        return self.mission

    def add(self, waypoint: Waypoint) -> str:
        """Append a waypoint."""
        self.mission = replace(self.mission, waypoints=(*self.mission.waypoints, waypoint))
        return f"waypoint {len(self.mission.waypoints)}: {waypoint}"

    def remove(self, item: int) -> str:
        """Remove a waypoint by its number from 1."""
        left = list(self.mission.waypoints)
        if item > len(left):
            raise UserError(f"there is no waypoint {item}: {self.listed()}")
        taken = left.pop(item - 1)
        self.mission = replace(self.mission, waypoints=tuple(left))
        return f"taken out: {taken}"

    def listed(self) -> str:
        """Return one line for each waypoint, and one for the fence."""
        rows = [f"{at}  {one}" for at, one in enumerate(self.mission.waypoints, start=1)]
        rows += [f"fence: {self.mission.fence}"] if self.mission.fence else []
        return "\n".join(rows) or NOTHING

    def clear(self) -> str:
        """Empty the draft."""
        self.mission = EMPTY
        return "the draft is empty"

    def load(self, path: Path) -> str:
        """Replace the draft by the mission of a file."""
        self.mission = read(path).mission
        return f"{path}: {self.mission}"

    def save(self, path: Path) -> str:
        """Write the draft to a file."""
        if not self.mission.waypoints:
            raise UserError(NOTHING)
        return written(path, self.mission, write(path, self.mission))


def waypoint_at(x_m: float, y_m: float, heading_deg: float | None, hold_s: float) -> Waypoint:
    """Return a waypoint; UserError names the value that is out of range."""
    table = {"x_m": x_m, "y_m": y_m, "hold_s": hold_s}
    if heading_deg is not None:
        table["heading_deg"] = heading_deg
    try:
        return parse(table, Waypoint, file="")
    except ConfigError as error:
        raise UserError(f"{error.key} {table[error.key]:g}: {error.reason}") from error
