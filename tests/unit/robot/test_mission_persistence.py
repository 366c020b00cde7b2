"""After a restart the robot has its fence and its mission, whatever the files contain."""

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.wire.enums import Command, GoalState, MissionState, MissionType, Severity, Vehicle
from protocol.wire.message import check
from protocol.wire.messages import MissionClearAll, MissionItemInt, MissionVerdict
from protocol.wire.reasons import Reason
from robot import telemetry
from robot.core.values import Pose
from robot.storage import Store
from tests.support.robots import Desk, circle, corners, line, start, state, until, upload

CLEAR = Command.SIDESTEP_CLEAR_EMERGENCY_STOP
NEAR = corners((-1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (-1.0, 1.0))


def restarted(folder: Path, at: Pose | None = None) -> Desk:
    desk = Desk(Store(folder))
    if at is not None:
        desk.vehicle.state.odometry.pose = at
    desk.vehicle.restore()
    return desk


def kept(folder: Path, *uploads: list[MissionItemInt]) -> None:
    """Upload these to a robot, which then ends."""
    desk = restarted(folder)
    desk.arm()
    for items in uploads:
        assert upload(desk, items).reason == Reason.NONE


def announced(desk: Desk) -> list[tuple[int, str]]:
    """Return the announced texts, each with its pieces joined."""
    lines: list[tuple[int, str]] = []
    for text in desk.vehicle.texts():
        if text.chunk_seq:
            lines[-1] = (lines[-1][0], lines[-1][1] + text.text)
        else:
            lines.append((text.severity, text.text))
    return lines


def clear(desk: Desk, kind: int) -> int:
    answer = desk.vehicle.receive(MissionClearAll(mission_type=kind), desk.now_ns)
    assert isinstance(answer, MissionVerdict)
    return answer.reason


@pytest.mark.parametrize("fence", [NEAR, circle(0.5, 0.0, 1.5)], ids=["polygon", "circle"])
def test_restarted_robot_restores_its_fence_with_a_text(
    tmp_path: Path, fence: list[MissionItemInt]
) -> None:
    kept(tmp_path / "state", fence)
    desk = restarted(tmp_path / "state")
    assert (Severity.INFO, "fence restored") in announced(desk)
    assert desk.vehicle.restored == ("fence restored",)
    desk.arm()
    assert desk.goto(3.0, 0.0) == Reason.OUTSIDE_FENCE
    assert desk.goto(1.5, 0.0) == Reason.NONE


def test_restored_mission_starts_only_on_command(tmp_path: Path) -> None:
    kept(tmp_path, line(3))
    desk = restarted(tmp_path)
    assert state(desk) == (MissionState.READY, 0)
    assert (Severity.INFO, "mission restored, 3 items, not started") in announced(desk)
    desk.arm()
    for _ in range(40):
        assert (desk.step().left_mrad_s, desk.step().right_mrad_s) == (0, 0)
    assert desk.vehicle.state.machine.goal_state == GoalState.NONE
    assert start(desk) == Reason.NONE
    until(desk, MissionState.DONE)


def test_interrupted_mission_does_not_resume_by_itself(tmp_path: Path) -> None:
    before = restarted(tmp_path)
    before.arm()
    upload(before, line(3))
    start(before)
    until(before, MissionState.RUNNING)
    before.step()
    desk = restarted(tmp_path)
    desk.arm()
    desk.step()
    assert state(desk) == (MissionState.READY, 0)


def test_cleared_items_are_not_restored(tmp_path: Path) -> None:
    kept(tmp_path, NEAR, line(2))
    desk = restarted(tmp_path)
    assert clear(desk, MissionType.FENCE) == clear(desk, MissionType.MISSION) == Reason.NONE
    assert list(tmp_path.iterdir()) == []
    again = restarted(tmp_path)
    assert again.vehicle.state.machine.fence is None
    assert state(again) == (MissionState.NONE, 0)
    assert again.vehicle.restored == ()


def test_without_a_directory_nothing_is_kept() -> None:
    desk = Desk()
    assert desk.vehicle.restore() == []
    desk.arm()
    assert upload(desk, NEAR).reason == Reason.NONE
    assert clear(desk, MissionType.FENCE) == Reason.NONE


def item_text(**changes: object) -> str:
    row = {name: getattr(NEAR[0], name) for name in MissionItemInt.__struct_fields__}
    return json.dumps([row | changes])


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[", "null", "[]", "5", "[1]", '["seq"]', "\x00", "[" * 100_000),
        pytest.param('[{"seq": 0, "x": 1}]', id="of an older version"),
        pytest.param(item_text(radius=3.0), id="of a newer version"),
        pytest.param(item_text(x="1"), id="text for a number"),
        pytest.param(item_text(x=2**40), id="too large for the wire"),
        pytest.param(item_text(mission_type=0), id="of another kind"),
        pytest.param(item_text(seq=7), id="out of order"),
        pytest.param(item_text(param1=3), id="three corners, one there"),
        pytest.param(json.dumps(json.loads(item_text()) * 2), id="a corner twice"),
    ],
)
def test_unreadable_fence_forbids_arming_and_is_announced(tmp_path: Path, text: str) -> None:
    (tmp_path / "fence.json").write_text(text)
    desk = restarted(tmp_path)
    (words,) = desk.vehicle.restored
    assert words.startswith(LOST)
    assert len(words) > len(LOST)
    assert (Severity.ERROR, words.encode("ascii", "replace").decode()) in announced(desk)
    assert desk.arm() == Reason.FENCE_UNREADABLE
    assert shown(desk) == (Vehicle.STANDBY, Reason.FENCE_UNREADABLE)
    assert desk.goto(3.0, 0.0) == Reason.NOT_ARMED
    assert (tmp_path / "fence.json").read_text() == text, "the file is kept for analysis"


LOST = "saved fence LOST: arming is refused until `fence off` or a new fence: "


def shown(desk: Desk) -> tuple[int, int]:
    status = telemetry.status(desk.vehicle.state, 0, 0, 0)
    return status.vehicle, status.vehicle_reason


def test_clearing_an_unreadable_fence_permits_arming(tmp_path: Path) -> None:
    (tmp_path / "fence.json").write_text("{")
    desk = restarted(tmp_path)
    assert clear(desk, MissionType.FENCE) == Reason.NONE
    assert not (tmp_path / "fence.json").exists()
    desk.step()
    assert shown(desk) == (Vehicle.STANDBY, Reason.NONE)
    assert desk.arm() == Reason.NONE
    assert restarted(tmp_path).vehicle.restored == ()


def test_replacing_an_unreadable_fence_permits_arming(tmp_path: Path) -> None:
    (tmp_path / "fence.json").write_text("{")
    desk = restarted(tmp_path)
    desk.step()
    assert upload(desk, circle(9.0, 0.0, 1.0)).reason == Reason.FENCE_LEAVES_ROBOT_OUT
    assert desk.arm() == Reason.FENCE_UNREADABLE, "a fence that was refused is none"
    assert upload(desk, NEAR).reason == Reason.NONE
    assert desk.arm() == Reason.NONE
    assert desk.goto(3.0, 0.0) == Reason.OUTSIDE_FENCE


@pytest.mark.parametrize("command", [Command.COMPONENT_ARM_DISARM, CLEAR])
def test_unreadable_fence_outlasts_stops_and_disarming(tmp_path: Path, command: Command) -> None:
    (tmp_path / "fence.json").write_text("{")
    desk = restarted(tmp_path)
    desk.step()
    if command == CLEAR:
        desk.command(Command.DO_FLIGHTTERMINATION)
        assert shown(desk) == (Vehicle.EMERGENCY_STOP, Reason.BY_OPERATOR)
    assert desk.command(command, 0) in (Reason.NONE, Reason.NOTHING_CHANGED)
    assert shown(desk) == (Vehicle.STANDBY, Reason.FENCE_UNREADABLE)
    assert desk.arm() == Reason.FENCE_UNREADABLE


def test_unreadable_mission_does_not_forbid_arming(tmp_path: Path) -> None:
    (tmp_path / "mission.json").write_text("{")
    desk = restarted(tmp_path)
    assert desk.vehicle.restored[0].startswith("saved mission NOT restored: ")
    assert desk.arm() == Reason.NONE


def test_file_with_invalid_text_is_named(tmp_path: Path) -> None:
    (tmp_path / "mission.json").write_bytes(b"\xff\xfe")
    (words,) = restarted(tmp_path).vehicle.restored
    assert str(tmp_path / "mission.json") in words
    assert "utf-8" in words


def test_a_folder_in_the_place_of_the_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "fence.json").mkdir()
    (words,) = restarted(tmp_path).vehicle.restored
    assert "fence.json" in words


