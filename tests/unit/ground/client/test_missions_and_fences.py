"""Missions and fences: uploaded whole, fetched, started, refused with the item that is wrong."""

from pathlib import Path

import msgspec
import pytest

from ground.client.missions import MissionProgress, TransferOutcome
from ground.client.robot_link import UnansweredError
from ground.commands.fence import ClearFence, SetFence, ShowFence
from ground.commands.mission import (
    ClearMission,
    DownloadMission,
    FetchMission,
    JumpTo,
    MissionFetched,
    MissionWritten,
    ShowMissionStatus,
    StartMission,
    UploadMission,
)
from ground.missions.mission import Circle, Mission, Polygon, Waypoint
from ground.missions.transfer import fence_items_of, items_of
from protocol.topics import MISSION
from protocol.wire.enums import Command, MissionState, MissionType
from protocol.wire.message import Message
from protocol.wire.messages import (
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionStatus,
    MissionVerdict,
)
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError, UserError
from tests.support.each import each
from tests.support.ground.client import HELD, STANDBY, Stage, perform

WAYPOINTS = (Waypoint(x_m=1.0, y_m=2.0), Waypoint(x_m=3.0, y_m=4.0, heading_deg=90.0))
CIRCLE = Circle(x_m=0.0, y_m=0.0, radius_m=5.0)
SQUARE = Polygon(corners=((0.0, 0.0), (4.0, 0.0), (4.0, 4.0)))


def verdict(
    reason: Reason = Reason.NONE, kind: MissionType = MissionType.MISSION, item: int = 65_535
) -> MissionVerdict:
    return MissionVerdict(reason=reason, item=item, mission_type=kind, mission_id=7)


def wants(*items: int, kind: MissionType = MissionType.MISSION) -> list[Message]:
    return [MissionRequestInt(seq=item, mission_type=kind) for item in items]


def replies(items: list[MissionItemInt], kind: MissionType) -> list[Message]:
    return [MissionCount(count=len(items), mission_type=kind), *items]


def test_mission_is_given_item_by_item_after_its_fence() -> None:
    fence = MissionType.FENCE
    stage = Stage(*wants(0, kind=fence), verdict(kind=fence), *wants(0, 1), verdict())
    mission = Mission(waypoints=WAYPOINTS, fence=CIRCLE)
    outcome = perform(UploadMission(mission=mission, dropped=("item 3: no",)), stage)
    assert outcome.text == f"ok, the robot has {mission}"
    kinds = [request.mission_type for request in stage.bus.requests]
    assert kinds == [MissionType.FENCE] * 2 + [MissionType.MISSION] * 3
    assert stage.notes.notes == ["left out: item 3: no"]


def test_refused_mission_names_the_item_and_the_lease_holder() -> None:
    stage = Stage(*wants(0), verdict(Reason.MISSION_ITEM_BAD, item=0))
    outcome = perform(UploadMission(mission=Mission(waypoints=WAYPOINTS)), stage)
    assert isinstance(outcome, TransferOutcome)
    assert (outcome.ok, outcome.item, outcome.reason) == (False, 1, Reason.MISSION_ITEM_BAD)
    assert outcome.text.startswith("refused: item 1: ")
    assert outcome.as_json("mission upload", "r1")["item"] == 1
    stage = Stage(verdict(Reason.LEASE_HELD))
    stage.bus.say(*HELD)
    refused = perform(UploadMission(mission=Mission(waypoints=WAYPOINTS)), stage)
    assert "anna (--seize takes it over" in refused.text


def test_refused_fence_ends_the_upload() -> None:
    stage = Stage(verdict(Reason.FENCE_NOT_SIMPLE, MissionType.FENCE))
    mission = Mission(waypoints=WAYPOINTS, fence=SQUARE)
    outcome = perform(UploadMission(mission=mission), stage)
    assert outcome.text.startswith("refused: the fence: ")
    assert len(stage.bus.asked) == 1


def test_mission_that_is_in_force_but_not_saved_is_no_success() -> None:
    stage = Stage(verdict(Reason.NOT_SAVED))
    outcome = perform(UploadMission(mission=Mission(waypoints=WAYPOINTS)), stage)
    assert (outcome.ok, outcome.text.startswith("not saved: ")) == (False, True)


def test_lost_frames_of_a_transfer_are_repeated() -> None:
    stage = Stage(None, *wants(0), None, *wants(1), verdict())
    assert perform(UploadMission(mission=Mission(waypoints=WAYPOINTS)), stage).ok
    with pytest.raises(UnansweredError):
        perform(ClearMission(), Stage(*[None] * 10))


def test_mission_is_fetched_with_its_fence_and_written(tmp_path: Path) -> None:
    items = replies(items_of(WAYPOINTS), MissionType.MISSION)
    fence = replies(fence_items_of(CIRCLE), MissionType.FENCE)
    outcome = perform(FetchMission(), Stage(*items, *fence))
    assert isinstance(outcome, MissionFetched)
    assert outcome.mission == Mission(waypoints=WAYPOINTS, fence=CIRCLE)
    assert outcome.text.splitlines()[1:] == [
        "2  (3, 4) at 90 deg",
        "fence: circle of 5 m around (0, 0)",
    ]
    path = tmp_path / "m.toml"
    written = perform(DownloadMission(file=path), Stage(*items, *fence))
    assert isinstance(written, MissionWritten)
    assert (path.exists(), written.lost) == (True, ())


