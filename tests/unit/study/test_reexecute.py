"""A recording is re-executed without a difference, or the first one is reported."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from ground.missions.mission import Circle, Fence
from ground.missions.transfer import fence_items_of
from ground.recording.log_reader import record_bytes
from protocol.topics import (
    ANSWERED,
    COMMANDED,
    DECISION,
    DRIVE,
    INPUTS,
    SONAR,
    STATUS,
    WHEELS,
    Topic,
)
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import MissionType
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    LeaseRequest,
    MissionClearAll,
    MissionCount,
    MissionVerdict,
    NavigatorStatus,
    ParamSet,
    WheelCommand,
)
from protocol.wire.reasons import Reason
from robot.core.modes import Machine
from robot.core.parameters import DEFAULTS
from robot.core.safety import guard
from robot.emergency_stop import emergency_stop
from robot.parameter_table import described
from robot.storage import Store
from runtime.errors import UserError
from study.cli.reexecute import main
from study.trial.reexecution import RecordedRequest, chooses_navigator, reason_in
from tests.support.each import each
from tests.support.studies import ARM, ScriptedDrive

Values = dict[str, Any]
Reexecute = Callable[..., tuple[int, Values]]


@pytest.fixture(scope="module")
def whole() -> list[tuple[str, bytes]]:
    return ScriptedDrive().run().frames


@pytest.fixture
def drive(whole: list[tuple[str, bytes]]) -> ScriptedDrive:
    return ScriptedDrive(frames=list(whole))


@pytest.fixture
def reexecute(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Reexecute:
    def execute(drive: ScriptedDrive, *words: str, **facts: str) -> tuple[int, Values]:
        path = drive.write(tmp_path / "20260304T120005Z-r1.mcap", **facts)
        code = main([str(path), "--json", *words])
        values: Values = json.loads(capsys.readouterr().out)
        return code, values

    return execute


def changed(drive: ScriptedDrive, topic: Topic[Message], number: int, **values: object) -> None:
    """Change values of one frame and keep it valid."""
    place = drive.places_of(topic)[number]
    key, frame = drive.frames[place]
    found = decode(frame)
    message = replace(found.message, **values)
    encoder = Encoder(found.system_id, found.component_id)
    for _ in range(found.sequence + 1):
        frame = encoder.encode(message)
    drive.frames[place] = (key, frame)


def test_same_build_reproduces_the_recording(drive: ScriptedDrive, reexecute: Reexecute) -> None:
    code, values = reexecute(drive)
    assert (code, values["compared"], values["differing"], values["first"]) == (0, 160, 0, None)
    assert values["unheard"] == 0


def test_a_copy_of_an_earlier_stop_is_shown_in_the_same_tick(reexecute: Reexecute) -> None:
    drive = ScriptedDrive().run(ticks=8, asked=[emergency_stop(number) for number in (7, 8, 7)])
    frames = [decode(drive.frames[place][1]).message for place in drive.places_of(STATUS)]
    shown = [one.stop_id for one in frames if isinstance(one, NavigatorStatus)]
    assert shown == [0, 7, 8, 8, 8, 8, 8, 8]
    code, values = reexecute(drive)
    assert (code, values["compared"], values["first"]) == (0, 8, None)


def test_difference_is_reported_with_tick_and_values(
    drive: ScriptedDrive, reexecute: Reexecute
) -> None:
    message = decode(drive.frames[drive.places_of(DRIVE)[77]][1]).message
    assert isinstance(message, WheelCommand)
    changed(drive, DRIVE, 77, left_mrad_s=message.left_mrad_s + 1)
    code, values = reexecute(drive)
    assert code == 1
    assert values["first"] == {
        "tick": 77,
        "time_s": 77 * 0.05,
        "message": "WheelCommand",
        "field": "left_mrad_s",
        "recorded": message.left_mrad_s + 1,
        "now": message.left_mrad_s,
    }


def test_different_decision_is_reported(drive: ScriptedDrive, reexecute: Reexecute) -> None:
    changed(drive, DECISION, 40, zone_m=9.5)
    _, values = reexecute(drive)
    first = values["first"]
    assert (first["tick"], first["message"], first["field"]) == (40, "AvoidanceDecision", "zone_m")


def test_changed_guard_is_detected(
    drive: ScriptedDrive, reexecute: Reexecute, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Make the guard of this build brake from its 90th tick on."""
    real_limit, ticks = guard.limit, iter(range(10_000))

    def careful(*given: Any) -> tuple[float, int]:
        factor, reason = real_limit(*given)
        return (0.5 * factor, reason or 1) if next(ticks) >= 90 else (factor, reason)

    monkeypatch.setattr(guard, "limit", careful)
    code, values = reexecute(drive)
    assert code == 1
    assert values["first"]["tick"] == 90


