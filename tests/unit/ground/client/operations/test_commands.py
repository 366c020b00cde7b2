"""Commands: accepted, refused with a remedy, repeated under one id, and given up with a reason."""

import pytest

from ground.client.link import UnansweredError
from ground.client.operations.commands import (
    COMMANDS,
    Arm,
    ClearEmergencyStop,
    Hold,
    Mark,
    Restart,
    SetMode,
    SetNavigator,
    StopNow,
)
from ground.client.operations.session import Operation
from ground.client.requests import ATTEMPTS
from ground.client.results import Accepted, Outcome, Refused, RefusedError, agreed
from protocol.topics import STATUS, STOP
from protocol.wire.enums import Command, Mode, Navigator, Vehicle
from protocol.wire.messages import CommandRequest
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.ground.client import (
    ANSWER_NS,
    HELD,
    Stage,
    status,
)


def test_agreement_is_accepted_with_the_time_it_took() -> None:
    stage = Stage()
    outcome = Hold().perform(stage.session)
    assert outcome == Accepted(ANSWER_NS)
    assert outcome.text == "ok 14 ms"
    assert outcome.as_json("hold", "r1") == {
        "verb": "hold",
        "robot": "r1",
        "ok": True,
        "reason": "ok",
        "reason_code": 0,
        "took_ms": 14.0,
    }


def test_refusal_names_the_reason_and_the_remedy() -> None:
    outcome = Arm().perform(Stage(Reason.EMERGENCY_STOPPED).session)
    assert isinstance(outcome, Refused)
    assert (outcome.ok, outcome.reason) == (False, Reason.EMERGENCY_STOPPED)
    assert outcome.text.startswith("refused: ")
    assert outcome.text.endswith("(sidestep clear-estop)")
    with pytest.raises(RefusedError, match="clear-estop"):
        agreed(outcome)


def test_refusal_for_the_lease_names_its_holder() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.set_newest(*HELD)
    outcome = Arm().perform(stage.session)
    assert isinstance(outcome, Refused)
    assert (outcome.holder, "anna (--seize takes it over" in outcome.text) == ("anna", True)


def test_lost_answers_are_asked_for_again_under_one_id() -> None:
    stage = Stage(None, None, Reason.NONE)
    assert Hold().perform(stage.session).ok
    assert len(stage.bus.requests) == 3
    assert len({request.request_id for request in stage.bus.requests}) == 1


@each("reason", [Reason.TOO_LATE, Reason.TOO_MANY_REQUESTS])
def test_request_that_the_robot_did_not_look_at_is_repeated(reason: Reason) -> None:
    stage = Stage(reason, Reason.NONE)
    assert Hold().perform(stage.session).ok
    assert len(stage.bus.requests) == 2


def test_silence_is_given_up_after_the_time_allowed() -> None:
    stage = Stage(*[None] * 10)
    began_ns = stage.clock.now_ns()
    with pytest.raises(UnansweredError, match="no answer within the time"):
        Hold(timeout_s=0.6).perform(stage.session)
    assert len(stage.bus.requests) == ATTEMPTS
    assert stage.clock.now_ns() - began_ns >= 600_000_000


@each(
    ("operation", "wire"),
    [
        (SetMode(mode=Mode.MANUAL), (Command.DO_SET_MODE, 1.0, float(Mode.MANUAL))),
        (
            SetNavigator(navigator=Navigator.BUG, side=-1),
            (Command.SIDESTEP_SET_NAVIGATOR, float(Navigator.BUG), -1.0),
        ),
        (Arm(), (Command.COMPONENT_ARM_DISARM, 1.0, 0.0)),
        (Restart(), (Command.PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0)),
    ],
)
def test_values_become_the_parameters_of_the_command(
    operation: Operation[Outcome], wire: tuple[int, float, float]
) -> None:
    stage = Stage()
    operation.perform(stage.session)
    (request,) = stage.bus.requests
    assert (request.command, request.param1, request.param2) == wire


