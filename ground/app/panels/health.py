"""Show in one row whether link, senses, control loop and recording are well."""

from typing import Final, NamedTuple

from ground.app.panels.aged import MISSING, live, number
from ground.app.panels.sonar import dead_sonars
from ground.app.widgets.rows import Row, Span, faint, row, width_of
from ground.client.telemetry import Age
from ground.station.station import Station
from protocol.topics import CYCLE, HEARTBEAT, SONAR
from protocol.wire.messages import CycleReport

GOOD_PERCENT: Final = 99.0
MARKS: Final = {"ok": "●", "caution": "▲", "danger": "○", "faint": "○"}


class Health(NamedTuple):
    """A part of the system: its state as a role, and its details for wide panels."""

    name: str
    role: str
    detail: str


def health_rows(station: Station, recording: str, width: int) -> list[Row]:
    """Return the row; details are left out where they do not fit."""
    parts = [link(station), senses(station), loop(station), recorder(recording)]
    for detailed in (True, False):
        spans: list[Span] = []
        for part in parts:
            mark = Span(f"{MARKS[part.role]} ", part.role)
            is_known = detailed and part.detail
            spans += [
                mark,
                Span(part.name),
                faint(f" {part.detail}" if is_known else ""),
                Span("  "),
            ]
        found = row(*spans[:-1])
        if width_of(found) <= width:
            break
    return [found]


def link(station: Station) -> Health:
    """Judge the link by the heartbeat and the share of received frames."""
    percent, trip_ms = station.link_percent, station.round_trip_ms
    if station.seen(HEARTBEAT).age is Age.GONE:
        return Health("link", "danger", MISSING)
    good = percent is not None and percent >= GOOD_PERCENT
    detail = f"{number(trip_ms, '3.0f')} ms" if station.live else ""
    return Health("link", "ok" if good or not station.live else "caution", detail)


def senses(station: Station) -> Health:
    """Judge the sonars by their age, and by those that give no reading."""
    cycle: CycleReport | None = live(station.seen(CYCLE))
    dead = dead_sonars(station)
    if station.seen(SONAR).age is Age.GONE:
        return Health("senses", "danger", MISSING)
    if dead:
        return Health("senses", "caution", f"{', '.join(dead)} dead")
    age = "" if cycle is None else f"{cycle.sense_age_us / 1000:3.0f} ms"
    return Health("senses", "ok", age)


def loop(station: Station) -> Health:
    """Judge the control loop by the most expensive cycle of the last second."""
    cycle: CycleReport | None = live(station.seen(CYCLE))
    if cycle is None:
        return Health("loop", "danger", MISSING)
    worst = station.worst_cycle or cycle
    over = sum(worst.stage_us) > worst.budget_us
    return Health("loop", "caution" if over else "ok", f"{cycle.missed} missed")


def recorder(words: str) -> Health:
    """Judge the recording by its word in the status line; `!` marks one that does not grow."""
    if not words:
        return Health("rec", "faint", "off")
    return Health("rec", "danger" if words.endswith("!") else "ok", "")
