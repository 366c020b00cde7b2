"""A world from its JSON: what `worlds show --json` and the plant tell is a world again."""

from collections.abc import Iterator
from typing import Any, Final

from plant.model.errors import Problem, Report, WorldError
from plant.model.types import World
from plant.world.reader import read_world
from runtime.json_reader import value_in
from runtime.toml_lines import Key

IN_THE_FILE: Final = {"obstacles": "obstacle", "faults": "fault"}
"""The file names one of them, the JSON has the list."""

ADDED: Final = ("shortest_path_m", "starts", "goals")
"""What is no part of a world, but found from it."""


def is_json(text: str) -> bool:
    """Nothing of TOML opens with a brace."""
    return text.lstrip().startswith("{")


def from_json(text: str, file: str) -> World:
    """Raises WorldError, as for a world file."""
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
    """As the tables of its file: a heading of null is one that the file leaves out."""
    tables = {IN_THE_FILE.get(key, key): value for key, value in facts.items() if key not in ADDED}
    goal = tables.get("goal")
    if isinstance(goal, dict) and goal.get("heading_deg", 0.0) is None:
        tables["goal"] = {key: value for key, value in goal.items() if key != "heading_deg"}
    return tables


def _nulls(value: object, at: Key) -> Iterator[Key]:
    """Where there is nothing: a world file cannot say that."""
    if value is None:
        yield at
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _nulls(inner, (*at, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _nulls(inner, (*at, index))
