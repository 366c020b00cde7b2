"""The map shows mission and fence of the robot, whichever operator uploaded them."""

from collections.abc import Sequence
from math import pi

import pytest

from ground.map.scene import Disc, Outline
from ground.missions.mission import Circle, Fence, Polygon, Waypoint
from ground.missions.transfer import fence_items_of, items_of
from ground.station.robot.mission_items import MissionItems, downloaded
from protocol.topics import ANSWERED, COMMANDED, MISSION, MISSION_SERVICE
from protocol.wire.enums import MissionType
from protocol.wire.message import Message
from protocol.wire.messages import (
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionStatus,
    MissionVerdict,
)
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import RemoteError
from tests.support.ground.station.play import Play
from tests.support.played_bus import PlayedBus

WAY = (Waypoint(x_m=1.0, y_m=2.0), Waypoint(x_m=3.0, y_m=2.0, heading_deg=90.0))
ROUND = Circle(x_m=1.0, y_m=1.0, radius_m=2.5)
CORNERS = Polygon(corners=((0.0, 0.0), (5.0, 0.0), (5.0, 4.0)))


class RobotItems:
    """The robot's side of a download."""

    def __init__(self, mission: Sequence[Waypoint] = (), fence: Fence | None = None) -> None:
        fences = [] if fence is None else fence_items_of(fence)
        self._items = {MissionType.MISSION: items_of(mission), MissionType.FENCE: fences}

    def __call__(self, request: Message | None) -> Message:
        if isinstance(request, MissionRequestList):
            kind = MissionType(request.mission_type)
            return MissionCount(count=len(self._items[kind]), mission_type=kind)
        assert isinstance(request, MissionRequestInt)
        return self._items[MissionType(request.mission_type)][request.seq]


def verdict(kind: MissionType, reason: Reason = Reason.NONE) -> MissionVerdict:
    return MissionVerdict(mission_id=1, item=65_535, reason=reason, mission_type=kind)


def test_mission_and_fence_are_read_at_the_start() -> None:
    play = Play()
    play.bus.answers[MISSION_SERVICE.path] = RobotItems(WAY, ROUND)
    play.forward(1.0)
    scene = play.station.scene()
    assert [(item.x_m, item.heading_rad) for item in scene.mission] == [(1.0, None), (3.0, pi / 2)]
    assert scene.fence == Disc(1.0, 1.0, 2.5)
    assert play.station.mission_items == scene.mission


def test_mission_and_fence_are_read_again() -> None:
    play = Play()
    play.bus.answers[MISSION_SERVICE.path] = RobotItems(WAY, ROUND)
    play.forward(1.0)
    play.bus.answers[MISSION_SERVICE.path] = RobotItems()
    play.station.reread()
    play.forward(1.0)
    assert play.station.mission_items == ()
    assert play.station.scene().fence is None


def test_accepted_upload_of_any_operator_is_drawn() -> None:
    play = Play().forward(1.0)
    play.bus.say(COMMANDED, MissionCount(count=2, mission_type=MissionType.MISSION))
    for item in items_of(WAY):
        play.bus.say(COMMANDED, item)
    play.forward(0.1)
    assert play.station.mission_items == ()
    play.bus.say(ANSWERED, verdict(MissionType.MISSION))
    running = MissionStatus(
        time_ns=0, mission_id=1, hold_left_ms=0, count=2, current=1, state=2, reason=0
    )
    play.station.poll()
    play.bus.say(MISSION, running)
    scene = play.station.scene()
    assert len(scene.mission) == 2
    assert scene.current == 1


def test_rejected_upload_changes_nothing() -> None:
    mission_items = MissionItems()
    mission_items.receive(MissionCount(count=1, mission_type=MissionType.FENCE))
    for item in fence_items_of(ROUND):
        mission_items.receive(item)
    mission_items.receive(verdict(MissionType.FENCE, Reason.FENCE_LEAVES_ROBOT_OUT))
    assert mission_items.fence is None


def test_unsaved_fence_is_in_force_and_shown() -> None:
    mission_items = MissionItems()
    for item in fence_items_of(CORNERS):
        mission_items.receive(item)
    mission_items.receive(verdict(MissionType.FENCE, Reason.NOT_SAVED))
    assert mission_items.fence == Outline(CORNERS.corners)


def test_polygon_fence_is_shown_and_can_be_cleared() -> None:
    mission_items = MissionItems()
    for item in fence_items_of(CORNERS):
        mission_items.receive(item)
    mission_items.receive(verdict(MissionType.FENCE))
    assert mission_items.fence == Outline(CORNERS.corners)
    mission_items.receive(MissionClearAll(mission_type=MissionType.FENCE))
    mission_items.receive(verdict(MissionType.FENCE))
    assert mission_items.fence is None


def test_verdict_without_an_upload_is_ignored() -> None:
    mission_items = MissionItems()
    mission_items.receive(verdict(MissionType.MISSION))
    mission_items.receive(None)
    assert mission_items.mission == ()


def test_foreign_mission_items_are_not_drawn() -> None:
    mission_items = MissionItems()
    mission_items.receive(MissionItemInt(
        seq=0, frame=0, command=16, param1=0.0, param2=0.0, param3=0.0, param4=0.0, x=0, y=0,
        z=0.0, mission_type=0,
    ))  # fmt: skip
    mission_items.receive(verdict(MissionType.MISSION))
    assert mission_items.mission == ()


def test_download_stops_at_the_first_failure() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    with pytest.raises(RemoteError, match="no process serves it"):
        downloaded(bus, clock, "r1", MissionType.MISSION)
    assert len(bus.asked) == 1
    bus.answers[MISSION_SERVICE.path] = lambda _: verdict(MissionType.MISSION, Reason.NO_MISSION)
    with pytest.raises(RemoteError, match="did not send its mission"):
        downloaded(bus, clock, "r1", MissionType.MISSION)
