"""Texts of any length are split into MAVLink pieces and reassembled."""

from ground.text.wording import StatustextAssembler
from protocol.wire.enums import MissionState, Severity
from protocol.wire.reasons import Reason
from protocol.wire.statustext import PIECE_BYTES
from robot.core.parameters import DEFAULTS
from robot.hosting import InProcessCore
from robot.mission import Mission
from robot.telemetry import ChangeLog
from tests.support.each import each


def news() -> ChangeLog:
    core = InProcessCore(DEFAULTS)
    return ChangeLog(core.state.machine, Mission(core))


@each("length", [1, 49, 50, 51, 99, 100, 101, 150, 400])
def test_text_is_complete_only_with_its_last_piece(length: int) -> None:
    words = "".join(chr(97 + at % 26) for at in range(length))
    pieces = news().text(Severity.INFO, words)
    texts = StatustextAssembler()
    assert [texts.receive(piece) for piece in pieces] == [""] * (len(pieces) - 1) + [words]
    assert len(pieces) == (1 if length <= PIECE_BYTES else length // PIECE_BYTES + 1)
    assert {piece.id for piece in pieces} == {0 if length <= PIECE_BYTES else 1}


def test_empty_text_has_no_pieces() -> None:
    assert news().text(Severity.INFO, "") == []


@each(
    ("reason", "words", "severity"),
    [
        (Reason.BY_OPERATOR, "mission aborted: by the operator", Severity.INFO),
        (Reason.BY_HAND, "mission taken over: driven by hand", Severity.INFO),
        (Reason.REPLACED, "mission taken over: replaced by a new goal", Severity.INFO),
        (Reason.DISARMED, "mission aborted: disarmed by the operator", Severity.INFO),
        (Reason.BY_EMERGENCY_STOP, "mission aborted by the emergency stop", Severity.INFO),
        (Reason.BUMPER, "mission FAILED: bumper contact", Severity.ERROR),
    ],
)
def test_mission_that_an_operator_ended_has_not_failed(
    reason: Reason, words: str, severity: Severity
) -> None:
    core = InProcessCore(DEFAULTS)
    mission = Mission(core)
    log = ChangeLog(core.state.machine, mission)
    mission.state, mission.reason = MissionState.FAILED, reason
    (text,) = log.since_last_time()
    assert (text.text, text.severity) == (words, severity)
