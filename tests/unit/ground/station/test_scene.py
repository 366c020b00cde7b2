"""The scene on the map: the world, live and silent robots, unknown places, missions and fences."""

import json
from collections.abc import Sequence
from math import isnan, pi

import pytest

from checks.harness.loop import PlayedLoop
from checks.harness.messages import make
from ground.client.connection import Common
from ground.map.drawing import NO_PLACE, entries
from ground.map.scene import Disc, Outline
from ground.missions.mission import Circle as MissionCircle
from ground.missions.mission import Fence, Polygon, Waypoint
from ground.missions.transfer import fence_items_of, items_of
from ground.robot import Robot as RobotClient
from ground.station.history.telemetry_history import TelemetryHistory
from ground.station.reader import Reader
from ground.station.robot.mission_items import MissionItems
from ground.station.world import parse_world
from plant.sim.physics import MovingDisc
from plant.world.file import load
from protocol.bus.network import Network
from protocol.outcome import CHI2_2
from protocol.topics import ANSWERED, COMMANDED, MISSION, MISSION_SERVICE, WORLD, Role
from protocol.wire.enums import GoalState, MissionType, Mode, Vehicle
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
from protocol.world import MAX_OBSTACLES, MAX_POINTS, WorldCircle, as_json
from runtime.clock import ManualClock
from runtime.errors import RemoteError
from tests.support.each import each
from tests.support.ground.station import WORLD_TEXT, Play, Robot
from tests.support.hostile import TEXT, raw_in
from tests.support.played_bus import PlayedBus


def test_scene_contains_live_data_only() -> None:
    play = Play()
    play.robot.goal_id, play.robot.goal = 4, GoalState.AVOIDING
    scene = play.forward(1.0).station.scene()
    assert scene.live
    assert scene.robot is not None
    assert scene.robot.radius_m == 0.15
    assert scene.goal is not None
    assert (scene.goal.x_m, scene.goal.heading_rad) == (5.0, None)
    assert scene.zone_m == pytest.approx(0.3)
    assert scene.virtual_goal is None
    assert len(scene.ranges_m) == 8
    assert (len(scene.hits), len(scene.movers)) == (1, 1)
    assert len(scene.seen) >= 4
    assert scene.current is None
    play.hang()
    scene = play.forward(2.0).station.scene()
    assert not scene.live
    assert scene.robot is not None
    assert (scene.goal, scene.zone_m) == (None, None)


def test_ellipse_of_a_silent_robot_grows() -> None:
    play = Play().forward(1.0)
    heard = play.station.scene().covariance
    play.hang()
    play.forward(1.0)
    later = play.station.scene().covariance
    play.forward(9.0)
    last = play.station.scene().covariance
    assert heard is not None
    assert later is not None
    assert last is not None
    assert heard[0] == pytest.approx(0.04)
    assert 0.04 + 0.2**2 / 6 < later[0] < 0.04 + 0.26**2 / 6
    assert last[0] == pytest.approx(0.04 + 0.5**2 / 6, rel=1e-2)
    assert last[2] == pytest.approx(0.01 + 0.5**2 / 6, rel=1e-2)


@each(
    ("limits", "gone_m"),
    [
        ({"op_lost_ms": 3000}, 0.25 * 3.5),
        ({"accel_m_s2": 0.125}, 0.25 * 3.8),
        ({}, 0.25 * 2.0),
    ],
)
def test_ellipse_follows_the_limits_of_the_robot(limits: dict[str, float], gone_m: float) -> None:
    play = Play()
    play.params.update(limits)
    play.forward(1.0)
    play.hang()
    covariance = play.forward(12.0).station.scene().covariance
    assert covariance is not None
    assert covariance[0] == pytest.approx(0.04 + gone_m**2 / CHI2_2, rel=1e-3)


def test_ellipse_of_a_robot_on_its_way_grows_with_its_fastest_speed() -> None:
    play = Play()
    play.params["v_max_m_s"] = 1.0
    play.robot.goal, play.robot.goal_id = GoalState.DRIVING, 4
    play.forward(1.0)
    play.hang()
    covariance = play.forward(12.0).station.scene().covariance
    assert covariance is not None
    assert covariance[0] == pytest.approx(0.04 + (1.8 + 1.0 / 1.25) ** 2 / CHI2_2, rel=1e-3)


