"""The plant's description of its world becomes map shapes or an error."""

import json
from math import pi

import pytest

from ground.map.scene import Disc, Outline
from ground.station.world import MAX_OBSTACLES, MAX_POINTS, parse_world
from plant.sim.physics import Mover as Walker
from plant.world.file import load
from protocol.world import Circle, as_json
from runtime.errors import RemoteError
from tests.support.each import each
from tests.support.ground.station.play import WORLD_TEXT
from tests.support.hostile import TEXT, raw_in


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
        assert isinstance(obstacle, Circle)
    expected = parse_world(json.dumps(as_json(load("moving"), None)))
    walkers = [Walker(one) for one in load("moving").obstacles if isinstance(one, Circle)]
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
