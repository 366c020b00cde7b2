"""Suggest the intended key for one with a wrong unit, without a unit, or misspelt."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from math import degrees
from typing import Final

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
