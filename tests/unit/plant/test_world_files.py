"""World files: structure, places, the [corpus] table, and each mistake by name."""

import os
from contextlib import suppress
from math import isclose, pi, radians
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body, body_of, faults_of, noise_of
from plant.model.errors import WorldError
from plant.shortest_path import known_length_m, shortest_path_m
from plant.world.file import load, loads, shipped
from protocol.world import Polyline, WorldCircle, WorldPolygon
from study.trial.trial import Trial, run_trial, shortest_once
from tests.support.each import each
from tests.support.plant import (
    GOOD,
    ROBOT_AT,
    Bad,
    assert_told,
    goal,
    more,
    refusal,
    start,
    with_line,
)


def test_world_is_read_in_metres_and_radians() -> None:
    world = loads(GOOD)
    assert (world.name, world.size_m, world.walls) == ("test", (6.0, 4.0), True)
    assert (world.start.x_m, world.start.y_m) == (0.6, 2.0)
    assert isclose(world.start.heading_rad, pi / 2)
    assert isclose(world.goal.heading_rad or 0.0, -pi / 2)


def test_obstacles_keep_the_order_of_the_file() -> None:
    polygon, disc, wall, walker = loads(GOOD).obstacles
    assert polygon == WorldPolygon(((2.0, 1.0), (3.0, 1.0), (3.0, 1.5), (2.0, 1.5)))
    assert disc == WorldCircle(x_m=4.0, y_m=3.0, radius_m=0.25)
    assert wall == Polyline(((1.0, 3.0), (2.0, 3.0), (2.5, 2.5)), 0.05)
    path_m = ((3.5, 0.5), (3.5, 3.5))
    assert walker == WorldCircle(x_m=3.5, y_m=0.5, radius_m=0.15, path_m=path_m, speed_m_s=0.1)


def test_goal_without_heading_accepts_any() -> None:
    world = loads(goal("{ x_m = 5.4, y_m = 2.0 }"))
    assert world.goal.heading_rad is None
    assert world.goal.position_tolerance_m == 0.05
    assert isclose(world.goal.heading_tolerance_rad, radians(3.0))


def test_integers_are_accepted_as_floats() -> None:
    assert loads(with_line(2, "size_m = [6, 4]")).size_m == (6.0, 4.0)


def test_concave_polygons_are_accepted() -> None:
    concave = "polygon_m = [[2, 1], [3, 1], [3, 1.6], [2.5, 1.1], [2, 1.6]]"
    assert len(loads(with_line(7, concave)).obstacles) == 4


def test_start_in_the_bay_of_a_concave_polygon_is_free() -> None:
    bay = "polygon_m = [[0.2, 1.6], [1.2, 1.6], [1.2, 2.4], [0.2, 2.4], [0.2, 2.3], [1.1, 2.3],"
    bay += "[1.1, 1.7], [0.2, 1.7]]"
    assert loads(with_line(7, bay)).start.x_m == 0.6


def test_start_at_the_edge_is_valid_without_outer_walls() -> None:
    edge = start("{ x_m = 0.0, y_m = 2.0 }")
    assert not loads(with_line(5, "walls = false", edge)).walls


def test_goal_may_be_at_the_start_of_a_moving_obstacle() -> None:
    assert loads(goal("{ x_m = 3.5, y_m = 0.5 }")).goal.y_m == 0.5


def test_world_file_overrides_only_the_named_robot_values() -> None:
    world = loads(more("[robot]\nradius_m = 0.15\nmax_speed_m_s = 0.2\n"))
    assert world.robot == {"radius_m": 0.15, "max_speed_m_s": 0.2}
    assert body_of(world) == Body(radius_m=0.15, max_speed_m_s=0.2)
    assert body_of(loads(GOOD)) == Body()


def test_command_line_noise_overrides_the_file() -> None:
    world = loads(more('[noise]\nlevel = "none"\nincidence_limit_deg = 40.0\n'))
    assert isclose(noise_of(world).incidence_limit_rad, radians(40.0))
    assert noise_of(world).range_sigma_m == 0.0
    assert noise_of(world, "harsh") == LEVELS["harsh"]
    assert noise_of(loads(GOOD)) == LEVELS["default"]


