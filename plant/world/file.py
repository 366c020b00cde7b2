"""Load a world file: TOML in metres and degrees, checked and converted to a `World`.

The JSON of `worlds show --json` and of the plant is accepted, too, from a file or, as "-", from
standard input.
"""

import re
import sys
from collections.abc import Iterator
from difflib import get_close_matches
from errno import EFBIG
from os.path import isfile
from pathlib import Path
from typing import Any, Final

from plant.model.errors import WorldError, WorldProblem, WorldReport
from plant.world.reader import read_world
from protocol.world import World
from runtime.files import UnusableFileError, bytes_in, decoded, value_in
from runtime.toml_reader import MAX_BYTES, Key, TooDeepError, key_lines, table_in

IN_THE_FILE: Final = {"obstacles": "obstacle", "faults": "fault"}
"""Keys of lists in the JSON, with their singular names in the file."""

ADDED: Final = ("shortest_path_m", "starts", "goals", "seed", "noise_level")
"""Keys that are computed from a world or belong to one run, and are ignored when reading."""


def from_json(text: str, file: str) -> World:
    """Return the world; raise WorldError, as for a world file."""
    try:
        facts: dict[str, Any] = value_in(text)
    except ValueError as error:
        line = getattr(error, "lineno", 1)
        reason = getattr(error, "msg", "nested too deeply")
        raise WorldError(
            [WorldProblem(file, line, "json", reason, "give what `worlds show --json` prints")]
        ) from None
    report = WorldReport(file, {})
    tables = _tables(facts)
    for key in _nulls(tables, ()):
        report.add(key, "expected a value, found null", "leave it out")
    world = None if report.problems else read_world(tables, report)
    if world is None:
        raise WorldError(report.problems)
    return world


def _tables(facts: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of the equivalent world file; a heading of null is omitted."""
    tables = {IN_THE_FILE.get(key, key): value for key, value in facts.items() if key not in ADDED}
    goal = tables.get("goal")
    if isinstance(goal, dict) and goal.get("heading_deg", 0.0) is None:
        tables["goal"] = {key: value for key, value in goal.items() if key != "heading_deg"}
    return tables


def _nulls(value: object, at: Key) -> Iterator[Key]:
    """Yield the keys with null, which a world file cannot express."""
    if value is None:
        yield at
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _nulls(inner, (*at, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _nulls(inner, (*at, index))


STANDARD_INPUT: Final = "-"
SHIPPED_DIR: Final = Path(__file__).parents[1] / "worlds"
PARSER_PLACE: Final = re.compile(
    r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", re.DOTALL
)
KEY_ON_LINE: Final = re.compile(r"\s*\[{0,2}\s*([\w.\"' -]+?)\s*(?:=|\]|$)")


def shipped() -> list[str]:
    """Return the names of the shipped worlds."""
    return sorted((path.stem for path in SHIPPED_DIR.glob("*.toml")), key=_by_number)


def _by_number(name: str) -> list[str]:
    """Return a sort key that puts fig5 before fig11."""
    return [part.zfill(6) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def load(path_or_name: str | Path) -> World:
    """Return the world of a file, or the shipped world of that name; raise only WorldError."""
    text = str(path_or_name)
    if text == STANDARD_INPUT:
        return loads(_decoded(sys.stdin.buffer.read(MAX_BYTES + 1), text), text)
    if text in shipped():
        path = SHIPPED_DIR / f"{text}.toml"
    elif text.endswith((".toml", ".json")) or "/" in text or isfile(text):
        path = Path(text)
    else:
        raise WorldError([_unknown_name(text)])
    return loads(_read_text(path), str(path))


def loads(text: str, file: str = "world") -> World:
    """Return the world that a text describes; `file` is its name in errors. Raises WorldError."""
    if text.lstrip().startswith("{"):  # TOML cannot begin with a brace
        return from_json(text, file)
    try:
        raw = table_in(text)
        lines = key_lines(text)
    except TooDeepError as error:
        raise WorldError([_refusal(file, "toml", str(error), "use fewer [", 1)]) from None
    except ValueError as error:
        raise WorldError([_invalid_toml(error, text, file)]) from None
    report = WorldReport(file, lines)
    world = read_world(raw, report)
    if world is None:
        raise WorldError(report.problems)
    return world


def _refusal(file: str, key: str, reason: str, fix: str, line: int | None = None) -> WorldProblem:
    return WorldProblem(file, line, key, reason, fix)


def _unknown_name(name: str) -> WorldProblem:
    close = get_close_matches(name, shipped(), n=1)
    meant = f"did you mean {close[0]}? " if close else ""
    fix = f"{meant}shipped are {', '.join(shipped())}; or give the path of a .toml file"
    return _refusal(name or '""', "name", "no shipped world has this name", fix)


def _read_text(path: Path) -> str:
    file = str(path)
    try:
        data = bytes_in(path, MAX_BYTES)
    except UnusableFileError as error:
        large = error.errno == EFBIG
        fix = "is it a world file? make it smaller" if large else "give a .toml file"
        raise WorldError([_refusal(file, "file", str(error), fix)]) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        fix = "give a readable .toml file, or one of the names `sidestep worlds list` prints"
        raise WorldError([_refusal(file, "file", f"cannot be read: {reason}", fix)]) from None
    return _decoded(data, file)


def _decoded(data: bytes, file: str) -> str:
    if len(data) > MAX_BYTES:
        reason = f"larger than {MAX_BYTES} bytes"
        raise WorldError([_refusal(file, "file", reason, "is it a world file? make it smaller")])
    try:
        return decoded(data)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        fix = "is it a world file? save it as UTF-8"
        raise WorldError([_refusal(file, "file", "not UTF-8 text", fix, line)]) from None


def _invalid_toml(error: ValueError, text: str, file: str) -> WorldProblem:
    """Return the problem found by the TOML parser, with its line and the key on that line."""
    match = PARSER_PLACE.fullmatch(str(error))
    reason = match[1] if match else str(error)
    lines = text.split("\n")
    line = int(match[2]) if match and match[2] else len(lines) if match else 1
    key = KEY_ON_LINE.match(lines[min(line, len(lines)) - 1])
    fix = "correct the TOML there"
    if re.match("Cannot overwrite|Cannot declare|Cannot mutate|Duplicate", reason):
        reason, fix = f"given twice ({reason})", "keep one of them"
    return _refusal(file, key[1] if key else "toml", reason, fix, line)
