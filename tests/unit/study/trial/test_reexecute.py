"""A recording is executed again: nothing differs, or the first thing that does is named."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from ground.recording.tlog import record_bytes
from protocol.topics import ANSWERED, COMMANDED, DECISION, DRIVE, INPUTS, SONAR, WHEELS, Topic
from protocol.wire.codec import Encoder, decode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    LeaseRequest,
    MissionVerdict,
    ParamSet,
    WheelCommand,
)
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.core.safety import guard
from robot.parameters.table import described
from runtime.errors import UserError
from study.cli.reexecute import main
from study.trial.recorded_drive import reason_in
from study.trial.reexecute import chooses_navigator
from tests.support.study.recorded_drive import ARM, Drive

Told = dict[str, Any]
Again = Callable[..., tuple[int, Told]]


@pytest.fixture(scope="module")
def whole() -> list[tuple[str, bytes]]:
    return Drive().run().said


@pytest.fixture
def drive(whole: list[tuple[str, bytes]]) -> Drive:
    return Drive(said=list(whole))


@pytest.fixture
def again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Again:
    def execute(drive: Drive, *words: str, **facts: str) -> tuple[int, Told]:
        path = drive.written(tmp_path / "20260304T120005Z-r1.mcap", **facts)
        code = main([str(path), "--json", *words])
        told: Told = json.loads(capsys.readouterr().out)
        return code, told

    return execute


def changed(drive: Drive, topic: Topic[Message], number: int, **values: object) -> None:
    """Another value in one frame, which stays a valid one."""
    place = drive.on(topic)[number]
    key, frame = drive.said[place]
    found = decode(frame)
    message = replace(found.message, **values)
    encoder = Encoder(found.system_id, found.component_id)
    for _ in range(found.sequence + 1):
        frame = encoder.encode(message)
    drive.said[place] = (key, frame)


def test_the_same_build_makes_the_same_of_it(drive: Drive, again: Again) -> None:
    code, told = again(drive)
    assert (code, told["compared"], told["differing"], told["first"]) == (0, 160, 0, None)
    assert told["unheard"] == 0


def test_a_difference_is_found_in_its_tick_with_both_values(drive: Drive, again: Again) -> None:
    message = decode(drive.said[drive.on(DRIVE)[77]][1]).message
    assert isinstance(message, WheelCommand)
    changed(drive, DRIVE, 77, left_mrad_s=message.left_mrad_s + 1)
    code, told = again(drive)
    assert code == 1
    assert told["first"] == {
        "tick": 77,
        "time_s": 77 * 0.05,
        "message": "WheelCommand",
        "field": "left_mrad_s",
        "recorded": message.left_mrad_s + 1,
        "now": message.left_mrad_s,
    }


def test_a_decision_that_differs_is_found_too(drive: Drive, again: Again) -> None:
    changed(drive, DECISION, 40, zone_m=9.5)
    _, told = again(drive)
    first = told["first"]
    assert (first["tick"], first["message"], first["field"]) == (40, "AvoidanceDecision", "zone_m")


def test_another_core_is_found_out(
    drive: Drive, again: Again, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The guard of this build is made to brake from its 90th tick on."""
    real_limit, ticks = guard.limit, iter(range(10_000))

    def careful(*given: Any) -> tuple[float, int]:
        factor, reason = real_limit(*given)
        return (0.5 * factor, reason or 1) if next(ticks) >= 90 else (factor, reason)

    monkeypatch.setattr(guard, "limit", careful)
    code, told = again(drive)
    assert code == 1
    assert told["first"]["tick"] == 90


def test_other_parameters_are_found_out(drive: Drive, again: Again) -> None:
    slower = DEFAULTS._replace(v_max_m_s=0.2)
    code, told = again(drive, parameters=json.dumps(described(slower)))
    assert code == 1
    assert 4 < told["first"]["tick"] < 40


