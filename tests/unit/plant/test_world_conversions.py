"""A world from JSON, to TOML, and with changed values."""

import io
import json
from math import nextafter, pi, radians
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.model.errors import WorldError
from plant.world.file import from_json, load, loads, shipped
from plant.world.writer import dumps, in_degrees
from protocol.world import (
    GoalPose,
    Obstacle,
    Polyline,
    Start,
    World,
    WorldCircle,
    WorldPolygon,
    as_json,
    world_in,
)
from tests.support.each import each
from tests.support.plant import GOOD, Bad, assert_told, more, with_line

GIVEN = ("name", "size_m", "start", "goal", "walls", "obstacles", "robot", "noise", "faults")


def facts(name: str = "moving") -> dict[str, Any]:
    return dict(as_json(load(name), 4.2))


@each("name", shipped())
def test_every_shipped_world_survives_a_json_round_trip(name: str) -> None:
    world = load(name)
    again = loads(json.dumps(as_json(world, 4.2)))
    assert [getattr(again, key) for key in GIVEN] == [getattr(world, key) for key in GIVEN]


def test_overrides_and_faults_survive_a_json_round_trip() -> None:
    text = dumps(load("box")) + (
        '[robot]\nradius_m = 0.1\n[noise]\nlevel = "none"\nincidence_limit_deg = 40.0\n'
        '[[fault]]\nkind = "sonar_dead"\ntarget = "3"\nstart_s = 2.0\n'
    )
    world = loads(text)
    again = loads(json.dumps(as_json(world, None)))
    assert (again.robot, again.faults) == (world.robot, world.faults)
    assert again.noise["incidence_limit_rad"] == world.noise["incidence_limit_rad"]


def test_fields_of_several_robots_are_ignored() -> None:
    more = facts() | {"starts": [], "goals": []}
    assert from_json(json.dumps(more), "-").name == "moving"


def test_world_file_may_be_json(tmp_path: Path) -> None:
    path = tmp_path / "told.json"
    path.write_text(json.dumps(facts("box")), encoding="utf-8")
    assert load(path).obstacles == load("box").obstacles


class Given:
    """Standard input with content."""

    def __init__(self, data: bytes) -> None:
        self.buffer = io.BytesIO(data)


@pytest.mark.parametrize("text", [json.dumps(facts("box")), dumps(load("box"))])
def test_dash_reads_standard_input(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", Given(text.encode()))
    world: World = load("-")
    assert world.obstacles == load("box").obstacles


def broken(**changes: object) -> str:
    return json.dumps(facts() | changes)


@each(
    ("text", "said"),
    [
        ("{", "-:1: json"),
        ('{\n"name": "x"\n"}', "-:3: json"),
        ("{" + '"a":{' * 100_000, "nested too deeply"),
        ("{" + '"a":{' * 500 + "}" * 501, "nested too deeply"),
        ("{}", "size_m: missing"),
        (broken(obstacles=3), "obstacle: expected"),
        (broken(goal=None), "goal"),
        (broken(goal=[1, 2]), "goal: expected a table"),
        (broken(start={"x_m": 99.0, "y_m": 1.0}), "outside the floor"),
        (broken(start={"x_m": float("nan"), "y_m": 1.0}), "start.x_m"),
        (broken(sise_m=[1, 2]), "sise_m"),
        (broken(obstacles=[{"circle_m": None}]), "circle_m"),
        (broken(robot=None), "robot"),
        (broken(faults=[{"kind": "gremlin"}]), "gremlin"),
    ],
)
def test_invalid_json_world_is_rejected_by_name(text: str, said: str) -> None:
    with pytest.raises(WorldError) as refused:
        loads(text, "-")
    assert said in str(refused.value)


def test_oversized_or_binary_standard_input_is_rejected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for data, said in ((b"{" + b" " * 1_000_001, "larger than"), (b"\xff\xfe", "UTF-8")):
        monkeypatch.setattr("sys.stdin", Given(data))
        with pytest.raises(WorldError, match=said):
            load("-")


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


def test_gap_between_robots_is_written_only_if_it_is_not_the_usual_one() -> None:
    assert "gap_m" not in dumps(loads(GOOD))
    world = loads(GOOD.replace("heading_deg = 90.0", "heading_deg = 90.0, gap_m = 1.5"))
    assert world.start.gap_m == 1.5
    assert loads(dumps(world)) == world
    assert world_in(as_json(world, None)).start.gap_m == 1.5


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
    st.builds(WorldCircle, x_m=places, y_m=st.floats(0.3, 1.2), radius_m=st.floats(0.01, 0.3)),
    st.builds(
        Polyline,
        st.lists(points, min_size=2, max_size=4, unique_by=lambda p: round(p[0], 6)).map(tuple),
        st.floats(0.001, 0.2),
    ),
    points.map(lambda p: WorldPolygon((p, (p[0] + 0.3, p[1]), (p[0], p[1] + 0.2)))),
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


BAD = [
    Bad(
        "a typo in robot",
        more("[robot]\nradus_m = 0.1\n"),
        "21 robot.radus_m: unknown key -> did you mean radius_m?",
    ),
    Bad(
        "a robot in centimetres",
        more("[robot]\nradius_cm = 12\n"),
        "21 robot.radius_cm: wrong unit -> did you mean radius_m = 0.12?",
    ),
    Bad(
        "a robot of nothing",
        more("[robot]\nwheel_radius_m = 0\n"),
        "21 robot.wheel_radius_m: must be above zero -> a value such as wheel_radius_m = 0.033",
    ),
    Bad(
        "wheels beside the robot",
        more("[robot]\nradius_m = 0.05\n"),
        "20 robot.track_m: wider than the robot -> set track_m too, to fit radius_m",
    ),
    Bad(
        "half a tick",
        more("[robot]\nleft_start_ticks = 0.5\n"),
        "21 robot.left_start_ticks: expected a whole number -> left_start_ticks = 0",
    ),
    Bad(
        "a word as robot",
        with_line(5, 'robot = "r2"'),
        "5 robot: expected a table -> write { radius_m",
    ),
    Bad(
        "a level nobody knows",
        more('[noise]\nlevel = "loud"\n'),
        "21 noise.level: no noise level 'loud'; there are none, default, lossy, harsh"
        ' -> level = "default"',
    ),
    Bad(
        "more than certain",
        more("[noise]\ndropout_probability = 1.5\n"),
        "21 noise.dropout_probability: 1.5 is not within 0 to 1 -> dropout_probability = 0",
    ),
    Bad(
        "noise in radians",
        more("[noise]\nincidence_limit_rad = 0.5\n"),
        "21 noise.incidence_limit_rad: wrong unit -> did you mean incidence_limit_deg = 28.6479?",
    ),
    Bad(
        "a fault without kind",
        more('[[fault]]\ntarget = "3"\n'),
        '20 fault#1.kind: missing -> add kind = "sonar_dead"',
    ),
    Bad(
        "a fault nobody knows",
        more('[[fault]]\nkind = "gremlin"\n'),
        "21 fault#1.kind: no fault 'gremlin'; there are sonar_dead -> kind = \"sonar_dead\"",
    ),
    Bad(
        "the ninth sonar",
        more('[[fault]]\nkind = "sonar_dead"\ntarget = "8"\n'),
        "22 fault#1.target: '8' is none of -> target = \"3\"",
    ),
    Bad(
        "one fault", more('[fault]\nkind = "sonar_dead"\n'), "20 fault: a table -> write [[fault]]"
    ),
]


@each("bad", BAD)
def test_impossible_robot_noise_or_fault_is_rejected(bad: Bad) -> None:
    assert_told(bad, alone=True)
