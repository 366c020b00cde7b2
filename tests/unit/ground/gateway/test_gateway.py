"""The pace of the loop."""

from ground.gateway.dialect import mavlink
from ground.gateway.gateway import Pace

MS = 1_000_000


def rounds_until(pace: Pace, from_ms: int, to_ms: int) -> int:
    return sum(pace.is_due(now_ms * MS) for now_ms in range(from_ms, to_ms))


def test_rounds_are_calm_while_clients_only_watch() -> None:
    pace = Pace(0)
    pace.note(mavlink.MAVLINK_MSG_ID_HEARTBEAT, 0)
    assert rounds_until(pace, 0, 1000) == 10


def test_rounds_are_fast_while_clients_ask() -> None:
    pace = Pace(0)
    pace.is_due(0)
    pace.note(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, 1 * MS)
    assert rounds_until(pace, 2, 21) == 0
    assert rounds_until(pace, 21, 1021) == 50
    rounds_until(pace, 1021, 2100)
    assert rounds_until(pace, 2100, 3100) == 10


def test_missed_rounds_are_skipped() -> None:
    pace = Pace(0)
    assert pace.is_due(1000 * MS)
    assert rounds_until(pace, 1001, 1100) == 1


def test_rounds_follow_fast_streams() -> None:
    pace = Pace(0)
    assert sum(pace.is_due(now_ms * MS, 50 * MS) for now_ms in range(1000)) == 20
