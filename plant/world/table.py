"""Read one table of a world file, key by key; problems are reported and never raised.

A key with a wrong unit, without a unit or misspelt is refused with the key that was meant.
"""

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from math import degrees, isfinite, nan
from typing import Final, NamedTuple

from plant.model.errors import WorldReport
from protocol.world import Point
from runtime.toml_reader import Key

# Each unit as (quantity, factor to the unit of the world file).
UNITS: Final = {
    "m": ("metres", 1.0),
    "cm": ("metres", 0.01),
    "mm": ("metres", 0.001),
    "km": ("metres", 1000.0),
    "in": ("metres", 0.0254),
    "ft": ("metres", 0.3048),
    "deg": ("degrees", 1.0),
    "degrees": ("degrees", 1.0),
    "rad": ("degrees", degrees(1.0)),
    "radians": ("degrees", degrees(1.0)),
    "m_s": ("metres per second", 1.0),
    "cm_s": ("metres per second", 0.01),
    "mm_s": ("metres per second", 0.001),
    "km_h": ("metres per second", 1 / 3.6),
    "m_s2": ("metres per second squared", 1.0),
    "s": ("seconds", 1.0),
    "ms": ("seconds", 0.001),
}
WITH_UNIT: Final = re.compile("(.+?)_(" + "|".join(UNITS) + ")")


def split(key: str) -> tuple[str, str]:
    """Return the key without its unit, and the unit ("" for none)."""
    match = WITH_UNIT.fullmatch(key)
    return (match[1], match[2]) if match else (key, "")


def meant(key: str, known: Iterable[str]) -> str | None:
    """Return the known key that was probably intended."""
    keys = list(known)
    stem = split(key)[0]
    same_stem = [other for other in keys if split(other)[0] == stem]
    if same_stem:
        return same_stem[0]
    close = get_close_matches(key, keys, n=1, cutoff=0.6)
    if close:
        return close[0]
    stems = {split(other)[0]: other for other in keys}
    close = get_close_matches(stem, stems, n=1, cutoff=0.7)
    return stems[close[0]] if close else None


def reason_and_fix(key: str, value: object, known: Iterable[str]) -> tuple[str, str]:
    """Return why an unknown key is refused, and what to write instead."""
    keys = list(known)
    wanted = meant(key, keys)
    if wanted is None:
        return "unknown key", f"remove it; the keys here are {', '.join(keys)}"
    (stem, unit), (wanted_stem, wanted_unit) = split(key), split(wanted)
    if stem != wanted_stem:
        return "unknown key", f"did you mean {wanted}?"
    name = UNITS[wanted_unit][0] if wanted_unit else "no unit of its own"
    what = "wrong unit" if unit else "no unit in the key"
    return what, f"did you mean {wanted}{_converted(value, unit, wanted_unit)}? ({name})"


def _converted(value: object, unit: str, wanted_unit: str) -> str:
    """Return ` = 6.0` if the value can be converted, else nothing."""
    quantity, factor = UNITS.get(unit, ("", 0.0))
    if quantity != UNITS.get(wanted_unit, ("?", 0.0))[0]:
        return ""
    values = value if isinstance(value, list) else [value]
    numbers = [one for one in values if isinstance(one, int | float) and abs(one) < 1e9]
    if not numbers or len(numbers) != len(values):
        return ""
    texts = [f"{number * factor:.6g}" for number in numbers]
    return f" = [{', '.join(texts)}]" if isinstance(value, list) else f" = {texts[0]}"


MAX_COORDINATE_M: Final = 100.0
MAX_POINTS: Final = 500
HUGE: Final = 1e100
TYPE_NAMES: Final = {
    bool: "a truth value",
    int: "a whole number",
    float: "a number",
    str: "text",
    list: "a list",
    dict: "a table",
}


class NumberLimits(NamedTuple):
    """Range of a number, with its unit."""

    low: float
    high: float
    unit: str = ""
    above_low: bool = False

    def hold(self, value: float) -> bool:
        """Return whether a value is within the limits."""
        return self.low < value <= self.high or (value == self.low and not self.above_low)

    def __str__(self) -> str:
        if self.above_low:
            return f"more than {self.low:g}, at most {self.high:g} {self.unit}".rstrip()
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()


COORDINATE: Final = NumberLimits(-MAX_COORDINATE_M, MAX_COORDINATE_M, "m")


def type_name(value: object) -> str:
    """Return the name of a value's TOML type."""
    return TYPE_NAMES.get(type(value), "a date or time")


