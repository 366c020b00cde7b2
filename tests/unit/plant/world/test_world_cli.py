import json
from pathlib import Path

import pytest

from plant.cli import main
from plant.world.file import load, shipped
from plant.world.writer import draw
from tests.support.each import each
from tests.support.plant.world_texts import GOOD, goal, more, with_line


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
