"""A recording may begin after requests that only prepared the robot, if it contains them."""

import json
from pathlib import Path

import pytest

from ground.missions.mission import Circle, Fence
from ground.missions.transfer import fence_items_of
from protocol.topics import ANSWERED, COMMANDED, WHEELS
from protocol.wire.enums import MissionType
from protocol.wire.message import Message
from protocol.wire.messages import MissionClearAll, MissionCount, ParamSet
from robot.emergency_stop import emergency_stop
from robot.storage import Store
from runtime.errors import UserError
from study.cli.reexecute import main
from tests.support.study.recorded_drive import ScriptedDrive

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