def test_ellipse_without_known_limits_does_not_promise_a_stop() -> None:
    play = Play()
    del play.bus.answers["srv/parameters"]
    play.forward(1.0)
    play.hang()
    covariance = play.forward(12.0).station.scene().covariance
    assert covariance is not None
    assert covariance[0] > 0.04 + (0.25 * 11.0) ** 2 / CHI2_2


def test_robot_has_its_own_radius_and_the_true_one_that_of_the_plant() -> None:
    play = Play()
    play.params["radius_m"] = 0.3
    scene = play.forward(1.0).station.scene()
    assert scene.robot is not None
    assert scene.true_robot is not None
    assert (scene.robot.radius_m, scene.true_robot.radius_m) == (0.3, 0.15)


def test_robot_of_unknown_radius_has_no_outline_and_no_echoes() -> None:
    play = Play()
    del play.bus.answers[WORLD.path]
    scene = play.forward(1.0).station.scene()
    assert scene.robot is not None
    assert scene.robot.radius_m is None
    assert not scene.shows_sonars
    assert not scene.seen


def test_ellipse_grows_longer_during_a_mission() -> None:
    play = Play()
    play.robot.mode = Mode.AUTO
    play.forward(1.0)
    play.hang()
    play.forward(10.0)
    covariance = play.station.scene().covariance
    assert covariance is not None
    assert covariance[0] > 0.04 + 2.4**2 / 6


def test_other_robots_are_on_the_map_of_the_selected() -> None:
    play = Play()
    play.robots.append(Robot("r2", x_m=3.0))
    play.bus.come(Role.ROBOT, "r2")
    play.forward(0.5)
    assert play.station.robots() == ["r1", "r2"]
    play.station.select("r2")
    play.forward(1.0)
    assert play.station.robot == "r2"
    assert play.station.scene().robot is not None
    assert [other.name for other in play.station.scene().others] == ["r1"]
    assert play.station.scene().trail[0][0] == 3.0
    play.station.select("r1")
    assert play.station.scene().trail[0][0] == 0.0


def test_other_robots_have_trails_and_are_marked_when_lost() -> None:
    play, other = Play(), Robot("r2", x_m=1.0)
    play.robots.append(other)
    play.bus.come(Role.ROBOT, "r2")
    for _ in range(20):
        other.x_m += 0.1
        play.forward(0.2)
    (mark,) = play.station.scene().others
    assert mark.live
    assert mark.name == "r2"
    assert mark.trail[0][0] == pytest.approx(1.2, abs=0.21)
    assert mark.trail[-1][0] == pytest.approx(2.9, abs=0.21)
    other.loop = False
    play.forward(3.0)
    (mark,) = play.station.scene().others
    assert not mark.live


def test_robot_that_stopped_is_marked_on_the_map() -> None:
    play, other = Play(), Robot("r2", x_m=1.0)
    play.robots.append(other)
    play.bus.come(Role.ROBOT, "r2")
    play.forward(1.0)
    assert [mark.in_need for mark in play.station.scene().others] == [False]
    other.vehicle = Vehicle.EMERGENCY_STOP
    play.forward(1.0)
    assert [mark.in_need for mark in play.station.scene().others] == [True]


@each("count", [2, 40])
def test_many_others_are_updated_less_often_than_a_few(count: int) -> None:
    play, others = Play(), [Robot(f"r{number}") for number in range(2, count + 2)]
    for other in others:
        play.robots.append(other)
        play.bus.come(Role.ROBOT, other.name)
    play.forward(1.0)
    updates, before = 0, play.station.scene().others
    for _ in range(20):
        play.forward(0.05)
        marks = play.station.scene().others
        updates, before = updates + (marks is not before), marks
    assert updates == (20 if count == 2 else 5)
    assert len(before) == count


def test_world_shapes_are_parsed_by_kind() -> None:
    world = parse_world(WORLD_TEXT)
    outer, polygon, wall, pillar = world.obstacles
    assert outer == Outline(((0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)))
    assert polygon == Outline(((2.0, 1.0), (3.0, 1.0), (3.0, 2.0)))
    assert wall == Outline(((0.0, 3.0), (2.0, 3.0)), closed=False)
    assert pillar == Disc(4.0, 3.0, 0.25)
    assert len(world.movers) == 1
    assert world.start == (0.6, 2.0, pi / 2)
    assert (world.goal.x_m, world.goal.heading_rad, world.goal.tolerance_m) == (5.4, None, 0.05)
    assert world.radius_m == 0.15


