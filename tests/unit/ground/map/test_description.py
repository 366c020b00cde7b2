"""What a screen reader says of the map."""

from dataclasses import replace
from math import inf, nan, pi

from hypothesis import given, settings

from ground.map import Robot, Scene, Target, describe
from tests.support.ground.map.rooms import EVERYTHING, ROOM
from tests.support.ground.map.scenes import SCENES


@given(SCENES)
@settings(deadline=None)
def test_every_scene_has_words_of_one_line_each(scene: Scene) -> None:
    assert all(line and line.isprintable() for line in describe(scene))


def test_where_it_is_where_it_goes_and_what_it_sees_in_that_order() -> None:
    assert describe(ROOM) == [
        "robot: at 1.90 2.00 heading 0 deg",
        "goal: at 5.20 3.20 heading 90 deg, 3.51 m away, 20 deg to the left",
        "nearest echo: 0.90 m, 11 deg to the right",
        "sonars, left to right: 1.60, no echo, no echo, 0.90, 0.90, missing, no echo, no echo",
        "obstacles: 2 (simulation truth)",
    ]


def test_everything_has_its_line() -> None:
    assert describe(EVERYTHING) == [
        "robot: at 1.90 2.00 heading 0 deg",
        "sure of its place to 0.61 m (95 %)",
        "goal: at 5.20 3.20 heading 90 deg, 3.51 m away, 20 deg to the left",
        "steers to: 2.00 3.40, 1.40 m away, 86 deg to the left",
        "nearest echo: 0.90 m, 11 deg to the right",
        "sonars, left to right: 1.60, no echo, no echo, 0.90, 0.90, missing, no echo, no echo",
        "mission item 1 of 2: at 0.60 0.60",
        "mission item 2 of 2: at 4.40 0.80 heading 0 deg, under way",
        "draft item 1 of 2: at 2.40 0.40",
        "draft item 2 of 2: at 5.60 0.40 heading 90 deg",
        "robot r2: at 5.20 1.60 heading 180 deg, 3.32 m away, 7 deg to the right",
        "moving obstacle (simulation truth): at 4.00 2.60, 2.18 m away, 16 deg to the left",
        "ghost bug: stuck at 2.50 0.60",
        "a fence is set",
        "cursor: at 0.40 3.60, 2.19 m away, 133 deg to the left",
    ]


def test_nothing_is_said_as_if_it_were_now_of_a_robot_that_is_not_heard() -> None:
    lost = describe(replace(ROOM, live=False))
    assert lost[0] == "robot: not live, last at 1.90 2.00 heading 0 deg"
    assert not any("sonar" in line or "echo" in line for line in lost)
    assert describe(Scene()) == ["robot: not heard yet", "goal: none"]


def test_what_is_unknown_is_called_so() -> None:
    scene = Scene(robot=Robot(nan, 2.0, 0.0), goal=Target(1.0, inf))
    assert describe(scene) == ["robot: at an unknown place", "goal: at an unknown place"]


def test_ahead_and_behind_are_words() -> None:
    scene = Scene(robot=Robot(0.0, 0.0, 4.0 * pi), goal=Target(2.0, 0.0), cursor=(-1.0, 0.0))
    assert describe(scene)[1:] == [
        "goal: at 2.00 0.00, 2.00 m away, ahead",
        "cursor: at -1.00 0.00, 1.00 m away, behind",
    ]


def test_an_echo_inside_the_zone_is_said_to_be_there() -> None:
    scene = replace(ROOM, ranges_m=(inf, 0.2), zone_m=0.3)
    assert "nearest echo: 0.20 m, 11 deg to the left, inside the avoidance zone" in describe(scene)
