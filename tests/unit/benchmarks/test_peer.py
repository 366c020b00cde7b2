"""The world for ir-sim has the same robot, rays and obstacles."""

import json
from math import pi

from checks.speed.trials import PERIOD_S, RAYS, scene_of
from protocol.world import Circle, GoalPose, Polygon, Polyline, Start, World

CORNERS = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))


def world(*, walls: bool) -> World:
    return World(
        name="w",
        size_m=(6.0, 4.0),
        start=Start(x_m=0.6, y_m=2.0, heading_rad=0.5),
        goal=GoalPose(x_m=5.4, y_m=2.0),
        walls=walls,
        obstacles=(
            Circle(x_m=3.0, y_m=1.0, radius_m=0.25),
            Polygon(CORNERS),
            Polyline(CORNERS),
        ),
    )


def test_scene_has_all_obstacles_and_outer_walls() -> None:
    shapes = [obstacle["shape"]["name"] for obstacle in scene_of(world(walls=False))["obstacle"]]
    assert shapes == ["circle", "polygon", "linestring"]
    walled = scene_of(world(walls=True))["obstacle"]
    assert len(walled) == 4
    assert walled[-1]["shape"]["vertices"][2] == [6.0, 4.0]


def test_scene_has_our_robot_and_sensor() -> None:
    scene = scene_of(world(walls=True))
    (robot,) = scene["robot"]
    (lidar,) = robot["sensors"]
    assert robot["shape"] == {"name": "circle", "radius": 0.12}
    assert robot["state"] == [0.6, 2.0, 0.5]
    assert (lidar["number"], lidar["range_max"], lidar["angle_range"]) == (RAYS, 3.0, pi)
    assert scene["world"]["step_time"] == PERIOD_S == 0.05


def test_scene_is_valid_json() -> None:
    scene = scene_of(world(walls=True))
    assert json.loads(json.dumps(scene)) == scene
