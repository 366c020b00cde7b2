"""Read a world from the JSON of `worlds show --json` and of the plant."""

from collections.abc import Iterator
from typing import Any, Final

from plant.model.errors import Problem, Report, WorldError
from plant.model.types import World
from plant.world.reader import read_world
from runtime.json_reader import value_in
from runtime.toml_reader import Key

IN_THE_FILE: Final = {"obstacles": "obstacle", "faults": "fault"}
"""Keys of lists in the JSON, with their singular names in the file."""

ADDED: Final = ("shortest_path_m", "starts", "goals", "seed", "noise_level")
"""Keys that are computed from a world or belong to one run, and are ignored when reading."""


def is_json(text: str) -> bool:
    """Return whether a text is JSON: TOML cannot begin with a brace."""
    return text.lstrip().startswith("{")


def from_json(text: str, file: str) -> World:
    """Return the world; raise WorldError, as for a world file."""
    try:
        facts: dict[str, Any] = value_in(text)
    except ValueError as error:
        line = getattr(error, "lineno", 1)
        reason = getattr(error, "msg", "nested too deeply")
        raise WorldError(
            [Problem(file, line, "json", reason, "give what `worlds show --json` prints")]
        ) from None
    report = Report(file, {})
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
