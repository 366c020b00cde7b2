"""Make rows from lines of the log: clock time, severity as a letter, source, text."""

from textwrap import wrap
from time import localtime, strftime
from typing import Final

from ground.app.widgets.rows import Row, Span, faint, head, row, width_of
from ground.station.history.event_log import EventLog, LogLine

ROLES: Final = {"E": "danger", "W": "caution", "I": "text", "D": "faint"}
LEAST: Final = 20
"""The least columns of text. A narrower panel cuts rows instead of making many."""
MOST_LATELY: Final = 3
"""The most rows for one line where only the last lines are shown."""


def log_rows(
    line: LogLine, width: int, *, found: bool = False, most: int | None = None, source: int = 0
) -> list[Row]:
    """Wrap a line to at most `most` rows; further rows are indented to where the text begins.

    `source` is the least width of the column of sources.
    """
    lead = lead_of(line, source)
    role = "reverse" if found else ROLES[line.letter]
    pieces = pieces_of(line, width, most, source)
    indent = " " * width_of(lead)
    return [
        row(*(lead if number == 0 else (Span(indent),)), Span(piece, role))
        for number, piece in enumerate(pieces)
    ]


def lead_of(line: LogLine, source: int = 0) -> Row:
    """Return time, severity and source of a line."""
    return row(
        faint(f"{clock_words(line)} "),
        Span(line.letter, ROLES[line.letter]),
        head(f" {line.source:<{source}} "),
    )


def clock_words(line: LogLine) -> str:
    """Return the local wall time; the seconds since the beginning for a played recording."""
    if line.clock_s is None:
        return f"{line.time_s:8.1f}"
    return strftime("%H:%M:%S", localtime(line.clock_s))


def zone_words(line: LogLine) -> str:
    """Return the time zone of a line, or the unit of a played recording."""
    return "time in s" if line.clock_s is None else strftime("times in %Z", localtime(line.clock_s))


def pieces_of(line: LogLine, width: int, most: int | None = None, source: int = 0) -> list[str]:
    """Wrap the text of a line, only if needed: there may be ten thousand lines."""
    room = max(LEAST, width - width_of(lead_of(line, source)))
    if len(line.text) <= room:
        return [line.text]
    pieces = wrap(line.text, room, break_on_hyphens=False, max_lines=most, placeholder="…")
    return pieces or [""]


def latest_rows(log: EventLog, height: int, width: int) -> list[Row]:
    """Return the end of the log in `height` rows; a long line shows only its beginning."""
    rows: list[Row] = []
    for line in reversed(log.last(height)):
        room = min(MOST_LATELY, height - len(rows))
        if not room:
            break
        rows = [*log_rows(line, width, most=room), *rows]
    return rows
