"""Why it drives as it does: the decision of now, and the last ones that changed something."""

from textwrap import wrap

from ground.explain import Explanation, Why, explain
from ground.explain.explanation import NAMES
from ground.station.moments import Moment
from ground.widgets.rows import Row, Span, faint, head, row

NS_PER_S = 1_000_000_000


def now_rows(moment: Moment | None, width: int) -> list[Row]:
    if moment is None:
        return [row(faint("no decision is known"))]
    found = explain(moment.decision, moment.status, moment.cycle, moment.previous)
    return explanation_rows(found, width)


def turn_rows(why: Why, back: int, newest_ns: int | None, width: int) -> list[Row]:
    """A turning point, and how long before the newest decision it was."""
    found = why.at(back)
    if found is None:
        return [row(faint("it has not turned yet"))]
    point, explanation = found
    ago = "" if newest_ns is None else f"{(newest_ns - point.time_ns) / NS_PER_S:.1f} s ago: "
    first = row(Span(ago, "accent"), Span(point.words, "caution"))
    return [first, *explanation_rows(explanation, width)]


def explanation_rows(found: Explanation, width: int) -> list[Row]:
    rows = [row(Span(line, "accent")) for line in wrap(found.headline, max(8, width))]
    for line in found.lines:
        name, text = line[:NAMES], line[NAMES:]
        for piece in wrap(text, max(8, width - NAMES)) or [""]:
            rows.append(row(head(name), piece))
            name = " " * NAMES
    return rows