def test_very_long_warning_can_be_sent(tmp_path: Path) -> None:
    (tmp_path / "fence.json").write_text(item_text(x="y" * 100_000))
    desk = restarted(tmp_path)
    desk.vehicle.announce(Severity.WARNING, "z" * 100_000)
    for text in desk.vehicle.texts():
        check(text)


def test_mission_outside_the_fence_is_not_restored(
    tmp_path: Path,
) -> None:
    kept(tmp_path, line(12))
    narrow = Desk(Store(tmp_path))
    narrow.arm()
    assert upload(narrow, NEAR).reason == Reason.NONE
    desk = restarted(tmp_path)
    assert "saved mission NOT restored: item 7: goal is outside of the fence" in (
        desk.vehicle.restored
    )
    assert state(desk) == (MissionState.NONE, 0)


def test_start_outside_the_restored_fence_forbids_arming(
    tmp_path: Path,
) -> None:
    kept(tmp_path, NEAR)
    desk = restarted(tmp_path, at=Pose(5.0, 0.0, 0.0))
    assert desk.vehicle.restored == ("fence restored, robot OUTSIDE of it: lift it to arm",)
    assert desk.arm() == Reason.FENCE_BREACHED
    assert clear(desk, MissionType.FENCE) == Reason.NONE
    assert desk.arm() == Reason.NONE


