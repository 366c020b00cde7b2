"""Parameter files: a table `[parameters]` of NAME = VALUE, as in the robot's own `--config`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from ground.client.parameter import Parameter
from ground.client.parameter_rows import NAME, NAME_RULE
from runtime.cli.terminal import printable
from runtime.config import read_toml, unknown_key
from runtime.errors import ConfigError, UserError
from runtime.files import replace_named

TABLE: Final = "parameters"
HUGE: Final = 1e300
"""Limit of the magnitude: an integer in TOML may exceed the range of a float."""


def write(path: Path, parameters: Sequence[Parameter]) -> list[str]:
    """Write the parameters that differ from their defaults; return their names.

    Raises UserError if the file cannot be written.
    """
    chosen = [one for one in parameters if not one.is_default]
    lines = [f"{_key(one)} = {one.value!r}  # {printable(one.doc)}".rstrip(" #") for one in chosen]
    replace_named(path, "\n".join([f"[{TABLE}]", *lines, ""]))
    return [one.name for one in chosen]


def _key(parameter: Parameter) -> str:
    """Return the name as a TOML key; UserError if it is not a valid name."""
    if not NAME.match(parameter.name):
        name = parameter.name
        raise UserError(f"{name!r} is not a valid parameter name: {NAME_RULE}")
    return parameter.name


def read(path: Path, parameters: Sequence[Parameter]) -> dict[str, float]:
    """Return the values of a file by name; ConfigError names one that this robot cannot take."""
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