def test_faults_keep_their_order() -> None:
    text = '[[fault]]\nkind = "sonar_dead"\ntarget = "3"\nstart_s = 2\n'
    dead, stuck = faults_of(
        loads(more(text + '[[fault]]\nkind = "wheel_stuck"\ntarget = "left"\n'))
    )
    assert (dead.kind, dead.target, dead.start_s) == ("sonar_dead", "3", 2.0)
    assert (stuck.kind, stuck.target) == ("wheel_stuck", "left")


def refused(path: Path | str) -> str:
    with pytest.raises(WorldError) as caught:
        load(path)
    return str(caught.value)


def test_file_is_loaded_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD.replace("\n", "\r\n"), encoding="utf-8")
    assert load(path) == loads(GOOD)


def test_error_names_the_given_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(with_line(2, ""), encoding="utf-8")
    assert refused(path).startswith(f"{path}:1: size_m: missing; fix: add size_m")


def test_misspelt_world_name_gets_a_suggestion_and_all_names() -> None:
    text = refused("u_trp")
    assert text.startswith("u_trp: name: no shipped world has this name; fix: did you mean u_trap?")
    assert all(name in text for name in shipped())


@each("name", ["", ".", "..", "x" * 5000, "a\0b"])
def test_path_like_name_is_not_a_shipped_world(name: str) -> None:
    assert "no shipped world has this name; fix: " in refused(name)


@pytest.mark.parametrize("name", ["nowhere.toml", "no/where", "x" * 5000 + ".toml", "a\0b.toml"])
def test_missing_file_is_reported(name: str, tmp_path: Path) -> None:
    text = refused(f"{tmp_path}/{name}")
    assert ": file: cannot be read: " in text
    assert "; fix: give a readable .toml file" in text


