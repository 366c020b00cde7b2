"""How far the mission is, in a line."""

import pytest

from ground.missions.progress import state_name, words
from protocol.wire.enums import MissionState
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason


def status(state: int, *, hold_left_ms: int = 0, reason: int = 0) -> MissionStatus:
    return MissionStatus(
        time_ns=1,
        mission_id=1,
        hold_left_ms=hold_left_ms,
        count=5,
        current=2,
        state=state,
        reason=reason,
    )


@pytest.mark.parametrize(
    ("said", "line"),
    [
        (status(MissionState.NONE), "no mission"),
        (status(MissionState.RUNNING), "running, item 3 of 5"),
        (status(MissionState.HOLDING, hold_left_ms=3200), "holding, item 3 of 5, 3.2 s left"),
        (
            status(MissionState.FAILED, reason=Reason.NO_PROGRESS),
            "failed, item 3 of 5: has come no closer for too long",
        ),
    ],
)
def test_a_line_tells_state_item_hold_and_reason(said: MissionStatus, line: str) -> None:
    assert words(said) == line


def test_a_state_nobody_knows_is_shown_as_a_number() -> None:
    assert state_name(77) == "state 77"