def test_movers_match_the_plant() -> None:
    for obstacle in load("moving").obstacles:
        assert isinstance(obstacle, WorldCircle)
    expected = parse_world(json.dumps(as_json(load("moving"), None)))
    walkers = [MovingDisc(one) for one in load("moving").obstacles if isinstance(one, WorldCircle)]
    for shown, walker in zip(expected.movers, walkers, strict=True):
        for time_s in (0.0, 3.3, 17.0, 100.0):
            at = shown.at(time_s)
            assert (at.x_m, at.y_m) == pytest.approx(walker.position_m(time_s))


def drawn(obstacles: object, **more: object) -> bytes:
    return json.dumps({**json.loads(WORLD_TEXT), "obstacles": obstacles, **more}).encode()


@each(
    "text",
    [
        drawn([], size_m=[float("inf"), 1.0]),
        drawn([], size_m=[float("nan"), 1.0]),
        drawn([{"circle_m": {"x": 0, "y": 0, "radius": 1e30}}]),
        drawn([{"circle_m": {"x": 0, "y": 0, "radius": 1}, "speed_m_s": 1, "path_m": []}]),
        drawn([{"wall_m": [[0, 0]] * (MAX_POINTS + 1)}]),
        drawn([{"circle_m": {"x": 0, "y": 0, "radius": 1}}] * (MAX_OBSTACLES + 1)),
    ],
)
def test_world_that_cannot_be_drawn_is_rejected(text: bytes) -> None:
    """Reject a world that would end or stall the app and its heartbeats."""
    with pytest.raises(RemoteError, match="world cannot be read"):
        parse_world(text)


def test_world_name_is_one_printable_line() -> None:
    name = parse_world(drawn([], name=TEXT + "\n" + "x" * 200)).name
    assert raw_in(name) == []
    assert "\n" not in name
    assert len(name) == 64


def test_mover_without_distance_does_not_move() -> None:
    text = WORLD_TEXT.replace(b"[[1, 1], [1, 3]]", b"[[1, 1], [1, 1]]")
    assert parse_world(text).movers[0].at(3.0) == Disc(1.0, 1.0, 0.1)


@each("name", ["box", "moving", "disc", "zigzag", "paper_fig11"])
def test_all_worlds_of_the_plant_are_parsed(name: str) -> None:
    world = load(name)
    found = parse_world(json.dumps(as_json(world, None)))
    assert found.name == world.name
    assert len(found.obstacles) + len(found.movers) == len(world.obstacles) + world.walls


@each(
    "text",
    [
        b"", b"[]", b"3", b'{"name": "x"}', b"\xff\xfe", b"null",
        WORLD_TEXT.replace(b'"x_m": 0.6', b'"x_m": "here"'),
        WORLD_TEXT.replace(b"[6.0, 4.0]", b"[6.0]"),
        WORLD_TEXT.replace(b"[[2, 1]", b"[[2]"),
    ],
)  # fmt: skip
def test_malformed_world_is_rejected(text: bytes) -> None:
    with pytest.raises(RemoteError, match="the plant's world cannot be read"):
        parse_world(text)


def figures(play: Play) -> TelemetryHistory:
    return play.station._model.figures


def lost() -> Play:
    """Return a robot that has driven with its place, and then lost it."""
    play = Play().forward(1.0)
    assert play.station.place_remedy == ""
    assert figures(play).trail.points()
    play.robot.placed = False
    return play.forward(1.0)


def test_robot_without_a_place_is_not_on_the_map() -> None:
    scene = lost().station.scene()
    assert not scene.placed
    assert (scene.robot, scene.goal, scene.virtual_goal) == (None, None, None)
    assert entries(scene, 0)[0] == (NO_PLACE, "text")


def test_remedy_is_the_truth_only_in_a_simulation() -> None:
    play = lost()
    assert play.station.place_remedy == "pose truth"
    play.robot.senses = False
    play.forward(3.0)
    assert play.station.place_remedy == "pose set X Y DEG"
    play.robot.placed = True
    assert play.forward(0.2).station.place_remedy == ""


