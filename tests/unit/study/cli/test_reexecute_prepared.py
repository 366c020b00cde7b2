"""A recording may begin after requests that only prepared the robot, when they are in it."""

import json
from pathlib import Path

import pytest

from ground.missions.mission import Circle, Fence
from ground.missions.wire import fence_items_of
from protocol.topics import ANSWERED, COMMANDED, WHEELS
from protocol.wire.enums import MissionType
from protocol.wire.message import Message
from protocol.wire.messages import MissionClearAll, MissionCount, ParamSet
from robot.storage.files import Store
from runtime.errors import UserError
from study.cli.reexecute import main
from tests.support.study.recorded_drive import Drive

AROUND = Circle(x_m=2.0, y_m=1.5, radius_m=4.0)
ELSEWHERE = Circle(x_m=50.0, y_m=50.0, radius_m=1.0)


def upload(fence: Fence) -> list[Message]:
    items = fence_items_of(fence)
    return [MissionCount(count=len(items), mission_type=MissionType.FENCE), *items]


def late(drive: Drive, *, hears: bool = True) -> Drive:
    """Recorded from the third tick on, with the events that its recorder still gets."""
    begin = drive.on(WHEELS)[2]
    places = sorted([*drive.on(COMMANDED), *drive.on(ANSWERED)])
    events = [drive.said[place] for place in places if place < begin]
    drive.said = [*(events if hears else []), *drive.said[begin:]]
    return drive


def verdict(drive: Drive, path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    code = main([str(drive.written(path / "a.mcap")), "--json"])
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    return code, f"{told['compared']} {told['differing']}"


def test_a_robot_that_had_its_fence_again_is_executed_again_with_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Drive().run(ticks=2, store=Store(tmp_path), asked=upload(AROUND))
    drive = Drive().run(ticks=40, store=Store(tmp_path))
    assert len(drive.on(COMMANDED)) == 4, "its fence, armed, its goal"
    assert verdict(drive, tmp_path, capsys) == (0, "40 0")
    assert verdict(late(drive), tmp_path, capsys) == (0, "38 0")


@pytest.mark.parametrize("asked", [[], [MissionClearAll(mission_type=MissionType.FENCE)]])
def test_robot_that_lost_its_fence_is_executed_again_without_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: list[Message]
) -> None:
    """Arming is refused until the fence is taken down."""
    (tmp_path / "fence.json").write_text("{")
    drive = Drive().run(ticks=40, store=Store(tmp_path), asked=asked)
    assert verdict(drive, tmp_path, capsys) == (0, "40 0")


def test_a_fence_and_a_parameter_set_before_it_begins_are_in_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = ParamSet(param_id="v_max_m_s", param_value=0.1, param_type=9)
    drive = Drive().run(ticks=60, asked=[*upload(AROUND), slow])
    assert verdict(late(drive), tmp_path, capsys) == (0, "58 0")


def test_a_fence_that_was_refused_is_not_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A robot that has sensed nothing yet would have taken it."""
    drive = Drive().run(ticks=60, asked=upload(ELSEWHERE))
    assert verdict(late(drive), tmp_path, capsys) == (0, "58 0")


def test_without_these_requests_in_it_it_is_refused(tmp_path: Path) -> None:
    drive = late(Drive().run(ticks=20, asked=upload(AROUND)), hears=False)
    with pytest.raises(UserError, match="begins after 2 requests"):
        main([str(drive.written(tmp_path / "a.mcap"))])
