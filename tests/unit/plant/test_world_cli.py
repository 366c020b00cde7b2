"""`sidestep worlds`, and the worlds that come with the program."""

import json
from itertools import combinations
from math import dist
from pathlib import Path

import pytest

from checks.speed.accuracy import PASSAGE_M, grow
from plant.cli import main
from plant.model.configuration import Body
from plant.shortest_path import shortest_path_m
from plant.world.file import SHIPPED_DIR, load, shipped
from plant.world.writer import draw
from protocol.world import WorldCircle
from tests.support.each import each
from tests.support.plant import GOOD, goal, more, with_line


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.toml"
    path.write_text(GOOD, encoding="utf-8")
    return path


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    path = tmp_path / "bad.toml"
    path.write_text(with_line(2, "size_cm = [600, 400]"), encoding="utf-8")
    return path


def test_list_names_and_describes_every_world(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == shipped()
    assert all(line.endswith(".") for line in lines)


def test_list_as_json_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "--json"]) == 0
    assert [one["name"] for one in json.loads(capsys.readouterr().out)["worlds"]] == shipped()


def test_check_accepts_a_valid_file(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(good)]) == 0
    assert f"{good}: ok: test, 4 obstacles, shortest way " in capsys.readouterr().out


def test_check_rejects_an_invalid_file_on_standard_error(
    bad: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("check", "show"):
        assert main([verb, str(bad)]) == 2
        told = capsys.readouterr()
        assert told.out == ""
        assert (
            told.err
            == f"{bad}:2: size_cm: wrong unit; fix: did you mean size_m = [6, 4]? (metres)\n"
        )


def test_check_as_json_lists_each_problem(bad: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(bad), "--json"]) == 2
    found = json.loads(capsys.readouterr().out)
    assert not found["ok"]
    assert [(one["line"], one["key"]) for one in found["problems"]] == [(2, "size_cm")]