def test_unreadable_file_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def deny(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", deny)
    assert "x.toml: file: cannot be read: Permission denied; fix: " in refused(tmp_path / "x.toml")


def test_directory_is_rejected_as_a_world(tmp_path: Path) -> None:
    assert refused(tmp_path) == f"{tmp_path}: file: not a regular file; fix: give a .toml file"


def test_device_is_not_read() -> None:
    assert "/dev/zero: file: not a regular file; fix: " in refused("/dev/zero")


def test_binary_file_is_reported_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "picture.toml"
    path.write_bytes(b'name = "x"\n\x89PNG\xff\xfe')
    assert refused(path).startswith(f"{path}:2: file: not UTF-8 text; fix: is it a world file?")


def test_huge_file_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "log.toml"
    path.write_bytes(b"#" * 1_000_001)
    assert ": file: larger than 1000000 bytes; fix: " in refused(path)


BAD = [
    Bad("no name", with_line(1, ""), '1 name: missing -> add name = "my_world"'),
    Bad("no size", with_line(2, ""), "1 size_m: missing -> add size_m = [6.0, 4.0]"),
    Bad("no start", with_line(3, ""), "1 start: missing -> add start = {"),
    Bad("no goal", with_line(4, ""), "1 goal: missing -> add goal = {"),
    Bad("no goal.x_m", goal("{ y_m = 2.0 }"), "4 goal.x_m: missing -> add x_m = "),
    Bad("a typo", more("[robt]\n"), "20 robt: unknown key -> did you mean robot?"),
    Bad("a stranger", with_line(5, "xyz = 1"), "5 xyz: unknown key -> the keys here are name"),
    Bad(
        "centimetres",
        with_line(2, "size_cm = [600, 400]"),
        "2 size_cm: wrong unit -> did you mean size_m = [6, 4]? (metres)",
    ),
    Bad(
        "radians",
        start("{ x_m = 0.6, y_m = 2.0, heading_rad = 1.5 }"),
        "3 start.heading_rad: wrong unit -> did you mean heading_deg = 85.9437? (degrees)",
    ),
    Bad(
        "no unit",
        start("{ x = 0.6, y_m = 2.0 }"),
        "3 start.x: no unit in the key -> did you mean x_m? (metres)",
    ),
    Bad(
        "a unit too many",
        with_line(10, "circle_m = { x_m = 4.0, y = 3.0, radius = 0.25 }"),
        "10 obstacle#2.circle_m.x_m: wrong unit -> did you mean x?",
    ),
    Bad(
        "km/h",
        with_line(19, "speed_km_h = 0.36"),
        "19 obstacle#4.speed_km_h: wrong unit -> did you mean speed_m_s = 0.1? (metres per second)",
    ),
    Bad("a number as name", with_line(1, "name = 3"), '1 name: expected text -> name = "my'),
    Bad("no name in it", with_line(1, 'name = ""'), "1 name: is not a valid name -> write name = "),
    Bad("blank name", with_line(1, 'name = " "'), "1 name: is not a valid name -> write name = "),
    Bad(
        "path up",
        with_line(1, 'name = "../up"'),
        "1 name: '../up' is not a valid name -> write name",
    ),
    Bad("root", with_line(1, 'name = "/etc/x"'), "1 name: is not a valid name -> write name = "),
    Bad("parent", with_line(1, 'name = ".."'), "1 name: is not a valid name -> write name = "),
    Bad("hidden", with_line(1, 'name = ".x"'), "1 name: is not a valid name -> write name = "),
    Bad(
        "backslash", with_line(1, 'name = "a\\\\b"'), "1 name: is not a valid name -> write name = "
    ),
    Bad(
        "two lines", with_line(1, 'name = "a\\nb"'), "1 name: is not a valid name -> write name = "
    ),
    Bad(
        "end of line", with_line(1, 'name = "a\\n"'), "1 name: is not a valid name -> write name = "
    ),
    Bad("long", with_line(1, f'name = "{"x" * 65}"'), "1 name: longer than 64 -> write name"),
    Bad("a flag as word", with_line(5, 'walls = "no"'), "5 walls: true or false -> walls = true"),
    Bad("a word as size", with_line(2, 'size_m = "6"'), "2 size_m: two numbers -> [6.0, 4.0]"),
    Bad("three sizes", with_line(2, "size_m = [6, 4, 2]"), "2 size_m: found 3 values -> 6.0"),
    Bad("a flag as x", start(ROBOT_AT % ("true", 2)), "3 start.x_m: a truth value -> x_m = 0.6"),
    Bad("a list as start", start("[1, 2]"), "3 start: expected a table -> write { x_m = 0.6"),
    Bad("a date", start(ROBOT_AT % ("2020-01-01", 2)), "3 start.x_m: a date -> x_m = 0.6"),
    Bad("NaN", start(ROBOT_AT % ("nan", 2)), "3 start.x_m: nan is not finite -> a number of -100"),
    Bad("infinity", goal(ROBOT_AT % ("-inf", 2)), "4 goal.x_m: -inf is not finite -> x_m = 0.6"),
    Bad("overflow", goal(ROBOT_AT % ("1e999", 2)), "4 goal.x_m: inf is not finite -> x_m = 0.6"),
    Bad(
        "far away", goal(ROBOT_AT % (1000, 2)), "4 goal.x_m: 1000 is out of range -> -100 to 100 m"
    ),
    Bad("hex monster", goal(ROBOT_AT % ("0x" + "f" * 9999, 2)), "4 goal.x_m: huge -> -100 to 100"),
    Bad("no floor", with_line(2, "size_m = [0.0, 4.0]"), "2 size_m: 0.0 is out of -> 0.5 to 100 m"),
    Bad(
        "no tolerance",
        goal("{ x_m = 5.4, y_m = 2.0, position_tolerance_m = 0.0 }"),
        "4 goal.position_tolerance_m: 0.0 is out of range -> a number of 0.001 to 2 m",
    ),
    Bad(
        "a heading of many turns",
        start("{ x_m = 0.6, y_m = 2.0, heading_deg = 5000 }"),
        "3 start.heading_deg: 5000 is out of range -> -360 to 360 degrees",
    ),
    Bad(
        "a gap below zero",
        start("{ x_m = 0.6, y_m = 2.0, gap_m = -0.1 }"),
        "3 start.gap_m: -0.1 is out of range -> 0 to 10 m",
    ),
]


@each("bad", BAD)
def test_missing_misspelt_or_mistyped_key_is_reported(bad: Bad) -> None:
    assert_told(bad, alone=True)


BAD_VALUES = [
    Bad("an open list", with_line(2, "size_m = [6.0,"), "3 start: Invalid -> correct the TOML"),
    Bad("no value", with_line(1, "name ="), "1 name: Invalid value -> correct the TOML there"),
    Bad("an open text", with_line(1, 'name = "test'), "1 name: Illegal -> correct the TOML there"),
    Bad(
        "nothing closes", 'name = "x"\nsize_m = [1,\n', "3 toml: Invalid value -> correct the TOML"
    ),
    Bad("twice", with_line(5, "size_m = [5.0, 4.0]"), "5 size_m: given twice -> keep one of them"),
    Bad(
        "twice in a table",
        start("{ x_m = 0.6, x_m = 0.7, y_m = 2 }"),
        "3 start: given twice (Duplicate inline table key 'x_m') -> keep one",
    ),
    Bad("two robots", more("[robot]\n[robot]\n"), "21 robot: given twice -> keep one of them"),
    Bad("too deep", "a = " + "[" * 5000, "1 toml: nested too deeply -> use fewer ["),
    Bad("too long", "a = " + "9" * 5000, "1 a: a number is too long -> correct the TOML"),
    Bad("a zero byte", "a = 1\nb = \x00", "2 b: Invalid value -> correct the TOML"),
]


@each("bad", BAD_VALUES)
def test_invalid_toml_is_rejected(bad: Bad) -> None:
    assert_told(bad, alone=True)


def test_obstacle_must_be_a_table() -> None:
    text = "\n".join(["obstacle = [1]", *GOOD.split("\n")[:4]])
    error = refusal(text)
    assert str(error).startswith("bad.toml:1: obstacle#1: expected a table, found a whole number")


def test_all_errors_are_reported_in_the_order_of_the_file() -> None:
    text = with_line(2, "size_cm = [600, 400]", with_line(10, "circle_m = { x = 1, y = 2 }"))
    text = with_line(19, "", with_line(3, 'start = { x_m = "here", y_m = 2 }', text))
    keys = [problem.key for problem in refusal(text).problems]
    assert keys == [
        "size_cm",
        "start.x_m",
        "obstacle#2.circle_m.radius",
        "obstacle#4.speed_m_s",
    ]


def test_invalid_obstacle_does_not_hide_errors_in_start_or_goal() -> None:
    text = with_line(19, "", with_line(3, "start = { x_m = 2.5, y_m = 1.2 }"))
    assert [problem.key for problem in refusal(text).problems] == ["start", "obstacle#4.speed_m_s"]


@given(st.text(max_size=200))
def test_any_text_raises_only_world_errors(text: str) -> None:
    with pytest.raises(WorldError):
        loads(text)


VALUES = ["nan", "inf", "-1", "1e300", "true", '"x"', "[]", "{}", "[[1]]", "[{}]", "1979-05-27"]


@given(st.integers(1, 19), st.sampled_from(VALUES))
def test_any_value_raises_only_world_errors(number: int, value: str) -> None:
    key, equals, _ = GOOD.split("\n")[number - 1].partition(" = ")
    with suppress(WorldError):
        assert loads(with_line(number, f"{key} = {value}" if equals else ""))


BAD_PLACES = [
    Bad(
        "start in the polygon",
        start(ROBOT_AT % (2.5, 1.2)),
        "3 start: (2.5, 1.2) is inside obstacle#1 (line 6) -> keep start at least 0.12 m away",
    ),
    Bad(
        "start in the circle",
        start(ROBOT_AT % (4.1, 3.0)),
        "3 start: inside obstacle#2 (line 9) -> keep start",
    ),
    Bad(
        "start on the wall",
        start(ROBOT_AT % (1.5, 3.01)),
        "3 start: inside obstacle#3 (line 12) -> keep start",
    ),
    Bad(
        "start where someone walks off",
        start(ROBOT_AT % (3.5, 0.5)),
        "3 start: inside obstacle#4 (line 16) -> keep start",
    ),
    Bad(
        "start too near",
        start(ROBOT_AT % (1.9, 1.2)),
        "3 start: (1.9, 1.2) is 0.1 m from obstacle#1 (line 6),"
        " less than the robot's radius of 0.12 m"
        " -> keep start at least 0.12 m away",
    ),
    Bad(
        "start beyond the floor",
        start(ROBOT_AT % (-0.5, 2.0)),
        "3 start.x_m: -0.5 is outside the floor of 6 x 4 m -> choose x_m within 0.12 to 5.88",
    ),
    Bad(
        "start at the outer wall",
        start(ROBOT_AT % (0.6, 3.95)),
        "3 start.y_m: 3.95 is nearer to the outer wall than the robot's radius of 0.12 m"
        " -> choose y_m within 0.12 to 3.88",
    ),
    Bad(
        "goal in the polygon",
        goal(ROBOT_AT % (2.5, 1.2)),
        "4 goal: inside obstacle#1 (line 6) -> keep goal at least 0.12 m away",
    ),
    Bad(
        "goal beyond the floor",
        goal(ROBOT_AT % (7.0, 2.0)),
        "4 goal.x_m: 7 is outside the floor of 6 x 4 m -> choose x_m within 0.12 to 5.88",
    ),
    Bad(
        "a robot too wide for its start",
        more("[robot]\nradius_m = 0.7\n"),
        "3 start.x_m: nearer to the outer wall than the robot's radius of 0.7 m"
        " -> within 0.7 to 5.3",
    ),
]


@each("bad", BAD_PLACES)
def test_blocked_start_or_goal_is_rejected(bad: Bad) -> None:
    assert_told(bad, alone=False)


WHOLE = """
[corpus]
family = "u_trap"
seed = 7
shortest_path_m = 5.25
reachable = true
"""


def test_world_contains_the_values_of_its_corpus_table() -> None:
    world = loads(more(WHOLE))
    known = (world.family, world.family_seed, world.shortest_path_m, world.reachable)
    assert known == ("u_trap", 7, 5.25, True)


def test_file_without_corpus_table_has_no_values() -> None:
    world = loads(GOOD)
    known = (world.family, world.family_seed, world.shortest_path_m, world.reachable)
    assert known == (None, None, None, None)
    assert known_length_m(world) == shortest_path_m(world)


def test_shortest_path_implies_a_reachable_goal() -> None:
    assert loads(more("[corpus]\nshortest_path_m = 5.25\n")).reachable is True


def test_shortest_path_of_the_file_is_not_recomputed() -> None:
    assert known_length_m(loads(more(WHOLE))) == 5.25
    assert known_length_m(loads(more("[corpus]\nreachable = false\n"))) is None
    assert shortest_once(loads(more(WHOLE))) == 5.25


def test_trial_reports_the_path_length_of_the_file() -> None:
    outcome = run_trial(Trial(world=loads(more(WHOLE)), timeout_s=0.1))
    assert outcome.shortest_path_m == 5.25


BAD_CORPUS_TABLES = [
    Bad("seed below zero", "seed = -1", "21 corpus.seed: out of range -> 0 to"),
    Bad("seed with a fraction", "seed = 1.5", "21 corpus.seed: a whole number -> seed = 1"),
    Bad("seed as text", 'seed = "1"', "21 corpus.seed: found text -> seed = 1"),
    Bad("family as number", "family = 3", "21 corpus.family: expected text -> u_trap"),
    Bad("empty family", 'family = " "', "21 corpus.family: empty -> u_trap"),
    Bad("long family", f'family = "{"f" * 65}"', "21 corpus.family: longer -> u_trap"),
    Bad("path not finite", "shortest_path_m = nan", "21 corpus.shortest_path_m: not finite -> "),
    Bad("negative path", "shortest_path_m = -1", "21 corpus.shortest_path_m: out of range -> "),
    Bad(
        "path shorter than straight",
        "shortest_path_m = 4.7",
        "21 corpus.shortest_path_m: shorter than the straight line of 4.800 m -> remove it",
    ),
    Bad("reachable as text", 'reachable = "no"', "21 corpus.reachable: true or false -> true"),
    Bad("misspelt", "familiy = 'x'", "21 corpus.familiy: unknown key -> did you mean family"),
    Bad("other unit", "shortest_path_cm = 500", "21 corpus.shortest_path_cm: wrong unit -> = 5"),
]


@each("bad", BAD_CORPUS_TABLES)
def test_invalid_corpus_table_is_rejected(bad: Bad) -> None:
    assert_told(bad._replace(text=more(f"[corpus]\n{bad.text}\n")), alone=True)


def test_path_to_an_unreachable_goal_is_rejected() -> None:
    text = more("[corpus]\nshortest_path_m = 5.0\nreachable = false\n")
    (problem,) = refusal(text).problems
    assert (problem.line, problem.key) == (21, "corpus.shortest_path_m")
    assert "unreachable goal" in problem.reason


def test_corpus_value_that_is_no_table_is_rejected() -> None:
    (problem,) = refusal("corpus = 3\n" + GOOD).problems
    assert (problem.line, problem.key) == (1, "corpus")
    assert "expected a table, found a whole number" in problem.reason
