"""Saved state: read whole or not at all, of one robot, with the ending of the previous run."""

import json
import os
from pathlib import Path
from tempfile import mkdtemp

import pytest

from protocol.wire.enums import PARAM_TYPE_REAL32, Severity
from protocol.wire.messages import CommandAck, ParamSet
from protocol.wire.reasons import Reason
from robot import run
from robot.core.parameters import DEFAULTS
from robot.emergency_stop import emergency_stop
from robot.file_writer import MAX_BYTES, Directory, sealed, text_in, unsealed
from robot.mission import text_of
from robot.process import summary_of
from robot.run import report_previous_run
from robot.storage import (
    FILE_NAME,
    HUNG_BEFORE,
    HUNG_NAME,
    NO_REPORT,
    OWNER_NAME,
    RUN_FILE_NAME,
    RUNNING,
    PreviousRun,
    Store,
    own,
)
from robot.vehicle import RobotVehicle
from runtime.errors import UserError
from runtime.watchdog import Watchdog
from tests.support.each import each
from tests.support.robots import Desk, HeldWriter, circle, upload


def test_what_was_saved_is_in_force_after_a_restart(tmp_path: Path) -> None:
    Store(tmp_path / "state").save("d_obs_m", 0.45)
    params, warnings = Store(tmp_path / "state").load(DEFAULTS)
    assert params.d_obs_m == 0.45
    assert warnings == []


def test_saving_a_second_value_keeps_the_first(tmp_path: Path) -> None:
    Store(tmp_path).save("d_obs_m", 0.45)
    store = Store(tmp_path)
    store.load(DEFAULTS)
    store.save("side", -1)
    params, _ = Store(tmp_path).load(DEFAULTS)
    assert (params.d_obs_m, params.side) == (0.45, -1)


def test_without_a_directory_nothing_is_kept() -> None:
    store = Store(None)
    store.save("d_obs_m", 0.45)
    assert store.load(DEFAULTS) == (DEFAULTS, [])


@each("text", ["", "{", "[1, 2]", "null", '"x"', "\x00"])
def test_broken_file_leaves_the_defaults_with_a_warning(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE_NAME).write_text(text)
    params, warnings = Store(tmp_path).load(DEFAULTS)
    assert params == DEFAULTS
    assert len(warnings) == 1
    assert FILE_NAME in warnings[0]


def test_a_bad_value_is_left_out_by_name_and_the_rest_is_used(tmp_path: Path) -> None:
    text = '{"d_obs_m": 99, "nonsense": 1, "side": "left", "v_max_m_s": 0.2}'
    (tmp_path / FILE_NAME).write_text(text)
    params, warnings = Store(tmp_path).load(DEFAULTS)
    assert params.v_max_m_s == 0.2
    assert params.d_obs_m == DEFAULTS.d_obs_m
    assert [name for name in ("d_obs_m", "nonsense", "side") if name in " ".join(warnings)] == [
        "d_obs_m",
        "nonsense",
        "side",
    ]


def written(folder: Path, text: str) -> Store:
    (folder / FILE_NAME).write_text(text)
    return Store(folder)


@pytest.mark.parametrize(
    ("text", "lost"),
    [
        ("{", "parameters.json"),
        ('{"crc32": "00000000", "saved": {"side": 1}}', "checksum"),
        ('{"guard_stop_m": 99}', "guard_stop_m"),
        ('{"op_lost_ms": "soon", "side": 1}', "op_lost_ms"),
        ('{"v_max_m_s": null}', "v_max_m_s"),
    ],
)
def test_damaged_safety_parameters_forbid_arming_until_one_is_set(
    tmp_path: Path, text: str, lost: str
) -> None:
    store = written(tmp_path, text)
    _, warnings = store.load(DEFAULTS, DEFAULTS)
    (warning,) = warnings
    assert lost in warning
    assert "arming is refused until a safety parameter is set" in warning
    desk = Desk(store)
    assert desk.arm() == Reason.PARAMETERS_DAMAGED
    assert set_to(desk, "side", DEFAULTS.side) == Reason.NONE
    assert desk.arm() == Reason.PARAMETERS_DAMAGED, "it does not concern safety"
    assert set_to(desk, "guard_stop_m", DEFAULTS.guard_stop_m) == Reason.NONE
    assert desk.arm() == Reason.NONE
    again = Store(tmp_path)
    assert again.load(DEFAULTS, DEFAULTS)[1] == []
    assert not again.damaged