def test_check_as_json_reports_success(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(good), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found == {"ok": True, "file": str(good), "name": "test", "problems": []}


def test_show_as_json_uses_the_units_of_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "world.toml"
    path.write_text(more("[robot]\nradius_m = 0.15\n[noise]\nincidence_limit_deg = 40.0\n"))
    assert main(["show", "--json", str(path)]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["start"] == {"x_m": 0.6, "y_m": 2.0, "heading_deg": 90.0}
    assert shown["goal"]["heading_tolerance_deg"] == 3.0
    assert shown["robot"] == {"radius_m": 0.15}
    assert shown["noise"] == {"incidence_limit_deg": 40.0}
    assert shown["obstacles"][1] == {"circle_m": {"x": 4.0, "y": 3.0, "radius": 0.25}}
    assert shown["obstacles"][3]["speed_m_s"] == 0.1
    assert 4.8 <= shown["shortest_path_m"] < 5.0


def test_free_heading_and_missing_path_are_null(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "shut.toml"
    shut = with_line(13, "wall_m = [[4.8, 0.0], [4.8, 4.0]]", goal("{ x_m = 5.4, y_m = 2.0 }"))
    path.write_text(shut)
    assert main(["show", "--json", str(path)]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["goal"]["heading_deg"] is None
    assert shown["shortest_path_m"] is None
    assert main(["check", str(path)]) == 0
    assert "the goal cannot be reached" in capsys.readouterr().out


@each("name", shipped())
def test_map_shows_start_and_goal_in_a_frame(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", name]) == 0
    shown = capsys.readouterr().out.split("\n\n")[0].splitlines()
    floor = [line for line in shown if line.startswith("|")]
    assert len({len(line) for line in floor}) == 1
    assert "".join(floor).count("S") == "".join(floor).count("G") == 1
    assert shown[0] == shown[len(floor) + 1] == "+" + "-" * 72 + "+"


def test_map_is_drawn_with_x_right_and_y_up() -> None:
    rows = draw(load("corridor"), None).splitlines()
    start_row = next(index for index, row in enumerate(rows) if "S" in row)
    goal_row = next(index for index, row in enumerate(rows) if "G" in row)
    assert start_row > goal_row
    assert rows[start_row].index("S") < rows[goal_row].index("G")
    assert "the goal cannot be reached" in rows[-1]


@each("argv", [[], ["frob"], ["check"], ["show"], ["list", "more"], ["show", "box", "--jsn"]])
def test_wrong_usage_exits_with_2(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert "usage: sidestep worlds" in told.err


def test_help_exits_with_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    assert "list|faults|check|show" in capsys.readouterr().out


def test_unknown_world_name_exits_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "bxo"]) == 2
    assert "did you mean box?" in capsys.readouterr().err


def test_show_lists_starts_and_goals_of_several_robots(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "box", "--robots", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["starts"][0] == found["start"]
    assert found["starts"][1] == pytest.approx({"x_m": 0.6, "y_m": 2.6, "heading_deg": 0.0})
    assert [goal["y_m"] for goal in found["goals"]] == pytest.approx([2.0, 2.6])
    assert main(["show", "box", "--robots", "2", "--goal", "1", "-2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["goals"][0] == {"x_m": 1, "y_m": -2, "shifted": True}


@each("robots", ["999", "0"])
def test_show_rejects_more_robots_than_fit(robots: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "box", "--robots", robots, "--json"]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("robots: ")


def test_show_without_robots_has_no_robot_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "box", "--json"]) == 0
    assert not {"starts", "goals"} & json.loads(capsys.readouterr().out).keys()


FORESTS = {"forest_sparse": (15, 1), "forest_medium": (35, 2), "forest_dense": (60, 3)}
FIGURES = ["paper_fig5", "paper_fig7", "paper_fig11", "paper_fig12", "paper_fig13"]
NAMES = [
    *("open", "disc", "box", "corner", "u_trap", "wall", "corridor", "zigzag", "door", "moving"),
    *FORESTS,
    *FIGURES,
]


def test_shipped_worlds_are_listed() -> None:
    assert set(shipped()) == set(NAMES)


def test_paper_figures_are_listed_by_number() -> None:
    assert [name for name in shipped() if name in FIGURES] == FIGURES


@each("name", NAMES)
def test_robot_can_reach_the_goal(name: str) -> None:
    world = load(name)
    length_m = shortest_path_m(world)
    start, goal = world.start, world.goal
    straight_m = dist((start.x_m, start.y_m), (goal.x_m, goal.y_m))
    assert length_m is not None
    assert straight_m - 1e-9 <= length_m < 2.0 * straight_m


@each("name", NAMES)
def test_shipped_file_has_its_world_name_and_description(name: str) -> None:
    opening = (SHIPPED_DIR / f"{name}.toml").read_text(encoding="utf-8").split("\n")[0]
    assert load(name).name == name
    assert opening.startswith("# ")
    assert opening.endswith(".")


@each("name", NAMES)
def test_shipped_worlds_use_the_default_robot_noise_and_faults(name: str) -> None:
    world = load(name)
    assert (world.robot, world.noise, world.faults) == ({}, {}, ())


@each("name", FORESTS)
def test_forest_is_determined_by_its_seed(name: str) -> None:
    world, (count, seed) = load(name), FORESTS[name]
    clearings = ((world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m))
    assert world.obstacles == grow(count, world.size_m, clearings, seed)


@each("name", FORESTS)
def test_robot_fits_between_any_two_trunks(name: str) -> None:
    trunks = [one for one in load(name).obstacles if isinstance(one, WorldCircle)]
    gaps_m = [
        dist((a.x_m, a.y_m), (b.x_m, b.y_m)) - a.radius_m - b.radius_m
        for a, b in combinations(trunks, 2)
    ]
    assert len(trunks) == FORESTS[name][0]
    assert min(gaps_m) >= PASSAGE_M
    assert min(gaps_m) > 2.0 * Body().radius_m


def test_too_many_trunks_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"60 trunks do not fit on 2 x 2 m"):
        grow(60, (2.0, 2.0), (), seed=1)


def test_compared_figures_have_the_same_obstacle() -> None:
    virtual_goal, bug = load("paper_fig11"), load("paper_fig12")
    assert virtual_goal.obstacles == bug.obstacles
    assert (virtual_goal.start, virtual_goal.goal) == (bug.start, bug.goal)


def test_moving_obstacles_are_slower_than_the_robot() -> None:
    walkers = [one for one in load("moving").obstacles if isinstance(one, WorldCircle)]
    assert all(0.0 < walker.speed_m_s <= 0.2 < Body().max_speed_m_s for walker in walkers)
    assert len(walkers) == 3