def test_with_sensor_data_a_fence_must_contain_the_robot(tmp_path: Path) -> None:
    desk = restarted(tmp_path, at=Pose(5.0, 0.0, 0.0))
    desk.step()
    assert upload(desk, NEAR).reason == Reason.FENCE_LEAVES_ROBOT_OUT
    assert list(tmp_path.iterdir()) == []


def test_fence_that_cannot_be_saved_is_in_force_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    desk = restarted(tmp_path)
    desk.arm()
    announced(desk)
    assert upload(desk, NEAR).reason == Reason.NOT_SAVED
    assert desk.goto(3.0, 0.0) == Reason.OUTSIDE_FENCE
    assert (Severity.ERROR, "fence not saved: No space left on device") in announced(desk)


def test_what_is_kept_already_is_not_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept(tmp_path, circle(0.5, 0.0, 1.5), line(2))

    def written(*_: object) -> None:
        raise AssertionError("written once more")

    monkeypatch.setattr("robot.file_writer.do", written)
    desk = restarted(tmp_path)
    desk.arm()
    assert upload(desk, circle(0.5, 0.0, 1.5)).reason == Reason.NONE
    assert len(desk.vehicle.restored) == 2


def test_replayed_requests_restore_another_robot(tmp_path: Path) -> None:
    """Recordings that contain them can therefore be re-executed."""
    kept(tmp_path, NEAR, line(3))
    desk = Desk(Store(tmp_path))
    exchange = desk.vehicle.restore()
    other = Desk()
    assert [repr(other.vehicle.receive(request, 0)) for request, _ in exchange] == [
        repr(answer) for _, answer in exchange
    ]
    assert other.vehicle.state.machine.fence == desk.vehicle.state.machine.fence is not None
    assert repr(other.vehicle.mission.items) == repr(desk.vehicle.mission.items)
    assert other.command(Command.MISSION_START) == Reason.NOT_ARMED


scalars = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20))
anything = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner), st.dictionaries(st.text(max_size=9), inner)),
    max_leaves=20,
)
GOOD = [*corners((-1.0, -1.0), (2.0, -1.0), (2.0, 1.0)), *line(2)]
names = st.sampled_from(MissionItemInt.__struct_fields__)
spoilt = st.tuples(st.sampled_from(GOOD), st.dictionaries(names, scalars, max_size=2)).map(
    lambda pair: (
        {name: getattr(pair[0], name) for name in MissionItemInt.__struct_fields__} | pair[1]
    )
)


def starts(fence: str, mission: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "fence.json").write_text(fence, encoding="utf-8", errors="surrogatepass")
        (Path(folder) / "mission.json").write_text(mission, encoding="utf-8")
        desk = Desk(Store(Path(folder)))
        desk.vehicle.restore()
        assert len(desk.vehicle.restored) == 2, "each is announced, restored or not"
        for text in desk.vehicle.texts():
            check(text)
        desk.step()
        desk.step()


@settings(deadline=None, max_examples=60)
@given(st.text(max_size=200), anything.map(json.dumps))
def test_any_text_and_any_json_is_survived(fence: str, mission: str) -> None:
    starts(fence, mission)


@settings(deadline=None, max_examples=150)
@given(st.lists(spoilt, max_size=5), st.lists(spoilt, max_size=5))
def test_items_with_any_values_in_them_are_survived(
    fence: list[dict[str, object]], mission: list[dict[str, object]]
) -> None:
    starts(json.dumps(fence), json.dumps(mission))
