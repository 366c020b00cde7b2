"""Drawings for Foxglove: its schemas, positions in metres, nothing for missing values."""

import inspect
import json
from base64 import b64decode
from collections.abc import Iterator
from math import cos, inf, nan, radians
from struct import iter_unpack
from typing import Any

import foxglove.messages as sdk
import pytest

from ground.recording.foxglove_scene import MAX_POSES, SceneDrawer, ViewerMessage
from ground.recording.foxglove_schemas import SHAPES
from protocol.topics import MARK, TEXT
from protocol.wire.enums import GoalState, Severity
from protocol.wire.message import Message
from protocol.wire.messages import Statustext
from protocol.wire.statustext import pieces_of
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.ground.made_recordings import WORLD_TEXT, decision, odometry, scan, status, truth

OF_FOXGLOVE = "foxglove."
BASIC = ("time", "duration")


def all_in(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield every named object in a schema."""
    if "properties" in schema and schema.get("title") not in BASIC:
        yield schema
    inside = [*schema.get("properties", {}).values()]
    inside += [schema["items"]] if "items" in schema else []
    for inner in inside:
        yield from all_in(inner)


@each("name", sorted(SHAPES))
def test_schema_fields_match_the_sdk(name: str) -> None:
    assert SHAPES[name].name == name
    found = list(all_in(json.loads(SHAPES[name].text)))
    assert found
    for schema in found:
        title = schema["title"].removeprefix(OF_FOXGLOVE)
        fields = set(inspect.signature(getattr(sdk, title)).parameters)
        assert set(schema["properties"]) == fields, title
        assert set(schema["required"]) == fields, title


def seen(drawer: SceneDrawer, message: Message, time_ns: int = S) -> dict[str, Any]:
    return {drawn.topic: drawn.content for drawn in drawer.draw("k", message, time_ns)}


def known(drawer: SceneDrawer) -> dict[str, Any]:
    return {drawn.topic: drawn.content for drawn in drawer.draw_fact("world", WORLD_TEXT, S)}


def test_pose_is_drawn_and_moves_the_robot_frame() -> None:
    drawn = seen(SceneDrawer(), odometry(0, 1.25, 2.5, radians(90.0)), 3 * S + 7)
    pose = drawn["/robot/pose"]
    assert pose["timestamp"] == {"sec": 3, "nsec": 7}
    assert pose["pose"]["position"] == {"x": 1.25, "y": 2.5, "z": 0.0}
    assert pose["pose"]["orientation"]["z"] == pytest.approx(cos(radians(45.0)), abs=1e-4)
    transform = drawn["/tf"]
    assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("world", "robot")
    assert transform["translation"]["x"] == 1.25


def test_trail_is_sent_once_a_second_and_bounded() -> None:
    drawer, reported = SceneDrawer(), []
    for tick in range(20_000):
        drawn = seen(drawer, odometry(0, tick * 0.0125), tick * S // 20)
        if "/robot/trail" in drawn:
            reported.append(len(drawn["/robot/trail"]["poses"]))
    assert len(reported) == 1000
    assert reported[1] > reported[0]
    assert max(reported) <= MAX_POSES
    assert reported[-1] > MAX_POSES // 2


def test_pose_with_nan_is_not_drawn() -> None:
    assert seen(SceneDrawer(), odometry(0, nan)) == {}
    assert seen(SceneDrawer(), truth(0, inf)) == {}


def test_echoes_are_points_measured_from_the_rim() -> None:
    drawer = SceneDrawer()
    known(drawer)
    cloud = seen(drawer, scan(0, 0, echo=0b1000_0001))["/sonar/echoes"]
    points = list(iter_unpack("<fff", b64decode(cloud["data"])))
    assert len(points) == 2
    far_m = [(x * x + y * y) ** 0.5 for x, y, _ in points]
    assert far_m == pytest.approx([0.15 + 0.800, 0.15 + 0.807], abs=1e-6)
    assert points[0][1] < 0 < points[1][1], "sonar 0 points right, 7 left"
    assert seen(drawer, scan(0, 0, echo=0))["/sonar/echoes"]["data"] == ""


def test_goal_is_drawn_when_it_changes() -> None:
    drawer = SceneDrawer()
    assert seen(drawer, status(0, GoalState.NONE)) == {}
    (goal,) = seen(drawer, status(0))["/goal"]["entities"]
    assert goal["cylinders"][0]["pose"]["position"]["x"] == 5.4
    assert len(goal["arrows"]) == 1
    assert seen(drawer, status(1)) == {}


def test_virtual_goal_is_drawn_and_cleared() -> None:
    drawer = SceneDrawer()
    virtual, zone = seen(drawer, decision(0))["/goal/virtual"]["entities"]
    assert len(virtual["spheres"]) == len(zone["lines"]) == 1
    assert seen(drawer, decision(1)) == {}, "unchanged"
    virtual, zone = seen(drawer, decision(2, (nan, nan)))["/goal/virtual"]["entities"]
    assert virtual["spheres"] == zone["lines"] == []


def test_world_is_drawn_as_walls_and_discs() -> None:
    drawn = known(SceneDrawer())
    walls, start = drawn["/world"]["entities"]
    assert len(walls["cubes"]) == 4 + 3 + 2, "outer walls, triangle, a bent wall"
    assert {cube["size"]["x"] for cube in walls["cubes"]} >= {6.0, 4.0, 2.0}
    assert [disc["color"]["a"] for disc in walls["cylinders"]] == [1.0, 0.4], (
        "moving obstacles are pale"
    )
    assert len(start["arrows"]) == 1
    (robot,) = drawn["/robot/body"]["entities"]
    assert robot["cylinders"][0]["size"]["x"] == 0.3


@each("text", ["", "[]", "{", '{"obstacles": [{"wall_m": 3}]}', '{"size_m": 1}'])
def test_malformed_world_is_not_drawn(text: str) -> None:
    drawn: list[ViewerMessage] = SceneDrawer().draw_fact("world", text, 0)
    assert len(drawn) in (0, 2)
    assert SceneDrawer().draw_fact("parameters", WORLD_TEXT, 0) == []


@each(
    ("severity", "level"),
    [(Severity.INFO, 2), (Severity.WARNING, 3), (Severity.ERROR, 4), (Severity.EMERGENCY, 5)],
)
def test_log_level_follows_severity(severity: Severity, level: int) -> None:
    drawn = seen(SceneDrawer(), Statustext(severity=severity, text="hello"))
    assert (drawn["/log"]["level"], drawn["/log"]["message"]) == (level, "hello")
    assert seen(SceneDrawer(), Statustext(severity=99, text="odd"))["/log"]["level"] == 1


def test_interleaved_texts_are_assembled_per_sender() -> None:
    drawer, logged = SceneDrawer(), []
    robot_text, remark = "text of the robot " * 5, "remark of an operator " * 4
    for pieces in zip(pieces_of(robot_text, 7, 6), pieces_of(remark, 7, 5), strict=True):
        for topic, piece in zip((TEXT, MARK), pieces, strict=True):
            logged += [one.content for one in drawer.draw(topic.key("r1"), piece, 0)]
    assert [(one["name"], one["message"]) for one in logged] == [
        ("robot", robot_text),
        ("op/mark", remark),
    ]
