"""Show the rate and age of a received topic."""

from typing import Final

from ground.app.panels.aged import MISSING, number
from ground.client.telemetry import Age
from ground.station.link.streams import StreamRow
from runtime.units import NS_PER_S

ROLES: Final = {Age.LIVE: "text", Age.DIM: "faint", Age.GONE: "faint"}


def rate(line: StreamRow) -> str:
    """Return the rate in Hz as text, or "event" for a topic without a fixed rate."""
    if not line.topic.rate_hz:
        return "event"
    return MISSING if line.age is Age.GONE else number(line.rate_hz, ".0f")


def age(line: StreamRow) -> str:
    """Return the age as text.

    A live topic has a word, because a number that changes with every frame is unreadable.
    """
    if line.age_ns is None:
        return MISSING
    if not line.topic.rate_hz:
        return f"{line.age_ns / NS_PER_S:.0f} s"
    return "live" if line.age is Age.LIVE else f"{line.age_ns / NS_PER_S:.1f} s"
