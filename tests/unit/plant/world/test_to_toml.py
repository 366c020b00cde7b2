"""Writing a world file: what is read back is the same world."""

from math import nextafter, pi, radians

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.world.file import load, loads, shipped
from plant.world.writer import dumps, in_degrees
from protocol.world import Circle, GoalPose, Obstacle, Polygon, Polyline, Start, World
from tests.support.each import each
from tests.support.plant.world_texts import GOOD, more

EVERYTHING = more("""
[robot]
radius_m = 0.15
left_start_ticks = -7

[noise]
level = "harsh"
incidence_limit_deg = 33.3

[[fault]]
kind = "sonar_dead"
target = "3"
start_s = 1.5

[[fault]]
kind = "sonar_dead"
target = "4"

[corpus]
family = "a \\"family\\" of \\\\ worlds"
seed = 9007199254740992
reachable = false
""")


@each("name", shipped())
def test_shipped_world_survives_a_toml_round_trip(name: str) -> None:
    assert loads(dumps(load(name))) == load(name)


def test_every_file_key_survives_a_toml_round_trip() -> None:
    world = loads(EVERYTHING)
    assert loads(dumps(world)) == world
    assert (world.faults, world.robot, world.noise) != ((), {}, {})


def test_missing_outer_walls_survive_a_toml_round_trip() -> None:
    family = "[corpus]\nfamily = 'a \"b\" \\ é 世'\n"
    world = loads(GOOD.replace('"test"', '"te.st-1"\nwalls = false') + family)
    assert not world.walls
    assert loads(dumps(world)) == world


def test_toml_starts_with_the_comment_and_is_readable() -> None:
    lines = dumps(loads(GOOD), "What it shows.\nAnd why.").splitlines()
    assert lines[:3] == ["# What it shows.", "# And why.", 'name = "test"']
    assert "start = { x_m = 0.6, y_m = 2.0, heading_deg = 90.0 }" in lines
    assert "circle_m = { x = 4.0, y = 3.0, radius = 0.25 }" in lines


def test_free_heading_is_omitted() -> None:
    text = GOOD.replace(", heading_deg = -90.0", "")
    assert "heading_deg" not in dumps(loads(text)).splitlines()[3]
    assert loads(dumps(loads(text))).goal.heading_rad is None


@given(st.floats(-360.0, 360.0))
def test_angle_given_in_degrees_is_restored_exactly(angle_deg: float) -> None:
    assert radians(in_degrees(radians(angle_deg))) == radians(angle_deg)


@given(st.floats(-2.0 * pi, 2.0 * pi))
def test_any_other_angle_is_restored_within_rounding(angle_rad: float) -> None:
    back_rad = radians(in_degrees(angle_rad))
    assert back_rad == pytest.approx(angle_rad, rel=1e-15, abs=5e-324)


def test_tenth_of_a_degree_is_written_with_one_decimal() -> None:
    assert in_degrees(radians(12.3)) == 12.3
    assert in_degrees(nextafter(radians(12.3), 10.0)) != 12.3


places = st.floats(1.5, 4.5)
points = st.tuples(places, st.floats(0.3, 1.2))
obstacles: st.SearchStrategy[Obstacle] = st.one_of(
    st.builds(Circle, x_m=places, y_m=st.floats(0.3, 1.2), radius_m=st.floats(0.01, 0.3)),
    st.builds(
        Polyline,
        st.lists(points, min_size=2, max_size=4, unique_by=lambda p: round(p[0], 6)).map(tuple),
        st.floats(0.001, 0.2),
    ),
    points.map(lambda p: Polygon((p, (p[0] + 0.3, p[1]), (p[0], p[1] + 0.2)))),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(obstacles, max_size=6), st.floats(-360, 360), st.none() | st.floats(-360, 360))
def test_any_world_survives_a_toml_round_trip(
    some: list[Obstacle], start_deg: float, goal_deg: float | None
) -> None:
    world = World(
        name="any",
        size_m=(6.0, 4.0),
        start=Start(x_m=0.5, y_m=3.5, heading_rad=radians(start_deg)),
        goal=GoalPose(
            x_m=5.5, y_m=3.5, heading_rad=None if goal_deg is None else radians(goal_deg)
        ),
        obstacles=tuple(some),
    )
    assert loads(dumps(world)) == world