def test_a_release_names_the_stop_of_the_newest_status() -> None:
    stage = Stage(None, Reason.NONE)
    stage.bus.set_newest(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=7))
    stage.bus.on_ask = lambda _: stage.bus.set_newest(STATUS, status(stop_id=8))
    assert ClearEmergencyStop().perform(stage.session).ok
    assert [request.stop_id for request in stage.bus.requests] == [7, 7], "by each repetition"


def test_a_release_names_the_stop_that_was_shown_when_it_was_asked_for() -> None:
    stage = Stage()
    stage.bus.set_newest(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=8))
    ClearEmergencyStop(stop_ids=(7,)).perform(stage.session)
    assert [request.stop_id for request in stage.bus.requests] == [7]


def test_a_release_names_own_stops_after_the_one_that_was_shown() -> None:
    stage = Stage(Reason.NEWER_STOP, Reason.NEWER_STOP, Reason.NONE)
    assert ClearEmergencyStop(stop_ids=(7, 7, 21, 22, 23)).perform(stage.session).ok
    assert [request.stop_id for request in stage.bus.requests] == [7, 21, 22]
    assert len({request.request_id for request in stage.bus.requests}) == 3


def test_a_release_that_is_refused_for_another_reason_names_no_other_stop() -> None:
    stage = Stage(Reason.LEASE_HELD)
    assert not ClearEmergencyStop(stop_ids=(7, 21)).perform(stage.session).ok
    assert [request.stop_id for request in stage.bus.requests if request] == [7]


def test_a_release_is_not_sent_without_a_status() -> None:
    stage = Stage()
    with pytest.raises(UnansweredError, match="no status names the emergency stop to clear"):
        ClearEmergencyStop().perform(stage.session)
    assert stage.bus.requests == []


def test_a_refusal_for_a_newer_stop_says_what_to_do() -> None:
    outcome = ClearEmergencyStop(stop_ids=(7,)).perform(Stage(Reason.NEWER_STOP).session)
    assert outcome.text == (
        "refused: a newer emergency stop was pressed: look, then clear again (sidestep clear-estop)"
    )


def test_what_stops_the_robot_needs_no_lease() -> None:
    still = {operation.verb for operation in COMMANDS if not operation().moves}
    assert still == {"hold", "abort", "disarm"}
    assert not StopNow.moves
    assert [mode for mode in Mode if not SetMode(mode=mode).moves] == [Mode.HOLD]


def test_stop_is_repeated_until_the_status_shows_it() -> None:
    stage = Stage(*[Reason.NONE] * 3)

    def show(number: int) -> None:
        if number == 2:
            request = stage.bus.sent[0][1]
            assert isinstance(request, CommandRequest)
            stage.bus.set_newest(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=request.request_id))

    stage.bus.on_ask = show
    outcome = StopNow().perform(stage.session)
    assert outcome.ok
    assert outcome.text.startswith("E-STOP acknowledged by r1")
    assert [key for key, _ in stage.bus.sent] == [STOP.path] * 2


def test_unacknowledged_stop_is_given_up_with_a_warning() -> None:
    stage = Stage()
    stage.bus.set_newest(STATUS, status(Vehicle.ACTIVE))
    outcome = StopNow(timeout_s=0.2).perform(stage.session)
    assert not outcome.ok
    assert outcome.text.startswith("E-STOP GIVEN UP")
    assert outcome.as_json("estop", "r1")["reason_code"] is None
    assert len(stage.bus.sent) >= 4


def test_mark_reports_that_no_recorder_runs() -> None:
    stage = Stage()
    assert Mark(remark="it turned").perform(stage.session).text == "marked: it turned"
    stage.bus.has_subscriber = False
    outcome = Mark(remark="it turned").perform(stage.session)
    assert (outcome.ok, outcome.text) == (
        False,
        "no recorder is running: start one with sidestep rec start DIR",
    )
