"""Load typed TOML configuration, and the calibration of a robot for a noise level.

Unknown keys and values out of range are refused by name. `sidestep calibrate --output` writes the
files of calibrations; each contains its command. A world that changes single noise values uses the
calibration of the noise level that it is based on.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, is_dataclass
from difflib import get_close_matches
from functools import cache
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from runtime.errors import ConfigError, UserError
from runtime.files import text_in
from runtime.toml_reader import MAX_BYTES, key_lines, table_in

T = TypeVar("T")
PLACE: Final = re.compile(r"^(?P<reason>.*?)(?: - at `\$\.?(?P<key>.*)`)?$", re.DOTALL)
SHARED: Final = ("robot", "network", "parameters", "gateway")
"""Top-level keys of a file that can be used by ground, robot, plant and gateway."""
MISSING: Final = re.compile(r"missing required field `(.+)`")


def load(path: Path | str, schema: type[T]) -> T:
    """Return a file as an instance of `schema`; ConfigError has file, key, reason and fix."""
    return parse(read_toml(path), schema, file=str(path))


def load_shared(path: Path | str, schema: type[T]) -> T:
    """Load a file that may also contain keys of other processes."""
    table, known = read_toml(path), get_type_hints(schema)
    for key in table:
        if key not in known and key not in SHARED:
            raise unknown_key(key, key, sorted({*known, *SHARED}), file=str(path))
    own = {key: value for key, value in table.items() if key in known}
    return parse(resolve_tls_paths(own, Path(path).parent), schema, file=str(path))


@contextmanager
def line_located(path: Path) -> Iterator[None]:
    """Add the line of the key to a ConfigError of this file."""
    try:
        yield
    except ConfigError as error:
        line = _line_of(error.key, path)
        if line is None:
            raise
        file = f"{error.file}:{line}"
        raise ConfigError(file=file, key=error.key, reason=error.reason, fix=error.fix) from error


def _line_of(key: str, path: Path) -> int | None:
    """Return the line of a key in a file; of the table it belongs to, if it is missing."""
    try:
        lines = key_lines(text_in(path, MAX_BYTES))
    except (OSError, ValueError):
        return None
    names = tuple(key.partition("[")[0].split("."))
    found = (lines.get(names[:length]) for length in range(len(names), 0, -1))
    return next((line for line in found if line is not None), None)


def resolve_tls_paths(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the table with the files of `[network.tls]` relative to the folder of the file."""
    network = table.get("network")
    tls = network.get("tls") if isinstance(network, dict) else None
    if not isinstance(network, dict) or not isinstance(tls, dict):
        return table
    placed = {
        key: str(folder / value) if isinstance(value, str) and value else value
        for key, value in tls.items()
    }
    return {**table, "network": {**network, "tls": placed}}


def read_toml(path: Path | str) -> dict[str, Any]:
    """Return the tables of a TOML file, unchecked."""
    text = text_of(path)
    try:
        return table_in(text)
    except ValueError as error:
        fix = "correct the TOML syntax there"
        raise ConfigError(file=str(path), key="", reason=str(error), fix=fix) from error


def text_of(path: Path | str) -> str:
    """Return the text of a file; ConfigError if it has none."""
    try:
        return text_in(Path(path), MAX_BYTES)
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise ConfigError(file=str(path), key="", reason=reason, fix="check the path") from error
    except UnicodeDecodeError as error:
        fix = "save it as UTF-8"
        raise ConfigError(file=str(path), key="", reason="is not UTF-8 text", fix=fix) from error


def parse(table: Mapping[str, Any], schema: type[T], *, file: str) -> T:
    """Return a table as a (nested) frozen dataclass; `Annotated[.., Meta]` gives ranges."""
    check_keys(table, schema, file=file)
    try:
        return msgspec.convert(dict(table), schema)
    except msgspec.ValidationError as error:
        raise _refused(error, schema, file) from error