def set_to(desk: Desk, name: str, value: float) -> int:
    answer = desk.vehicle.receive(
        ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32), desk.now_ns
    )
    return answer.result_param2 if isinstance(answer, CommandAck) else Reason.NONE


@pytest.mark.parametrize(
    "text",
    ['{"d_obs_m": 99}', '{"nonsense": 1}', '{"side": "left"}', '{"op_lost_ms": 60000}', "{}"],
)
def test_what_does_not_concern_safety_may_be_lost(tmp_path: Path, text: str) -> None:
    """A value that is less safe than the configuration is lost on purpose."""
    store = written(tmp_path, text)
    store.load(DEFAULTS, DEFAULTS)
    assert Desk(store).arm() == Reason.NONE


def test_stop_is_the_first_reason_not_to_arm(tmp_path: Path) -> None:
    store = written(tmp_path, "{")
    store.load(DEFAULTS, DEFAULTS)
    desk = Desk(store)
    desk.vehicle.receive(emergency_stop(7), 0)
    assert desk.arm() == Reason.EMERGENCY_STOPPED


def test_a_crash_while_saving_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(tmp_path)
    store.save("d_obs_m", 0.45)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    ticket = store.save("d_obs_m", 0.60)
    assert ticket is not None
    assert "No space" in str(ticket.error)
    params, _ = Store(tmp_path).load(DEFAULTS)
    assert params.d_obs_m == 0.45