def test_another_navigator_says_from_where_on(
    drive: Drive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(drive.written(tmp_path / "a.mcap"))
    assert main([path, "--navigator", "bug"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("bug would have decided otherwise from tick ")
    assert "open loop" in said
    assert main([path, "--navigator", "vgm_memory"]) == 0
    said = capsys.readouterr().out
    assert "vgm_memory would have done the same in all 160 ticks" in said


def test_a_gap_ends_it_with_the_reason(drive: Drive, again: Again) -> None:
    del drive.said[drive.on(INPUTS)[100]]
    code, told = again(drive)
    assert (code, told["compared"], told["ticks"]) == (1, 100, 159)
    assert told["first"] is None
    assert told["lack"] == "the inputs of the tick before it"


@pytest.mark.parametrize(("topic", "words"), [(SONAR, "sonar scan"), (WHEELS, "wheel ticks")])
def test_a_sense_that_was_not_recorded_ends_it(
    drive: Drive, again: Again, topic: Topic[Message], words: str
) -> None:
    del drive.said[drive.on(topic)[50]]
    code, told = again(drive)
    assert (code, told["compared"]) == (1, 50)
    assert words in told["lack"]


def test_a_request_that_was_not_recorded_ends_it(drive: Drive, again: Again) -> None:
    del drive.said[drive.on(COMMANDED)[0]]
    code, told = again(drive)
    assert (code, told["compared"]) == (1, 4)
    assert told["lack"] == "request 1, which came before it"


def test_what_was_not_heard_of_an_outcome_is_told_and_not_compared(
    drive: Drive, again: Again
) -> None:
    del drive.said[drive.on(DRIVE)[30]]
    code, told = again(drive)
    assert (code, told["unheard"], told["compared"]) == (0, 1, 160)


def test_it_may_begin_while_the_robot_still_stands(drive: Drive, again: Again) -> None:
    drive.said = drive.said[drive.on(WHEELS)[2] :]
    code, told = again(drive)
    assert (code, told["compared"], told["differing"]) == (0, 158, 0)


def test_it_begins_when_the_recorder_has_heard_the_plant_too(drive: Drive, again: Again) -> None:
    for topic, number in ((WHEELS, 1), (SONAR, 1), (SONAR, 0)):
        del drive.said[drive.on(topic)[number]]
    code, told = again(drive)
    assert (code, told["compared"], told["differing"]) == (0, 158, 0)


@pytest.mark.parametrize("both", [False, True])
def test_it_ends_where_a_plant_or_all_was_started_again(
    drive: Drive, again: Again, both: bool
) -> None:
    """What they count from then on has been counted before."""
    anew = Drive().run(ticks=40)
    if not both:
        for number in range(len(anew.on(INPUTS))):
            changed(anew, INPUTS, number, tick=160 + number)
    drive.said += anew.said
    code, told = again(drive)
    assert (code, told["ticks"], told["compared"], told["differing"]) == (1, 160, 160, 0)
    assert told["lack"] == "the rest: robot or plant was started again"


def test_without_any_sense_it_says_what_it_lacks(drive: Drive, again: Again) -> None:
    places = drive.on(WHEELS)
    drive.said = [one for place, one in enumerate(drive.said) if place not in places]
    code, told = again(drive)
    assert (code, told["compared"]) == (1, 0)
    assert told["lack"] == "wheel ticks 0, which it was given"


def refusal(drive: Drive, tmp_path: Path, **facts: str) -> str:
    path = drive.written(tmp_path / "a.mcap", **facts)
    with pytest.raises(UserError) as caught:
        main([str(path)])
    return str(caught.value)


def test_a_recording_that_begins_in_the_middle_is_refused(drive: Drive, tmp_path: Path) -> None:
    drive.said = drive.said[drive.on(WHEELS)[60] :]
    assert "begins after 2 requests" in refusal(drive, tmp_path)


def test_one_that_begins_when_the_robot_had_been_moved_is_refused(tmp_path: Path) -> None:
    drive = Drive().run(ticks=60)
    drive.said = drive.said[drive.on(WHEELS)[50] :]
    for number in range(len(drive.on(INPUTS))):
        changed(drive, INPUTS, number, requests=0)
    assert "had been moved before it begins" in refusal(drive, tmp_path)


def test_without_parameters_or_inputs_it_is_refused(drive: Drive, tmp_path: Path) -> None:
    assert "parameters are not in it" in refusal(drive, tmp_path, parameters="")
    assert "cannot be read" in refusal(drive, tmp_path, parameters='[{"name": 1}]')
    for place in reversed(drive.on(INPUTS)):
        del drive.said[place]
    assert "no tick's inputs are in it" in refusal(drive, tmp_path)


def test_without_its_world_the_start_is_what_a_person_may_have_typed(
    drive: Drive, again: Again
) -> None:
    code, told = again(drive, world="")
    assert (code, told["differing"]) == (0, 0)


def test_a_tlog_is_executed_with_what_its_mcap_knows(
    drive: Drive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive.written(tmp_path / "a.mcap")
    path = tmp_path / "a.tlog"
    records = (record_bytes(1_790_000_000_000_000, frame) for _, frame in drive.said)
    path.write_bytes(b"".join(records))
    assert main([str(path)]) == 0
    assert "160 ticks executed again: nothing differs" in capsys.readouterr().out


def test_what_another_operator_was_refused_is_not_acted_on(drive: Drive, again: Again) -> None:
    """Bob's abort came in while Ada held the lease."""
    abort = CommandRequest(request_id=9, param1=0.0, param2=0.0, command=31_001)
    asked = drive.on(COMMANDED)[-1]
    encoders = {COMMANDED.path: Encoder(1, 1), ANSWERED.path: Encoder(1, 1)}
    for topic, message in ((COMMANDED, ARM), (ANSWERED, CommandAck(command=0, result=0))):
        for _ in range(2):
            encoders[topic.path].encode(message)
    held = CommandAck(command=0, result=2, result_param2=Reason.LEASE_HELD)
    extra = [
        (COMMANDED.key("r1"), encoders[COMMANDED.path].encode(abort)),
        (ANSWERED.key("r1"), encoders[ANSWERED.path].encode(held)),
    ]
    drive.said[asked + 2 : asked + 2] = extra
    for number in range(4, 160):
        changed(drive, INPUTS, number, requests=3)
    code, told = again(drive)
    assert (code, told["differing"], told["compared"]) == (0, 0, 160)


def test_only_what_chooses_a_navigator_is_left_out_for_another() -> None:
    assert chooses_navigator(ParamSet(param_id="side", param_value=1.0, param_type=6))
    assert not chooses_navigator(ParamSet(param_id="v_max_m_s", param_value=1.0, param_type=9))
    assert not chooses_navigator(ARM)
    assert not chooses_navigator(LeaseRequest(request_id=1, action=0, name="ada"))


def test_the_reason_is_read_from_either_kind_of_answer() -> None:
    verdict = MissionVerdict(mission_id=0, item=0, reason=Reason.LEASE_HELD, mission_type=0)
    assert reason_in(verdict) == Reason.LEASE_HELD
    assert reason_in(None) == Reason.NONE
