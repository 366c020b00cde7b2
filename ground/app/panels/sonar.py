"""Show the sonars from left to right as columns: name, bar, range in metres."""

from math import inf
from typing import Final

from ground.app.panels.aged import MISSING, live, number, role_of
from ground.app.widgets.bars import HEIGHTS
from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.client.telemetry import AgedMessage
from ground.station.station import Station
from ground.text.wording import SONARS
from protocol.topics import DECISION, SONAR
from protocol.wire.messages import AvoidanceDecision, SonarScan

LEAST_CELL: Final = 4
MOST_CELL: Final = 8
LABEL: Final = 6
BESIDE: Final = "│"
DEAD: Final = "dead"
NO_ECHO: Final = "none"
LEFT_TO_RIGHT: Final = tuple(reversed(range(len(SONARS))))


class Limits:
    """The distances in metres that a range is compared with, as the robot itself has them."""

    def __init__(self, station: Station) -> None:
        decision: AvoidanceDecision | None = live(station.seen(DECISION))
        self.zone_m = decision.zone_m if decision is not None else -inf
        stop_m = station.limit("guard_stop_m")
        self.stop_m = -inf if stop_m is None else stop_m
        self.longest_m = station.limit("sonar_max_m")
        """The farthest range; None while it is unknown: then there are no bars."""

    def role(self, range_m: float) -> str:
        """Return the role of a range."""
        if range_m < self.stop_m:
            return "danger"
        return "caution" if range_m < self.zone_m else "ok"

    def marks(self, range_m: float) -> str:
        """Return `!` for an echo in the zone, `!!` where the guard stops."""
        return {"danger": "!!", "caution": "!"}.get(self.role(range_m), "")


def sonar_rows(station: Station, width: int, bars: int) -> list[Row]:
    """Return the names, `bars` rows of bars, and the ranges.

    A sonar that gave no reading in one of the last scans is `dead`, in a colour that does not mean
    health.
    """
    seen, limits = station.seen(SONAR), Limits(station)
    scan: SonarScan | None = live(seen)
    labelled = width >= LABEL + 1 + (LEAST_CELL + 1) * len(SONARS)
    label = LABEL if labelled else 0
    cell = max(LEAST_CELL, min(MOST_CELL, (width - label - 1) // len(SONARS)))
    silent = station.silent_sonars
    ranges = [None if scan is None else range_of(scan, sonar, silent) for sonar in LEFT_TO_RIGHT]
    titles = ["sonar", *("" for _ in range(bars)), "m"]
    if bars > 1:
        titles[1] = f"{number(limits.longest_m, 'g')} m"
    rows = [
        [head(f"{SONARS[sonar]:^{cell}}") for sonar in LEFT_TO_RIGHT],
        *(
            [bar_span(one, level, bars, cell, limits, seen) for one in ranges]
            for level in reversed(range(bars))
        ),
        [value_span(one, cell, limits, seen, marked=not bars) for one in ranges],
    ]
    return [
        row(*((head(f"{title:<{label}}"),) if label else ()), *spans[:4], faint(BESIDE), *spans[4:])
        for title, spans in zip(titles, rows, strict=True)
    ]


def bar_span(
    range_m: float | None, level: int, bars: int, cell: int, limits: Limits, seen: AgedMessage
) -> Span:
    """Return the part of a bar in one row; the lowest row, level 0, has the marks."""
    if range_m is None:
        return faint(f"{'·' if level == 0 else '':^{cell}}")
    if range_m == inf or limits.longest_m is None:
        return faint(f"{'·':^{cell}}")
    eighths = max(1, round(min(1.0, range_m / limits.longest_m) * bars * len(HEIGHTS)))
    here = min(len(HEIGHTS), eighths - level * len(HEIGHTS))
    glyph = HEIGHTS[here - 1] if here > 0 else " "
    marks = limits.marks(range_m) if level == 0 else ""
    indent = (cell - 1) // 2
    text = f"{' ' * indent}{glyph}{marks}".ljust(cell)[:cell]
    return Span(text, role_of(seen, limits.role(range_m)))


def value_span(
    range_m: float | None, cell: int, limits: Limits, seen: AgedMessage, *, marked: bool
) -> Span:
    """Return a range in metres; `>3` without an echo within 3 m, `dead` without a reading."""
    if live(seen) is None:
        return faint(f"{MISSING:^{cell}}")
    if range_m is None:
        return Span(f"{DEAD:^{cell}}", "dead")
    if range_m == inf:
        none = NO_ECHO if limits.longest_m is None else f">{limits.longest_m:g}"
        return faint(f"{none:^{cell}}")
    text = f"{range_m:.2f}"
    if cell == LEAST_CELL:
        text = text[1:] if range_m < 1.0 and text[0] == "0" else f"{range_m:.1f}"
    role = limits.role(range_m)
    marks = limits.marks(range_m) if marked else ""
    text = f"{text}{marks}" if len(text + marks) <= cell else f"{text}{marks[:1]}"
    return Span(f"{text:^{cell}}", role_of(seen, role if role != "ok" else "text"))


def range_of(scan: SonarScan, sonar: int, silent: int) -> float | None:
    """Return a range in metres: inf without an echo, None when the sonar gives no reading."""
    bit = 1 << sonar
    if silent & bit or not scan.valid & bit:
        return None
    return scan.range_mm[sonar] / 1000 if scan.echo & bit else inf


def dead_sonars(station: Station) -> list[str]:
    """Return the names of the sonars without a reading, from left to right."""
    if live(station.seen(SONAR)) is None:
        return []
    return [SONARS[sonar] for sonar in LEFT_TO_RIGHT if station.silent_sonars >> sonar & 1]