def test_only_written_values_are_held(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert not store.holds("d_obs_m", 0.45)
    store.save("d_obs_m", 0.45)
    assert store.holds("d_obs_m", 0.45)
    assert not store.holds("d_obs_m", 0.5)
    again = Store(tmp_path)
    again.load(DEFAULTS)
    assert again.holds("d_obs_m", 0.45)


def test_without_a_directory_no_value_is_held() -> None:
    store = Store(None)
    store.save("d_obs_m", 0.45)
    assert not store.holds("d_obs_m", 0.45)


def test_value_that_could_not_be_written_is_not_held(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = Store(tmp_path / "file")
    ticket = store.save("d_obs_m", 0.45)
    assert ticket is not None
    assert "file" in str(ticket.error)
    assert not store.holds("d_obs_m", 0.45)


def started(folder: Path) -> Desk:
    desk = Desk(Store(folder))
    desk.vehicle.restore()
    return desk


def test_no_flipped_bit_moves_the_fence(tmp_path: Path) -> None:
    assert upload(started(tmp_path), circle(0.0, 0.0, 3.0)).reason == Reason.NONE
    file = tmp_path / "fence.json"
    whole = file.read_bytes()
    right = started(tmp_path).vehicle.state.machine.fence
    refused = 0
    for bit in range(8 * len(whole)):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        desk = started(tmp_path)
        if desk.vehicle.state.machine.fence_unreadable:
            refused += 1
        else:
            assert desk.vehicle.state.machine.fence == right, bytes(flipped)
    file.write_bytes(whole.replace(b"3.0", b"9.0"))
    assert started(tmp_path).arm() == Reason.FENCE_UNREADABLE
    assert refused > 0.9 * 8 * len(whole)


def test_no_flipped_bit_changes_a_parameter(tmp_path: Path) -> None:
    desk = started(tmp_path)
    for name, value in (("d_obs_m", 0.45), ("max_speed_mps", 0.2)):
        desk.vehicle.receive(ParamSet(param_id=name, param_value=value, param_type=9), 0)
    file = tmp_path / "parameters.json"
    whole = file.read_bytes()
    right, _ = Store(tmp_path).load(DEFAULTS)
    assert right != DEFAULTS
    for bit in range(8 * len(whole)):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        params, warnings = Store(tmp_path).load(DEFAULTS)
        assert params == (DEFAULTS if warnings else right), bytes(flipped)


def test_files_of_earlier_versions_are_read(tmp_path: Path) -> None:
    (tmp_path / "fence.json").write_text(text_of(tuple(circle(0.0, 0.0, 3.0))))
    (tmp_path / "parameters.json").write_text(json.dumps({"d_obs_m": 0.45}))
    assert started(tmp_path).vehicle.state.machine.fence is not None
    params, warnings = Store(tmp_path).load(DEFAULTS)
    assert (params.d_obs_m, warnings) == (0.45, [])


@each("name", ["fence.json", "mission.json", "parameters.json", "life.txt", "robot.txt"])
@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_what_is_no_file_holds_up_no_start(kind: str, name: str, tmp_path: Path) -> None:
    folder = Path(mkdtemp(dir=tmp_path))
    if kind == "pipe":
        os.mkfifo(folder / name)
    elif kind == "device":
        os.symlink("/dev/zero", folder / name)
    else:
        (folder / name).write_bytes(b" " * (MAX_BYTES + 1))
    why = "larger than" if kind == "large" else "not a regular file"
    if name == "robot.txt":
        with pytest.raises(UserError, match=f"{name}: owner of the directory .* {why}"):
            own(folder, "r1")
        return
    _, warnings = Store(folder).load(DEFAULTS)
    desk = started(folder)
    told = "".join([*warnings, *desk.vehicle.restored])
    if name != "life.txt":
        assert str(folder / name) in told
        assert why in told
    assert (desk.arm() == Reason.NONE) == (name != "fence.json")


@each("text", ["[]", "{}", '{"a": [1, NaN, 1e300, "x"]}', "12345678901234567890"])
def test_sealed_value_is_the_value(text: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text(sealed(text))
    assert repr(unsealed(text_in(tmp_path / "file"))) == repr(unsealed(text))


def test_first_robot_makes_the_directory_its_own(tmp_path: Path) -> None:
    state = tmp_path / "new" / "state"
    assert own(state, "r1") == ""
    assert (state / OWNER_NAME).read_text() == "r1"
    assert own(state, "r1") == "", "it comes back to it"


def test_another_robot_is_refused_and_changes_nothing(tmp_path: Path) -> None:
    own(tmp_path, "r1")
    with pytest.raises(UserError, match="belongs to robot 'r1'; give robot r2 a directory"):
        own(tmp_path, "r2")
    assert (tmp_path / OWNER_NAME).read_text() == "r1"


def test_robot_process_does_not_start_on_the_state_of_another(tmp_path: Path) -> None:
    """Driving with the other robot's fence, or without one, must be impossible."""
    own(tmp_path, "r2")
    (tmp_path / "fence.json").write_text("[]")
    with pytest.raises(UserError, match="belongs to robot 'r2'"):
        run.main(["--id", "r1", "--state", str(tmp_path)])
    with pytest.raises(UserError, match="belongs to robot 'r2'"):
        run.main(["--id", "r1", "--stops", str(tmp_path)])


@pytest.mark.parametrize("content", [b"", b"\xff", b"r1\x1b]0;OWNED\x07"])
def test_state_with_an_unreadable_owner_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / OWNER_NAME).write_bytes(content)
    with pytest.raises(UserError) as refused:
        own(tmp_path, "r1")
    assert str(refused.value).isprintable()


def test_full_disk_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert own(tmp_path / "state", "r1").endswith(
        "robot.txt: not written (No space left on device)"
    )


def test_without_a_directory_no_owner_is_noted() -> None:
    assert own(None, "r1") == ""


KILLED = "was killed (signal SIGKILL)"


def test_first_run_has_no_previous_one(tmp_path: Path) -> None:
    directory = Directory(tmp_path / "new" / "state")
    assert PreviousRun(directory).begin() == ""
    assert [file.error for file in directory.collect()] == [None]


def test_normal_stop_is_not_reported(tmp_path: Path) -> None:
    first = PreviousRun(Directory(tmp_path))
    first.begin()
    first.end()
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_normal_stop_of_an_earlier_version_is_not_reported(tmp_path: Path) -> None:
    (tmp_path / RUN_FILE_NAME).write_text("was told to stop\n")
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_killed_run_ends_without_a_report(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    assert PreviousRun(Directory(tmp_path)).begin() == NO_REPORT == "ended without a report"


def test_observation_of_the_launcher_replaces_a_missing_mark(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    assert PreviousRun(Directory(tmp_path)).begin("signal SIGKILL") == KILLED


def test_own_mark_has_priority_over_the_launcher(tmp_path: Path) -> None:
    first, last = (
        PreviousRun(Directory(tmp_path)),
        "ended by a core exception (ZeroDivisionError: x)",
    )
    first.begin()
    first.end(last)
    assert PreviousRun(Directory(tmp_path)).begin("ended by itself (exit code 1)") == last


def test_mark_is_reported_to_the_next_run_only(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    second = PreviousRun(Directory(tmp_path))
    second.begin()
    second.end()
    assert PreviousRun(Directory(tmp_path)).begin() == ""


@each("after", ["signal SIGKILL", KILLED])
def test_without_a_directory_the_launcher_counts(after: str) -> None:
    life = PreviousRun(Directory(None))
    assert life.begin(after) == KILLED
    life.end()
    assert (life.trace, PreviousRun(Directory(None)).begin()) == (None, "")


def test_stack_traces_of_a_hung_run_are_kept(tmp_path: Path) -> None:
    PreviousRun(Directory(tmp_path)).begin()
    (tmp_path / HUNG_NAME).write_text("Current thread ...")
    assert PreviousRun(Directory(tmp_path)).begin() == "hung (its loop did not run for 5 s)"
    assert (tmp_path / HUNG_BEFORE).read_text() == "Current thread ..."
    assert PreviousRun(Directory(tmp_path)).begin() == NO_REPORT


def test_unwritable_directory_is_reported_and_the_robot_runs(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    store = Store(tmp_path / "file")
    vehicle, life = RobotVehicle(DEFAULTS, store), PreviousRun(store.directory)
    assert life.begin("signal SIGKILL") == KILLED
    assert "life not saved: Not a directory" in [text.text for text in vehicle.texts()]
    with Watchdog(trace=life.trace):
        life.end()


def test_marks_are_written_by_the_writer(tmp_path: Path) -> None:
    writer = HeldWriter()
    life = PreviousRun(Directory(tmp_path, writer))
    life.begin()
    life.end("ended by itself")
    assert [(job.path.name, job.text) for job in writer.waiting] == [(RUN_FILE_NAME, RUNNING)]
    assert not (tmp_path / RUN_FILE_NAME).exists()


def test_the_last_mark_is_written_when_the_robot_ends(tmp_path: Path) -> None:
    store = Store(tmp_path, HeldWriter())
    vehicle, life = RobotVehicle(DEFAULTS, store), PreviousRun(store.directory)
    life.begin()
    life.end("ended by itself")
    vehicle.finish_saving(1.0)
    assert (tmp_path / RUN_FILE_NAME).read_text() == "ended by itself"


def test_invalid_mark_counts_as_none(tmp_path: Path) -> None:
    (tmp_path / RUN_FILE_NAME).write_bytes(b"\xff\xfe\x00")
    assert PreviousRun(Directory(tmp_path)).begin() == ""


def test_ending_is_announced_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = RobotVehicle(DEFAULTS, Store(None))
    report_previous_run(vehicle, "r1", PreviousRun(Directory(None)), "signal SIGKILL")
    texts = vehicle.texts()
    words = f"restarted: the previous run {KILLED}"
    announced = "".join(text.text for text in texts)
    assert words in announced
    assert max(text.severity for text in texts) == Severity.INFO
    assert min(text.severity for text in texts) == Severity.WARNING
    assert capsys.readouterr().err == f"robot r1: {words}\n"


def test_first_run_announces_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = RobotVehicle(DEFAULTS, Store(None))
    report_previous_run(vehicle, "r1", PreviousRun(Directory(None)), "")
    assert [text.text for text in vehicle.texts()] == ["started: disarmed, standing still"]
    assert capsys.readouterr().err == ""


def test_of_a_long_exception_the_first_line_is_kept() -> None:
    assert summary_of(ValueError("one\ntwo")) == "ValueError: one"
