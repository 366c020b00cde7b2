"""Parameters in a file: `[parameters]` of NAME = VALUE, as the robot's own `--config` has them."""

from collections.abc import Mapping, Sequence
from math import isclose
from pathlib import Path
from typing import Any, Final

from ground.client.parameter_rows import NAME, NAME_RULE
from ground.recording import export_file
from runtime.config import read_toml, unknown_key
from runtime.errors import ConfigError, UserError
from runtime.terminal import printable

TABLE: Final = "parameters"
HUGE: Final = 1e300
"""A whole number in TOML may be longer than a float can be."""


def is_usual(row: Mapping[str, Any]) -> bool:
    """Whether it has its default value, to the precision of the wire."""
    value, default = row["value"], row.get("default")
    return default is None or same(float(value), float(default))


def same(one: float, other: float) -> bool:
    return isclose(one, other, rel_tol=1e-6, abs_tol=1e-9)


def write(path: Path, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Those that are not as they are by default; their names. UserError when it cannot be."""
    chosen = [row for row in rows if not is_usual(row)]
    lines = [f"{name_in(row)} = {row['value']!r}  # {said(row)}".rstrip(" #") for row in chosen]
    export_file.replace(path, "\n".join([f"[{TABLE}]", *lines, ""]))
    return [str(row["name"]) for row in chosen]


def name_in(row: Mapping[str, Any]) -> str:
    """The name as a key of TOML; UserError for what is none."""
    name = str(row["name"])
    if not NAME.match(name):
        raise UserError(f"{name!r} is no name of a parameter: {NAME_RULE}")
    return name


def said(row: Mapping[str, Any]) -> str:
    """Return the description as one line that is safe in a TOML comment."""
    return printable(str(row.get("doc", "")))


def read(path: Path, rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """What the file sets, all of it possible for this robot; ConfigError names what is not."""
    table = read_toml(path).get(TABLE)
    if not isinstance(table, dict):
        fix = f"write [{TABLE}] and under it NAME = VALUE"
        raise ConfigError(file=str(path), key=TABLE, reason="is missing", fix=fix)
    known = {str(row["name"]): row for row in rows}
    for name, value in table.items():
        key = f"{TABLE}.{name}"
        if name not in known:
            raise unknown_key(key, name, list(known), file=str(path))
        if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > HUGE:
            raise ConfigError(file=str(path), key=key, reason="is no number", fix="write one")
        _judge_range(str(path), key, float(value), known[name])
    return {name: float(value) for name, value in table.items()}


def _judge_range(file: str, key: str, value: float, row: Mapping[str, Any]) -> None:
    low, high = row.get("minimum"), row.get("maximum")
    if low is not None and high is not None and not low <= value <= high:
        reason = f"{value:g} is out of range"
        unit = f" {row['unit']}" if row.get("unit") else ""
        raise ConfigError(file=file, key=key, reason=reason, fix=f"give {low:g} to {high:g}{unit}")
