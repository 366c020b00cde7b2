"""A world survives its JSON; what cannot be drawn is refused."""

import json
from dataclasses import replace
from math import pi
from typing import Any

import pytest

from plant.model.configuration import body_of, faults_of, noise_of
from plant.world.file import load, loads, shipped
from protocol.world import (
    MAX_OBSTACLES,
    MAX_POINTS,
    GoalPose,
    Polyline,
    Start,
    World,
    WorldCircle,
    WorldPolygon,
    as_json,
    world_in,
)
from tests.support.each import each
from tests.support.ground.station import WORLD_TEXT
from tests.support.hostile import TEXT, raw_in
from tests.support.plant import GOOD

OVERRIDES = """
[robot]
radius_m = 0.15
[noise]
level = "lossy"
incidence_limit_deg = 40.0
[[fault]]
kind = "sonar_dead"
target = "3"
"""


@each("name", shipped())
def test_world_survives_its_json(name: str) -> None:
    world = load(name)
    again = world_in(json.dumps(as_json(world, world.shortest_path_m)))
    unknown = replace(world, family=None, family_seed=None, reachable=None)
    assert as_json(again, None) == as_json(unknown, None)
    assert again.obstacles == world.obstacles


def test_overrides_survive_their_json() -> None:
    world = loads(GOOD + OVERRIDES)
    again = world_in(as_json(world, None))
    assert (body_of(again), faults_of(again)) == (body_of(world), faults_of(world))
    assert noise_of(again) == noise_of(world)


def test_world_of_the_plant_is_read() -> None:
    assert world_in(WORLD_TEXT) == World(
        name="box",
        size_m=(6.0, 4.0),
        start=Start(x_m=0.6, y_m=2.0, heading_rad=pi / 2),
        goal=GoalPose(x_m=5.4, y_m=2.0),
        obstacles=(
            WorldPolygon(((2.0, 1.0), (3.0, 1.0), (3.0, 2.0))),
            Polyline(((0.0, 3.0), (2.0, 3.0)), 0.02),
            WorldCircle(x_m=4.0, y_m=3.0, radius_m=0.25),
            WorldCircle(
                x_m=1.0, y_m=1.0, radius_m=0.1, path_m=((1.0, 1.0), (1.0, 3.0)), speed_m_s=0.5
            ),
        ),
        robot={"radius_m": 0.15},
    )


def facts(**more: Any) -> dict[str, Any]:
    return {**json.loads(WORLD_TEXT), **more}


@each(
    "malformed",
    [
        b"", b"[]", b"3", b'{"name": "x"}', b"\xff\xfe", b"null",
        facts(size_m=[float("inf"), 1.0]),
        facts(size_m=[6.0]),
        facts(start={"x_m": "here", "y_m": 1.0, "heading_deg": 0.0}),
        facts(robot={"radius_m": None}),
        facts(obstacles=[{}]),
        facts(obstacles=[{"polygon_m": [[2]]}]),
        facts(obstacles=[{"circle_m": {"x": 0, "y": 0, "radius": 1e30}}]),
        facts(obstacles=[{"circle_m": {"x": 0, "y": 0, "radius": 1}, "path_m": []}]),
        facts(obstacles=[{"wall_m": [[0, 0]] * (MAX_POINTS + 1)}]),
        facts(obstacles=[{"circle_m": {"x": 0, "y": 0, "radius": 1}}] * (MAX_OBSTACLES + 1)),
    ],
)  # fmt: skip
def test_malformed_world_is_refused(malformed: bytes | dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"."):
        world_in(malformed)


def test_name_of_a_world_is_one_printable_line() -> None:
    name = world_in(facts(name=TEXT + "\n" + "x" * 200)).name
    assert raw_in(name) == []
    assert "\n" not in name
    assert len(name) == 64
