"""Mission and fence are on the map as the robot has them, whoever gave them to it."""

from collections.abc import Sequence
from math import pi

import pytest

from ground.map import Disc, Outline
from ground.missions.mission import Circle, Fence, Polygon, Waypoint
from ground.missions.wire import fence_items_of, items_of
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


class Holds:
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


def test_what_the_robot_has_is_read_at_the_start_and_drawn() -> None:
    play = Play()
    play.bus.answers[MISSION_SERVICE.path] = Holds(WAY, ROUND)
    play.forward(1.0)
    scene = play.station.scene()
    assert [(item.x_m, item.heading_rad) for item in scene.mission] == [(1.0, None), (3.0, pi / 2)]
    assert scene.fence == Disc(1.0, 1.0, 2.5)
    assert play.station.mission_items == scene.mission
    assert play.station.fence == scene.fence


def test_after_a_restart_it_is_read_again() -> None:
    play = Play()
    play.bus.answers[MISSION_SERVICE.path] = Holds(WAY, ROUND)
    play.forward(1.0)
    play.bus.answers[MISSION_SERVICE.path] = Holds()
    play.station.reread()
    play.forward(1.0)
    assert play.station.mission_items == ()
    assert play.station.fence is None


def test_what_anybody_uploads_is_drawn_once_the_robot_accepts_it() -> None:
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


def test_what_the_robot_refuses_changes_nothing() -> None:
    charts = MissionItems()
    charts.hear(MissionCount(count=1, mission_type=MissionType.FENCE))
    for item in fence_items_of(ROUND):
        charts.hear(item)
    charts.hear(verdict(MissionType.FENCE, Reason.FENCE_LEAVES_ROBOT_OUT))
    assert charts.fence is None


def test_a_fence_that_could_not_be_saved_is_up_and_shown() -> None:
    charts = MissionItems()
    for item in fence_items_of(CORNERS):
        charts.hear(item)
    charts.hear(verdict(MissionType.FENCE, Reason.NOT_SAVED))
    assert charts.fence == Outline(CORNERS.corners)


def test_a_fence_of_corners_is_an_outline_and_can_be_taken_away() -> None:
    charts = MissionItems()
    for item in fence_items_of(CORNERS):
        charts.hear(item)
    charts.hear(verdict(MissionType.FENCE))
    assert charts.fence == Outline(CORNERS.corners)
    charts.hear(MissionClearAll(mission_type=MissionType.FENCE))
    charts.hear(verdict(MissionType.FENCE))
    assert charts.fence is None


def test_a_verdict_on_what_was_not_heard_says_nothing() -> None:
    charts = MissionItems()
    charts.hear(verdict(MissionType.MISSION))
    charts.hear(None)
    assert charts.mission == ()


def test_items_that_are_none_of_ours_are_not_drawn() -> None:
    charts = MissionItems()
    charts.hear(MissionItemInt(
        seq=0, frame=0, command=16, param1=0.0, param2=0.0, param3=0.0, param4=0.0, x=0, y=0,
        z=0.0, mission_type=0,
    ))  # fmt: skip
    charts.hear(verdict(MissionType.MISSION))
    assert charts.mission == ()


def test_a_robot_that_tells_none_is_asked_no_further() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    with pytest.raises(RemoteError, match="no process serves it"):
        downloaded(bus, clock, "r1", MissionType.MISSION)
    assert len(bus.asked) == 1
    bus.answers[MISSION_SERVICE.path] = lambda _: verdict(MissionType.MISSION, Reason.NO_MISSION)
    with pytest.raises(RemoteError, match="does not tell its mission"):
        downloaded(bus, clock, "r1", MissionType.MISSION)
