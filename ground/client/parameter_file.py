"""Parameter files: TOML as in the robot's own `--config`, and those of MAVLink ground stations.

TOML has a table `[parameters]` of NAME = VALUE. ArduPilot's `.param` and `.parm` have lines of
NAME,VALUE (Mission Planner) or NAME VALUE (MAVProxy), QGroundControl's `.params` lines of system,
component, name, value and type. Names are in upper case there, as the gateway shows them.
"""

import re
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Final, NamedTuple

from ground.client.parameter import Parameter
from ground.client.parameter_rows import NAME, NAME_RULE
from runtime.cli.terminal import printable
from runtime.config import read_toml, text_of, unknown_key
from runtime.errors import ConfigError, UserError, not_a_number
from runtime.files import replace_named

TABLE: Final = "parameters"
HUGE: Final = 1e300
"""Limit of the magnitude: an integer in TOML may exceed the range of a float."""
ARDUPILOT: Final = (".param", ".parm")
QGROUNDCONTROL: Final = ".params"
ENDINGS: Final = (".toml", *ARDUPILOT, QGROUNDCONTROL)
REAL32: Final = 9
"""MAV_PARAM_TYPE_REAL32."""
LINE: Final = re.compile(r"(?P<name>\w+)[,\s]\s*(?P<value>\S+)")
QGC_LINE: Final = re.compile(r"\d+\t\d+\t(?P<name>\w+)\t(?P<value>\S+)(?:\t\d+)?")


class FoundValues(NamedTuple):
    """Values by name, and the names in a file that are not the robot's."""

    values: Mapping[str, float]
    others: tuple[str, ...] = ()


def write(path: Path, parameters: Sequence[Parameter]) -> list[str]:
    """Write the parameters that differ from their defaults; return their names.

    Raises UserError if the file cannot be written.
    """
    chosen = [one for one in parameters if not one.is_default]
    ending = path.suffix.lower()
    if ending in ARDUPILOT:
        lines = [f"{_key(one).upper()},{one.value!r}" for one in chosen]
    elif ending == QGROUNDCONTROL:
        rows = [(1, 1, _key(one).upper(), repr(one.value), REAL32) for one in chosen]
        lines = ["\t".join(map(str, row)) for row in rows]
    else:
        rest = [f"{one.value!r}  # {printable(one.doc)}".rstrip(" #") for one in chosen]
        named = zip(map(_key, chosen), rest, strict=True)
        lines = [f"[{TABLE}]", *(f"{key} = {value}" for key, value in named)]
    replace_named(path, "\n".join([*lines, ""]))
    return [one.name for one in chosen]


def _key(parameter: Parameter) -> str:
    """Return the name as a TOML key; UserError if it is not a valid name."""
    if not NAME.match(parameter.name):
        name = parameter.name
        raise UserError(f"{name!r} is not a valid parameter name: {NAME_RULE}")
    return parameter.name


def read(path: Path, parameters: Sequence[Parameter]) -> FoundValues:
    """Return the values of a file by name; ConfigError names one that this robot cannot take.

    Files of ground stations also have parameters of ArduPilot, which are left out.
    """
    if path.suffix.lower() in (*ARDUPILOT, QGROUNDCONTROL):
        return _read_lines(path, parameters)
    return FoundValues(_read_toml(path, parameters))


def _read_lines(path: Path, parameters: Sequence[Parameter]) -> FoundValues:
    known = {one.name.upper(): one for one in parameters}
    values, others = dict[str, float](), list[str]()
    for number, line in enumerate(text_of(path).splitlines(), start=1):
        line = line.partition("#")[0].strip()
        found = QGC_LINE.fullmatch(line) or LINE.fullmatch(line)
        where = f"{path}:{number}"
        if not line:
            continue
        if found is None:
            reason, fix = f"{line[:40]!r} is not a name and a value", "write NAME,VALUE"
            raise ConfigError(file=where, key="", reason=reason, fix=fix)
        name, value = found["name"], _number(found["value"], where, found["name"])
        if (own := known.get(name.upper())) is None:
            others.append(name)
            continue
        _check_range(where, name, value, own)
        values[own.name] = value
    if not values:
        reason, fix = "has no parameter of this robot", "see `sidestep param list`"
        raise ConfigError(file=str(path), key="", reason=reason, fix=fix)
    return FoundValues(values, tuple(others))


def _number(word: str, file: str, name: str) -> float:
    """Return a finite number."""
    try:
        value = float(word)
    except ValueError:
        raise ConfigError(file=file, key=name, reason=not_a_number(word), fix="") from None
    if not isfinite(value):
        fix = "give a finite number"
        raise ConfigError(file=file, key=name, reason="is not finite", fix=fix)
    return value


def _read_toml(path: Path, parameters: Sequence[Parameter]) -> dict[str, float]:
    table = read_toml(path).get(TABLE)
    if not isinstance(table, dict):
        fix = f"write [{TABLE}] and under it NAME = VALUE"
        raise ConfigError(file=str(path), key=TABLE, reason="is missing", fix=fix)
    known = {one.name: one for one in parameters}
    for name, value in table.items():
        key = f"{TABLE}.{name}"
        if name not in known:
            raise unknown_key(key, name, list(known), file=str(path))
        if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > HUGE:
            raise ConfigError(
                file=str(path), key=key, reason="is not a number", fix="write a number"
            )
        _check_range(str(path), key, float(value), known[name])
    return {name: float(value) for name, value in table.items()}


def _check_range(file: str, key: str, value: float, parameter: Parameter) -> None:
    low, high = parameter.minimum, parameter.maximum
    if low is not None and high is not None and not low <= value <= high:
        reason = f"{value:g} is out of range"
        unit = f" {parameter.unit}" if parameter.unit else ""
        raise ConfigError(file=file, key=key, reason=reason, fix=f"give {low:g} to {high:g}{unit}")
