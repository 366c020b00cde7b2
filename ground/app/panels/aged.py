"""Show a value with its age: normal while live, faint when late, then only its age."""

from collections.abc import Callable
from math import isfinite
from typing import Any, Final

from ground.app.widgets.rows import Span
from ground.client.telemetry import Age, AgedMessage
from runtime.units import NS_PER_S

MISSING: Final = "--"


def aged(seen: AgedMessage, words: Callable[[Any], str], role: str = "text") -> Span:
    """Return the words of the newest message, in the role while it is live."""
    if seen.message is None or seen.age_ns is None:
        return Span(MISSING, "faint")
    if seen.age is Age.GONE:
        return Span(f"{MISSING} {seen.age_ns / NS_PER_S:.1f} s", "faint")
    return Span(words(seen.message), role if seen.age is Age.LIVE else "faint")


def live(seen: AgedMessage) -> Any:
    """Return the message, or None when it is too old to be shown."""
    return None if seen.age is Age.GONE else seen.message


def role_of(seen: AgedMessage, role: str = "text") -> str:
    """Return the role while the message is live, else `faint`."""
    return role if seen.age is Age.LIVE else "faint"


def number(value: float | None, form: str = ".2f", none: str = MISSING) -> str:
    """Format a value without a negative zero; one that is not finite is missing."""
    return none if value is None or not isfinite(value) else format(value, f"z{form}")
