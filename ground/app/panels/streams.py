"""Show the rate, age and loss of each received topic."""

from typing import Final

from ground.app.panels.aged import MISSING, number
from ground.app.widgets.rows import Row, Span, head, row
from ground.client.telemetry import Age
from ground.station.link.streams import StreamRow
from ground.station.station import Station
from runtime.units import NS_PER_S

ROLES: Final = {Age.LIVE: "text", Age.DIM: "faint", Age.GONE: "faint"}


def stream_rows(station: Station) -> list[Row]:
    """Return one row for each topic that was ever received, for the third column."""
    lines = [line for line in station.streams() if line.received]
    return [row(head("stream           Hz    age lost")), *map(short, lines)]


def short(line: StreamRow) -> Row:
    """Return the short row of a topic."""
    lost = f"{line.lost_percent:4.0f}%"
    return row(
        head(f"{line.topic.path:<14.14}"),
        Span(f"{rate(line):>5}", ROLES[line.age]),
        Span(f"{age(line):>7}", ROLES[line.age]),
        Span(lost, "caution" if line.lost_percent >= 1.0 else "faint"),
    )


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