class FileTable:
    """The keys of one table; reports every key that is not in `examples`.

    `examples` maps each known key to a sample value of the file, for the proposed fixes.
    """

    def __init__(
        self, raw: object, at: Key, examples: Mapping[str, str], report: WorldReport
    ) -> None:
        self._at = at
        self._examples = examples
        self._report = report
        self._before = len(report.problems)
        self._meant: set[str | None] = set()
        self.raw: dict[str, object] = {}
        if isinstance(raw, dict):
            self.raw = raw
            self._refuse_unknown_keys()
        else:
            self._meant.update(examples)
            shape = ", ".join(f"{key} = {example}" for key, example in examples.items())
            report.add(at, f"expected a table, found {type_name(raw)}", f"write {{ {shape} }}")

    def _refuse_unknown_keys(self) -> None:
        for key, value in self.raw.items():
            if key not in self._examples:
                self._meant.add(meant(key, self._examples))
                self.refuse(key, *reason_and_fix(key, value, self._examples))

    @property
    def sound(self) -> bool:
        """Return whether no problem has been reported since this table was opened."""
        return len(self._report.problems) == self._before

    def __contains__(self, key: str) -> bool:
        return key in self.raw

    def asks_for(self, key: str) -> bool:
        """Return whether the key is present, or another was written instead of it."""
        return key in self.raw or key in self._meant

    def refuse(self, key: str, reason: str, fix: str) -> None:
        """Report a problem of a key."""
        self._report.add((*self._at, key), reason, fix)

    def example(self, key: str) -> str:
        """Return a sample assignment of a key."""
        return f"{key} = {self._examples[key]}"

    def required(self, key: str) -> object | None:
        """Return the value of a key, and report a missing key."""
        if key not in self.raw and key not in self._meant:
            self.refuse(key, "missing", f"add {key} = {self._examples[key]}")
        return self.raw.get(key)

    def number(self, key: str, limits: NumberLimits, default: float | None = None) -> float:
        """Return the number of a key, or the default; NaN after a reported problem."""
        if default is not None and key not in self.raw:
            return default
        value = self.required(key)
        return nan if value is None else self._checked((*self._at, key), value, limits)

    def whole_number(self, key: str, limits: NumberLimits) -> int:
        """Return the whole number of a key; 0 after a reported problem."""
        value = self.required(key)
        if isinstance(value, float):
            self._wrong_type(key, "a whole number", value)
            return 0
        number = self.number(key, limits)
        return int(number) if isfinite(number) else 0

    def text(self, key: str) -> str:
        """Return the text of a key; empty after a reported problem."""
        value = self.required(key)
        if value is None:
            return ""
        if not isinstance(value, str):
            self._wrong_type(key, "text", value)
            return ""
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Return the truth value of a key, or the default."""
        value = self.raw.get(key, default)
        if not isinstance(value, bool):
            self._wrong_type(key, "true or false", value)
            return default
        return value

    def pair(self, key: str, limits: NumberLimits) -> Point | None:
        """Return the two numbers of a key; None after a reported problem."""
        value = self.required(key)
        return None if value is None else self._point((*self._at, key), value, limits)

    def points(self, key: str, fewest: int) -> tuple[Point, ...]:
        """Return the points of a key; () after a reported problem."""
        value = self.required(key)
        if value is None:
            return ()
        if not isinstance(value, list):
            self._wrong_type(key, "a list of points", value)
            return ()
        if not fewest <= len(value) <= MAX_POINTS:
            reason = f"{len(value)} points, expected {fewest} to {MAX_POINTS}"
            self.refuse(key, reason, f"write at least {fewest} points, as {self._examples[key]}")
            return ()
        read = [
            self._point((*self._at, key, index), point, COORDINATE)
            for index, point in enumerate(value)
        ]
        sound = tuple(point for point in read if point is not None)
        return sound if len(sound) == len(read) else ()

    def _point(self, at: Key, value: object, limits: NumberLimits) -> Point | None:
        if not isinstance(value, list) or len(value) != 2:
            found = f"{len(value)} values" if isinstance(value, list) else type_name(value)
            example = self._examples[str(at[len(self._at)])]
            self._report.add(at, f"expected two numbers, found {found}", f"write as in {example}")
            return None
        x, y = (self._checked(at, one, limits) for one in value)
        return (x, y) if isfinite(x) and isfinite(y) else None

    def _checked(self, at: Key, value: object, limits: NumberLimits) -> float:
        key = str(at[len(self._at)])
        fix = f"write a number of {limits}, as in {key} = {self._examples[key]}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._report.add(at, f"expected a number, found {type_name(value)}", fix)
        elif isinstance(value, float) and not isfinite(value):
            self._report.add(at, f"{value} is not finite", fix)
        elif not limits.hold(value):
            shown = value if abs(value) < HUGE else "a huge number"
            self._report.add(at, f"{shown} is out of range ({limits})", fix)
        else:
            return float(value)
        return nan

    def _wrong_type(self, key: str, expected: str, value: object) -> None:
        reason = f"expected {expected}, found {type_name(value)}"
        self.refuse(key, reason, f"write {key} = {self._examples[key]}")
