"""Explain the present decision, and earlier ones that changed the direction."""

from textwrap import wrap

from ground.app.widgets.rows import Row, Span, faint, head, row
from ground.explain.explanation import NAMES, Explanation, explain
from ground.explain.turns import Why, explained
from ground.station.history.decision_history import Moment
from ground.station.station import Station
from runtime.units import NS_PER_S


def now_rows(moment: Moment | None, width: int) -> list[Row]:
    """Explain the present decision."""
    if moment is None:
        return [row(faint("no decision received"))]
    found = explain(moment.decision, moment.status, moment.cycle, moment.previous)
    return explanation_rows(found, width)


def turn_rows(why: Why, back: int, station: Station, width: int) -> list[Row]:
    """Explain the turning point that is `back` turns ago, and show how long ago it was."""
    turned = why.at(back)
    if turned is None:
        return [row(faint("the robot has not turned yet"))]
    ago_s = (station.now_ns - turned.at_ns) / NS_PER_S
    first = row(Span(f"{ago_s:.1f} s ago: ", "accent"), Span(turned.point.words, "caution"))
    return [first, *explanation_rows(explained(turned, station), width)]


def explanation_rows(found: Explanation, width: int) -> list[Row]:
    """Wrap an explanation to a width in columns."""
    rows = [row(Span(line, "accent")) for line in wrap(found.headline, max(8, width))]
    for line in found.lines:
        name, text = line[:NAMES], line[NAMES:]
        for piece in wrap(text, max(8, width - NAMES)) or [""]:
            rows.append(row(head(name), piece))
            name = " " * NAMES
    return rows