def test_silent_robot_has_no_remedy() -> None:
    play = lost()
    play.hang()
    assert play.forward(3.0).station.place_remedy == ""


def test_trail_and_echoes_of_a_lost_place_are_dropped() -> None:
    play = lost()
    kept = figures(play)
    assert not kept.trail.points()
    assert not any(kept.echoes_at(play.station.now_ns))
    uncertain = kept.history["uncertainty_m"].last
    assert uncertain is None or isnan(uncertain[1])
    play.robot.placed = True
    play.forward(1.0)
    assert figures(play).trail.points()
    assert play.station.scene().robot is not None


def test_other_robot_without_a_place_is_not_on_the_map() -> None:
    from protocol.topics import Role
    from tests.support.ground.station import Robot

    play = Play()
    other = Robot("r2", x_m=3.0)
    play.robots.append(other)
    play.bus.come(Role.ROBOT, "r2")
    play.forward(1.0)
    assert [mark.name for mark in play.station.scene().others] == ["r2"]
    other.placed = False
    play.forward(0.5)
    assert play.station.scene().others == ()


WAY = (Waypoint(x_m=1.0, y_m=2.0), Waypoint(x_m=3.0, y_m=2.0, heading_deg=90.0))
ROUND = MissionCircle(x_m=1.0, y_m=1.0, radius_m=2.5)
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
    assert scene.fence == (Disc(1.0, 1.0, 2.5),)
    assert play.station.mission_items == scene.mission


def test_mission_and_fence_are_read_again() -> None:
    play = Play()
    play.bus.answers[MISSION_SERVICE.path] = RobotItems(WAY, ROUND)
    play.forward(1.0)
    play.bus.answers[MISSION_SERVICE.path] = RobotItems()
    play.station.reread()
    play.forward(1.0)
    assert play.station.mission_items == ()
    assert play.station.scene().fence == ()


def test_accepted_upload_of_any_operator_is_drawn() -> None:
    play = Play().forward(1.0)
    play.bus.say(COMMANDED, MissionCount(count=2, mission_type=MissionType.MISSION))
    for item in items_of(WAY):
        play.bus.say(COMMANDED, item)
    play.forward(0.1)
    assert play.station.mission_items == ()
    play.bus.say(ANSWERED, verdict(MissionType.MISSION))
    running = make(MissionStatus, mission_id=1, count=2, current=1, state=2)
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
    assert not mission_items.fence


def test_unsaved_fence_is_in_force_and_shown() -> None:
    mission_items = MissionItems()
    for item in fence_items_of(CORNERS):
        mission_items.receive(item)
    mission_items.receive(verdict(MissionType.FENCE, Reason.NOT_SAVED))
    assert mission_items.fence == (Outline(CORNERS.corners),)


def test_polygon_fence_is_shown_and_can_be_cleared() -> None:
    mission_items = MissionItems()
    for item in fence_items_of(CORNERS):
        mission_items.receive(item)
    mission_items.receive(verdict(MissionType.FENCE))
    assert mission_items.fence == (Outline(CORNERS.corners),)
    mission_items.receive(MissionClearAll(mission_type=MissionType.FENCE))
    mission_items.receive(verdict(MissionType.FENCE))
    assert not mission_items.fence


def test_verdict_without_an_upload_is_ignored() -> None:
    mission_items = MissionItems()
    mission_items.receive(verdict(MissionType.MISSION))
    mission_items.receive(None)
    assert mission_items.mission == ()


def test_foreign_mission_items_are_not_drawn() -> None:
    mission_items = MissionItems()
    mission_items.receive(make(MissionItemInt, command=22))
    mission_items.receive(verdict(MissionType.MISSION))
    assert mission_items.mission == ()


def test_download_stops_at_the_first_failure() -> None:
    clock = ManualClock()
    bus, loop = PlayedBus(clock), PlayedLoop(clock)
    reader = Reader(RobotClient(bus, Common(network=Network(), robot="r1"), clock=clock))
    with pytest.raises(RemoteError, match="no process serves it"):
        loop.run(reader._items(MissionType.MISSION))
    assert len(bus.asked) == 1
    bus.answers[MISSION_SERVICE.path] = lambda _: verdict(MissionType.MISSION, Reason.NO_MISSION)
    with pytest.raises(RemoteError, match="did not send its mission"):
        loop.run(reader._items(MissionType.MISSION))
    loop.close()
