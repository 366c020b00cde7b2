"""Check the overrides of robot, noise and faults in a world file against their classes."""

from collections.abc import Callable, Mapping, Set
from dataclasses import MISSING, Field, fields, replace
from math import degrees, inf, radians
from typing import Any, Final

from plant.model.body import Body
from plant.model.configuration import USUAL_LEVEL, _fields
from plant.model.errors import Report
from plant.model.faults import Fault
from plant.model.noise import LEVELS, Noise
from plant.model.types import Setting, Settings
from plant.world.table import HUGE, Limits, Table
from runtime.toml_reader import Key

ANY_NUMBER: Final = Limits(-HUGE, HUGE)


def read_robot(raw: object, at: Key, report: Report) -> Settings:
    """Return the overrides of the robot, and report their problems."""
    return _read(raw, at, report, Body, lambda settings: Body(**_fields(settings)))


def read_noise(raw: object, at: Key, report: Report) -> Settings:
    """Return the overrides of the noise, and report their problems."""

    def build(settings: Settings) -> Noise:
        """Build the noise to check its values."""
        values = _fields(settings)
        level = values.pop("level", USUAL_LEVEL)
        if level not in LEVELS:
            raise ValueError(f"level: no noise level {level!r}; there are {', '.join(LEVELS)}")
        return replace(LEVELS[level], **values)

    return _read(raw, at, report, Noise, build, {"level": '"default"'})


def read_fault(raw: object, at: Key, report: Report) -> Settings:
    """Return the fields of a fault, and report their problems."""
    return _read(raw, at, report, Fault, lambda settings: Fault(**_fields(settings)))


def _read(
    raw: object,
    at: Key,
    report: Report,
    kind: type,
    build: Callable[[Settings], object],
    more: Mapping[str, str] | None = None,
) -> Settings:
    """Return the table's settings by field name and in the field's unit; report problems."""
    known = {_file_key(field.name): field for field in fields(kind)}
    examples = {**(more or {}), **{key: _example(field) for key, field in known.items()}}
    table = Table(raw, at, examples, report)
    needed = {name for name, field in known.items() if field.default is MISSING}
    settings: dict[str, Setting] = {}
    for key in examples:
        field = known.get(key)
        if key in table or key in needed:
            settings[field.name if field else key] = _value(table, key, field)
    if table.sound:
        _try(table, settings, needed, build)
    return settings


def _file_key(name: str) -> str:
    """Return the key in the file, where angles are in degrees."""
    return name.removesuffix("_rad") + "_deg" if name.endswith("_rad") else name


def _example(field: "Field[Any]") -> str:
    if field.default is MISSING:
        return '"sonar_dead"'
    if isinstance(field.default, str):
        return '"3"'
    if field.default == inf:
        return "10.0"
    return f"{degrees(field.default) if field.name.endswith('_rad') else field.default:g}"


def _value(table: Table, key: str, field: "Field[Any] | None") -> Setting:
    if field is None or field.type is str:
        return table.text(key)
    if field.type is int:
        return table.whole_number(key, ANY_NUMBER)
    value = table.number(key, ANY_NUMBER)
    return radians(value) if field.name.endswith("_rad") else value


def _try(
    table: Table, settings: Settings, needed: Set[str], build: Callable[[Settings], object]
) -> None:
    """Build the object; report and drop refused settings until it succeeds."""
    left = dict(settings)
    while True:
        try:
            build(left)
            return
        except ValueError as refusal:
            name, _, reason = str(refusal).partition(": ")
            key = _file_key(name)
            unit = " (in radians)" if key != name else ""
            given = left.pop(name, None) is not None
            if given:
                table.refuse(key, reason + unit, f"write a value such as {table.example(key)}")
            elif table.sound:
                table.refuse(key, reason + unit, f"set {key} too, to fit {', '.join(left)}")
            if not given or name in needed:
                return