def test_changed_parameters_are_detected(drive: ScriptedDrive, reexecute: Reexecute) -> None:
    slower = DEFAULTS._replace(v_max_m_s=0.2)
    code, values = reexecute(drive, parameters=json.dumps(described(slower)))
    assert code == 1
    assert 4 <= values["first"]["tick"] < 40


def test_other_navigator_reports_first_difference(
    drive: ScriptedDrive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(drive.write(tmp_path / "a.mcap"))
    assert main([path, "--navigator", "bug"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("bug decides differently from tick ")
    assert "open loop" in printed
    assert main([path, "--navigator", "vgm_memory"]) == 0
    assert "vgm_memory decides the same in all 160 ticks" in capsys.readouterr().out


def test_gap_in_inputs_stops_with_reason(drive: ScriptedDrive, reexecute: Reexecute) -> None:
    del drive.frames[drive.places_of(INPUTS)[100]]
    code, values = reexecute(drive)
    assert (code, values["compared"], values["ticks"]) == (1, 100, 159)
    assert values["first"] is None
    assert values["lack"] == "the inputs of the tick before are not recorded"


@pytest.mark.parametrize(("topic", "words"), [(SONAR, "sonar scan"), (WHEELS, "wheel ticks")])
def test_unrecorded_sample_stops_with_reason(
    drive: ScriptedDrive, reexecute: Reexecute, topic: Topic[Message], words: str
) -> None:
    del drive.frames[drive.places_of(topic)[50]]
    code, values = reexecute(drive)
    assert (code, values["compared"]) == (1, 50)
    assert words in values["lack"]


def test_unrecorded_request_stops_with_reason(drive: ScriptedDrive, reexecute: Reexecute) -> None:
    del drive.frames[drive.places_of(COMMANDED)[0]]
    code, values = reexecute(drive)
    assert (code, values["compared"]) == (1, 4)
    assert values["lack"] == "request 1, which came before it, is not recorded"


def test_unrecorded_output_is_counted_and_not_compared(
    drive: ScriptedDrive, reexecute: Reexecute
) -> None:
    del drive.frames[drive.places_of(DRIVE)[30]]
    code, values = reexecute(drive)
    assert (code, values["unheard"], values["compared"]) == (0, 1, 160)


def test_recording_may_begin_before_the_robot_moves(
    drive: ScriptedDrive, reexecute: Reexecute
) -> None:
    drive.frames = drive.frames[drive.places_of(WHEELS)[2] :]
    code, values = reexecute(drive)
    assert (code, values["compared"], values["differing"]) == (0, 158, 0)


def test_begins_once_plant_messages_are_recorded(
    drive: ScriptedDrive, reexecute: Reexecute
) -> None:
    for topic, number in ((WHEELS, 1), (SONAR, 1), (SONAR, 0)):
        del drive.frames[drive.places_of(topic)[number]]
    code, values = reexecute(drive)
    assert (code, values["compared"], values["differing"]) == (0, 158, 0)


@pytest.mark.parametrize("both", [False, True])
def test_stops_where_plant_or_robot_was_restarted(
    drive: ScriptedDrive, reexecute: Reexecute, both: bool
) -> None:
    """Append a second drive, whose counters start again."""
    restarted = ScriptedDrive().run(ticks=40)
    if not both:
        for number in range(len(restarted.places_of(INPUTS))):
            changed(restarted, INPUTS, number, tick=160 + number)
    drive.frames += restarted.frames
    code, values = reexecute(drive)
    assert (code, values["ticks"], values["compared"], values["differing"]) == (1, 160, 160, 0)
    assert values["lack"] == "robot or plant was restarted"


def test_recording_without_samples_stops_with_reason(
    drive: ScriptedDrive, reexecute: Reexecute
) -> None:
    places = drive.places_of(WHEELS)
    drive.frames = [one for place, one in enumerate(drive.frames) if place not in places]
    code, values = reexecute(drive)
    assert (code, values["compared"]) == (1, 0)
    assert values["lack"] == "its input, wheel ticks 0, is not recorded"


def refusal(drive: ScriptedDrive, tmp_path: Path, **facts: str) -> str:
    path = drive.write(tmp_path / "a.mcap", **facts)
    with pytest.raises(UserError) as caught:
        main([str(path)])
    return str(caught.value)


def test_recording_that_begins_midway_is_refused(drive: ScriptedDrive, tmp_path: Path) -> None:
    drive.frames = drive.frames[drive.places_of(WHEELS)[60] :]
    assert "begins after 2 requests" in refusal(drive, tmp_path)


def test_recording_that_begins_after_motion_is_refused(tmp_path: Path) -> None:
    drive = ScriptedDrive().run(ticks=60)
    drive.frames = drive.frames[drive.places_of(WHEELS)[50] :]
    for number in range(len(drive.places_of(INPUTS))):
        changed(drive, INPUTS, number, requests=0)
    assert "begins after the robot has moved" in refusal(drive, tmp_path)


def test_recording_without_parameters_or_inputs_is_refused(
    drive: ScriptedDrive, tmp_path: Path
) -> None:
    assert "holds the robot's parameters" in refusal(drive, tmp_path, parameters="")
    assert "cannot be read" in refusal(drive, tmp_path, parameters='[{"name": 1}]')
    for place in reversed(drive.places_of(INPUTS)):
        del drive.frames[place]
    assert "no inputs of control ticks" in refusal(drive, tmp_path)


def test_start_is_guessed_without_the_world(drive: ScriptedDrive, reexecute: Reexecute) -> None:
    code, values = reexecute(drive, world="")
    assert (code, values["differing"]) == (0, 0)


def test_tlog_uses_parameters_of_its_mcap(
    drive: ScriptedDrive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive.write(tmp_path / "a.mcap")
    path = tmp_path / "a.tlog"
    records = (record_bytes(1_790_000_000_000_000, frame) for _, frame in drive.frames)
    path.write_bytes(b"".join(records))
    assert main([str(path)]) == 0
    assert "160 ticks re-executed: no difference" in capsys.readouterr().out


def test_request_refused_for_the_lease_is_not_executed(
    drive: ScriptedDrive, reexecute: Reexecute
) -> None:
    """Record an abort by Bob while Ada holds the lease."""
    abort = CommandRequest(request_id=9, param1=0.0, param2=0.0, command=31_001)
    asked = drive.places_of(COMMANDED)[-1]
    encoders = {COMMANDED.path: Encoder(1, 1), ANSWERED.path: Encoder(1, 1)}
    for topic, message in ((COMMANDED, ARM), (ANSWERED, CommandAck(command=0, result=0))):
        for _ in range(2):
            encoders[topic.path].encode(message)
    held = CommandAck(command=0, result=2, result_param2=Reason.LEASE_HELD)
    extra = [
        (COMMANDED.key("r1"), encoders[COMMANDED.path].encode(abort)),
        (ANSWERED.key("r1"), encoders[ANSWERED.path].encode(held)),
    ]
    drive.frames[asked + 2 : asked + 2] = extra
    for number in range(4, 160):
        changed(drive, INPUTS, number, requests=3)
    code, values = reexecute(drive)
    assert (code, values["differing"], values["compared"]) == (0, 0, 160)


@each("reason", [Reason.NONE, Reason.NO_GOAL, Reason.NO_OPERATOR])
@each("operator", [True, False])
def test_request_refused_for_its_absent_program_is_not_executed(
    reason: Reason, *, operator: bool
) -> None:
    """The core refuses without any operator; with another one it never saw the request."""
    machine = Machine(DEFAULTS)
    machine.operator = operator
    acted_on = RecordedRequest(ARM, reason).was_acted_on(machine)
    assert acted_on == (reason != Reason.NO_OPERATOR or not operator)


def test_only_navigator_requests_are_skipped() -> None:
    assert chooses_navigator(ParamSet(param_id="side", param_value=1.0, param_type=6))
    assert not chooses_navigator(ParamSet(param_id="v_max_m_s", param_value=1.0, param_type=9))
    assert not chooses_navigator(ARM)
    assert not chooses_navigator(LeaseRequest(request_id=1, action=0, name="ada"))


def test_reason_is_read_from_both_kinds_of_answer() -> None:
    verdict = MissionVerdict(mission_id=0, item=0, reason=Reason.LEASE_HELD, mission_type=0)
    assert reason_in(verdict) == Reason.LEASE_HELD
    assert reason_in(None) == Reason.NONE


AROUND = Circle(x_m=2.0, y_m=1.5, radius_m=4.0)
ELSEWHERE = Circle(x_m=50.0, y_m=50.0, radius_m=1.0)


def upload(fence: Fence) -> list[Message]:
    items = fence_items_of(fence)
    return [MissionCount(count=len(items), mission_type=MissionType.FENCE), *items]


def late(drive: ScriptedDrive, *, with_events: bool = True) -> ScriptedDrive:
    """Keep the recording from the third tick on, with or without the earlier events."""
    begin = drive.places_of(WHEELS)[2]
    places = sorted([*drive.places_of(COMMANDED), *drive.places_of(ANSWERED)])
    events = [drive.frames[place] for place in places if place < begin]
    drive.frames = [*(events if with_events else []), *drive.frames[begin:]]
    return drive


def verdict(
    drive: ScriptedDrive, path: Path, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str]:
    code = main([str(drive.write(path / "a.mcap")), "--json"])
    printed = capsys.readouterr()
    values = json.loads(printed.out)
    return code, f"{values['compared']} {values['differing']}"


def test_restored_fence_is_re_executed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ScriptedDrive().run(ticks=2, store=Store(tmp_path), asked=upload(AROUND))
    drive = ScriptedDrive().run(ticks=40, store=Store(tmp_path))
    assert len(drive.places_of(COMMANDED)) == 4, "its fence, armed, its goal"
    assert verdict(drive, tmp_path, capsys) == (0, "40 0")
    assert verdict(late(drive), tmp_path, capsys) == (0, "38 0")


@pytest.mark.parametrize("asked", [[], [MissionClearAll(mission_type=MissionType.FENCE)]])
def test_lost_fence_is_re_executed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: list[Message]
) -> None:
    """Arming is refused until the fence is cleared."""
    (tmp_path / "fence.json").write_text("{")
    drive = ScriptedDrive().run(ticks=40, store=Store(tmp_path), asked=asked)
    assert verdict(drive, tmp_path, capsys) == (0, "40 0")


def test_earlier_fence_and_parameter_are_in_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = ParamSet(param_id="v_max_m_s", param_value=0.1, param_type=9)
    drive = ScriptedDrive().run(ticks=60, asked=[*upload(AROUND), slow])
    assert verdict(late(drive), tmp_path, capsys) == (0, "58 0")


def test_refused_fence_is_not_in_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Refuse a fence that a robot without samples would have accepted."""
    drive = ScriptedDrive().run(ticks=60, asked=upload(ELSEWHERE))
    assert verdict(late(drive), tmp_path, capsys) == (0, "58 0")


def test_recording_without_earlier_requests_is_refused(tmp_path: Path) -> None:
    drive = late(ScriptedDrive().run(ticks=20, asked=upload(AROUND)), with_events=False)
    with pytest.raises(UserError, match="begins after 2 requests"):
        main([str(drive.write(tmp_path / "a.mcap"))])


def test_restored_stop_is_re_executed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ScriptedDrive().run(ticks=2, store=Store(tmp_path), asked=[*upload(AROUND), emergency_stop(7)])
    drive = ScriptedDrive().run(ticks=20, store=Store(tmp_path))
    assert verdict(drive, tmp_path, capsys) == (0, "20 0")
    assert verdict(late(drive), tmp_path, capsys) == (0, "18 0")
