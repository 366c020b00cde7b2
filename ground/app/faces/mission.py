"""How far the mission is."""

from ground.app.faces.aged import aged
from ground.station.station import Station
from ground.widgets.rows import Row, head, row
from protocol.enums import MissionState
from protocol.messages import MissionStatus
from protocol.reasons import reason_text
from protocol.topics import MISSION


def mission_rows(station: Station) -> list[Row]:
    """Nothing while there is none."""
    seen = station.seen(MISSION)
    if isinstance(seen.message, MissionStatus) and seen.message.state != MissionState.NONE:
        return [row(head("mission "), aged(seen, mission_words, "mission"))]
    return []


def mission_words(status: MissionStatus) -> str:
    known = status.state in list(MissionState)
    state = MissionState(status.state).name if known else f"state {status.state}"
    hold = f", holds {status.hold_left_ms / 1000:.0f} s" if status.hold_left_ms else ""
    why = f": {reason_text(status.reason)}" if status.reason else ""
    return f"{state} {status.current + 1}/{status.count}{hold}{why}"