def check_keys(table: Mapping[str, Any], schema: type[Any], *, file: str, above: str = "") -> None:
    """Raise ConfigError for the first unknown key, or value that is not finite."""
    hints = get_type_hints(schema)
    for key, value in table.items():
        if key not in hints:
            raise unknown_key(above + key, key, list(hints), file=file)
        if isinstance(value, float) and not isfinite(value):
            fix = "give a finite number"
            raise ConfigError(file=file, key=above + key, reason="is not finite", fix=fix)
        if isinstance(value, dict) and (inner := _schema_in(hints[key])) is not None:
            tables = {key: value}
            if get_origin(hints[key]) is dict:
                tables = {f"{key}.{name}": one for name, one in value.items()}
            for name, one in tables.items():
                if isinstance(one, dict):
                    check_keys(one, inner, file=file, above=f"{above}{name}.")


def _schema_in(hint: Any) -> Any:
    """Return the dataclass that a table is read into, also for `Schema | None` or a dict of it."""
    return next((kind for kind in (hint, *get_args(hint)) if is_dataclass(kind)), None)


def unknown_key(where: str, key: str, known: list[str], *, file: str) -> ConfigError:
    """Return the error for an unknown key: misspelt settings must not be ignored."""
    near = get_close_matches(key, known, n=1)
    fix = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(sorted(known))}"
    return ConfigError(file=file, key=where, reason="unknown key", fix=fix)


def _refused(error: msgspec.ValidationError, schema: type[Any], file: str) -> ConfigError:
    found = PLACE.match(str(error))
    assert found is not None, "the pattern fits any text"
    reason, key = found["reason"], found["key"] or ""
    if missing := MISSING.search(reason):
        where = f"{key}.{missing[1]}" if key else missing[1]
        return ConfigError(file=file, key=where, reason="missing key", fix="add it")
    if isinstance(error.__cause__, UserError):
        return ConfigError(file=file, key=key, reason=str(error.__cause__), fix="")
    lowered = reason[:1].lower() + reason[1:]
    return ConfigError(file=file, key=key, reason=lowered, fix=_fix(schema, key))


def _fix(schema: type[Any], key: str) -> str:
    """Return the fix for a value: the choices of its key, if there are some."""
    hint: Any = schema
    for name in key.split("."):
        schema_here = _schema_in(hint)
        hint = None if schema_here is None else get_type_hints(schema_here).get(name)
    if get_origin(hint) is Literal:
        return f"choose one of {', '.join(map(repr, get_args(hint)))}"
    return "correct the value"


FOLDER: Final = Path(__file__).parent / "calibrations"
SAME: Final = ("radius_m", "track_m", "wheel_radius_m", "sonar_max_m")
RENAMED: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "max_speed_m_s": ("wheel_max_m_s", "v_max_m_s"),
        "max_acceleration_m_s2": ("accel_m_s2",),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Robot parameters that differ from the robot's defaults."""

    parameters: dict[str, float] = field(default_factory=dict)


@cache
def calibration_of(level: str) -> Mapping[str, float]:
    """Return the parameters for a noise level; raise ConfigError if there is no calibration."""
    found = load(FOLDER / f"{level}.toml", Calibration)
    return MappingProxyType(found.parameters)


def settings_of(
    robot: Mapping[str, bool | int | float | str], level: str, *, calibrated: bool
) -> dict[str, float]:
    """Return a robot's parameters in a world: calibration, then the world's own `[robot]`."""
    found = calibration_of(level) if calibrated else {}
    return {**found, **parameters_of(robot)}


def parameters_of(robot: Mapping[str, bool | int | float | str]) -> dict[str, float]:
    """Return the parameters that a world's `[robot]` changes.

    Properties that the robot cannot know, such as motor lag and brake, are left out.
    """
    values: dict[str, float] = {}
    for key, setting in robot.items():
        if key in SAME:
            values[key] = float(setting)
        elif key in RENAMED:
            values.update(dict.fromkeys(RENAMED[key], float(setting)))
        elif key == "ticks_per_m":
            values["m_per_tick"] = 1.0 / float(setting)
    return values


def start_totals(robot: Mapping[str, bool | int | float | str]) -> tuple[int, int]:
    """Return the left and right encoder totals at the start pose, from a world's `[robot]`."""
    return int(robot.get("left_start_ticks", 0)), int(robot.get("right_start_ticks", 0))


def totals_arguments(robot: Mapping[str, bool | int | float | str]) -> tuple[str, ...]:
    """Return the arguments of `sidestep run robot` for these totals; none if they are zero."""
    totals = start_totals(robot)
    return ("--encoders", *map(str, totals)) if any(totals) else ()
