"""The line under the status: what is lost, what waits, who was restarted; else nothing."""

from textwrap import wrap
from typing import Final

from ground.app.widgets.rows import Row, Span, cut, row
from ground.station.station import Station

MOST_ROWS: Final = 2


def alarm_rows(station: Station, width: int) -> list[Row]:
    """The e-stop first; nothing when there is nothing to say."""
    if station.stopping:
        return across(station.stopping, "alarm", width)
    loss = station.loss()
    if loss is not None:
        words = loss.banner(station.now_ns)
        last = f"; last command: {station.last_command}" if station.last_command else ""
        return across(f"{words}{last}", "alarm", width)
    if station.live and not station.ready:
        words = f"reading {station.waiting_for} before commands are taken"
        return across(words, "caution", width)
    return across(station.restarted, "caution", width) if station.restarted else []


def across(words: str, role: str, width: int) -> list[Row]:
    """From edge to edge, in two rows at the most."""
    room = max(1, width - 2)
    lines = wrap(words, room, max_lines=MOST_ROWS, placeholder="…")
    return [cut(row(Span(f" {line}".ljust(width), role)), width) for line in lines]