def test_robot_without_a_mission_is_reported(tmp_path: Path) -> None:
    nothing = [MissionCount(count=0, mission_type=kind) for kind in MissionType]
    for operation in (FetchMission(), DownloadMission(file=tmp_path / "m.toml")):
        outcome = perform(operation, Stage(*nothing))
        assert isinstance(outcome, TransferOutcome)
        assert outcome.reason == Reason.NO_MISSION


def test_wrong_file_type_is_refused_before_any_request() -> None:
    stage = Stage()
    with pytest.raises(UserError, match="ends in"):
        perform(DownloadMission(file=Path("m.txt")), stage)
    assert stage.bus.asked == []


def test_mission_starts_where_it_is_or_at_an_item() -> None:
    for item, param in ((None, -1.0), (2, 1.0)):
        stage = Stage(Reason.NOT_ARMED)
        stage.bus.say(*STANDBY)
        assert perform(StartMission(item=item), stage).ok
        requests = stage.bus.requests
        assert (requests[-1].command, requests[-1].param1) == (Command.MISSION_START, param)
        assert len(requests) == 3


def test_mission_that_may_not_arm_is_refused() -> None:
    stage = Stage(Reason.NOT_ARMED)
    stage.bus.say(*STANDBY)
    assert not perform(StartMission(item=1, arms=False), stage).ok
    assert [one.command for one in stage.bus.requests] == [Command.MISSION_START]


def test_mission_that_is_done_begins_again() -> None:
    stage = Stage()
    stage.bus.say(MISSION, progress(MissionState.DONE))
    perform(StartMission(), stage)
    assert stage.bus.requests[0].param1 == 0.0


def test_jump_counts_items_from_one() -> None:
    stage = Stage()
    assert perform(JumpTo(item=3), stage).ok
    assert stage.bus.requests[0].param1 == 2.0


def progress(state: MissionState) -> MissionStatus:
    return MissionStatus(
        time_ns=1, mission_id=1, hold_left_ms=3200, count=5, current=2, state=state,
        reason=Reason.NONE,
    )  # fmt: skip


def test_progress_of_the_mission_is_one_line() -> None:
    stage = Stage()
    stage.bus.say(MISSION, progress(MissionState.HOLDING))
    outcome = perform(ShowMissionStatus(), stage)
    assert outcome.text == "holding, item 3 of 5, 3.2 s left"
    assert outcome.as_json("", "r1")["current"] == 3
    with pytest.raises(RemoteError, match="publishes no mission status"):
        perform(ShowMissionStatus(), Stage())


@each("fence", [CIRCLE, SQUARE])
def test_fence_is_set_shown_and_taken_away(fence: Circle | Polygon) -> None:
    kind, items = MissionType.FENCE, fence_items_of(fence)
    stage = Stage(*wants(*range(len(items)), kind=kind), verdict(kind=kind))
    assert perform(SetFence(fence=fence), stage).text == f"ok, {fence}"
    shown = perform(ShowFence(), Stage(*replies(items, kind)))
    assert str(fence) in shown.text
    assert shown.as_json("fence show", "r1")["fence"]
    cleared = perform(ClearFence(), Stage(verdict(kind=kind)))
    assert cleared.text == "ok, there is no fence"
    empty = perform(ShowFence(), Stage(MissionCount(count=0, mission_type=kind)))
    assert (empty.text, empty.as_json("fence show", "r1")["fence"]) == ("no fence", None)


def test_failed_mission_and_unknown_state_are_shown() -> None:
    failed = msgspec.structs.replace(progress(MissionState.FAILED), hold_left_ms=0)
    failed = msgspec.structs.replace(failed, reason=Reason.NO_PROGRESS)
    words = "failed, item 3 of 5: has come no closer for too long"
    assert MissionProgress(failed).text == words
    assert MissionProgress(progress(MissionState.NONE)).text == "no mission"
    unknown = msgspec.structs.replace(progress(MissionState.RUNNING), state=77)
    assert MissionProgress(unknown).text.startswith("state 77, item 3 of 5")


@each(
    ("reason", "words"),
    [
        (Reason.BY_OPERATOR, "aborted"),
        (Reason.BY_HAND, "taken over"),
        (Reason.REPLACED, "taken over"),
        (Reason.DISARMED, "aborted"),
        (Reason.BY_EMERGENCY_STOP, "aborted"),
    ],
)
def test_mission_that_an_operator_ends_has_not_failed(reason: Reason, words: str) -> None:
    taken = msgspec.structs.replace(progress(MissionState.FAILED), hold_left_ms=0, reason=reason)
    assert MissionProgress(taken).text.startswith(f"{words}, item 3 of 5: ")
    assert MissionProgress(taken).as_json("", "r1")["state"] == words
