"""Show the progress of the mission, and the draft of a mission."""

from math import degrees
from typing import Final

from ground.app.panels.aged import aged
from ground.app.widgets.rows import Row, Span, head, row
from ground.map.scene import MapTarget
from ground.station.station import Station
from protocol.outcome import mission_state
from protocol.topics import MISSION
from protocol.wire.enums import MissionState
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import reason_text

MOST: Final = 6


def mission_rows(station: Station) -> list[Row]:
    """Return the state and the items around the current one; no rows without a mission."""
    seen = station.seen(MISSION)
    status = seen.message
    if not isinstance(status, MissionStatus) or status.state == MissionState.NONE:
        return []
    items = list(enumerate(station.mission_items))
    first = max(0, min(status.current - 1, len(items) - MOST))
    return [
        row(head("mission "), aged(seen, mission_words, "mission")),
        *(item_row(number, item, status.current) for number, item in items[first : first + MOST]),
    ]


def draft_rows(count: int) -> list[Row]:
    """Return how many waypoints wait to be sent; no rows when there are none."""
    waypoints = f"{count} waypoint{'' if count == 1 else 's'}"
    return [row(head("draft   "), Span(f"{waypoints}, W sends", "draft"))] if count else []


def item_row(number: int, item: MapTarget, current: int) -> Row:
    """Return the row of an item, counted from 1.

    Completed items are faint, the current one is marked.
    """
    heading = item.heading_rad
    deg = "any" if heading is None else f"{degrees(heading):z.0f}°"
    words = f"{number + 1:>3}  {item.x_m:z6.2f} {item.y_m:z6.2f}  {deg:>5}"
    role = "faint" if number < current else "mission" if number == current else "text"
    return row(Span("▶" if number == current else " ", "mission"), Span(words, role))


def mission_words(status: MissionStatus) -> str:
    """Return state, current item, hold time and reason as text."""
    state = mission_state(status.state, status.reason)
    hold = f", holds {status.hold_left_ms / 1000:.0f} s" if status.hold_left_ms else ""
    why = f": {reason_text(status.reason)}" if status.reason else ""
    return f"{state} {status.current + 1}/{status.count}{hold}{why}"
