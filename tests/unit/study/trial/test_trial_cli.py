"""The output, exit codes and refusals of `sidestep trial`."""

import csv
import json
from math import pi
from pathlib import Path

import pytest

from ground.cli import main as ground_cli
from plant.model.errors import WorldError
from plant.world.file import load
from robot.core.parameters import DEFAULTS
from runtime.errors import UserError
from sidestep import main as sidestep
from study.cli.trial import COLUMNS, main, parser
from study.trial.trial import NAVIGATORS, Trial

WORLD = """
name = "near"
size_m = [3.0, 2.0]
start = { x_m = 0.6, y_m = 1.0 }
goal = { x_m = 1.4, y_m = 1.0, heading_deg = 0.0 }
"""


@pytest.fixture
def near(tmp_path: Path) -> str:
    path = tmp_path / "near.toml"
    path.write_text(WORLD, encoding="utf-8")
    return str(path)


def test_json_prints_one_object(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--json"]) == 0
    printed = capsys.readouterr()
    outcome = json.loads(printed.out)
    assert (outcome["world"], outcome["outcome"], outcome["noise"]) == (
        "near",
        "reached",
        "default",
    )
    assert printed.err == ""


def test_outcome_is_printed_as_text(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--navigator", "bug", "--noise", "none"]) == 0
    assert "reached the goal of near with bug in " in capsys.readouterr().out


def test_all_verbs_default_to_the_robots_navigator() -> None:
    usual = "vgm_memory"
    assert NAVIGATORS[usual] == DEFAULTS.navigator
    assert ground_cli.parse(["up"]).navigator == usual
    assert parser().parse_args([]).navigator == usual
    assert Trial(world=load("box")).navigator == usual


def test_all_verbs_default_to_the_same_world() -> None:
    assert parser().parse_args([]).world == ground_cli.parse(["up"]).world == "box"


def test_goal_not_reached_is_exit_code_1(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--timeout", "0.5", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["outcome"] == "timeout"


def test_param_option_changes_the_trial(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["--world", near, "--json"])
    usual = json.loads(capsys.readouterr().out)
    main(["--world", near, "--json", "--param", "v_max_m_s=0.1"])
    assert json.loads(capsys.readouterr().out)["time_s"] > 1.5 * usual["time_s"]


@pytest.mark.parametrize("word", ["v_maxx=1", "v_max_m_s=99"])
def test_invalid_param_option_is_a_user_error(near: str, word: str) -> None:
    with pytest.raises(UserError, match=word.partition("=")[0]):
        main(["--world", near, "--param", word])


@pytest.mark.parametrize(
    "more",
    [
        ["--navigator", "vfh"],
        ["--noise", "loud"],
        ["--side", "up"],
        ["--seed", "-1"],
        ["--timeout", "0"],
        ["--timeout", "nan"],
        ["--timeout", "inf"],
        ["--start", "1", "1"],
        ["--start", "nan", "1", "0"],
        ["--goal", "inf", "1"],
        ["--at", "-1"],
        ["--at", "nan"],
        ["--at", "1e9"],
        ["--param", "v_max_m_s"],
        ["--param", "v_max_m_s=inf"],
        ["--param", "v_max_m_s=fast"],
        ["--nonsense"],
    ],
)
def test_wrong_usage_is_exit_code_2(near: str, more: list[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["--world", near, *more])
    assert refused.value.code == 2


def test_world_errors_are_passed_on(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(WORLD.replace("x_m = 0.6", "x_cm = 60"), encoding="utf-8")
    with pytest.raises(WorldError, match=r"bad\.toml"):
        main(["--world", str(path)])


def test_board_has_no_navigator_for_studies_only(near: str) -> None:
    with pytest.raises(UserError, match="oracle_grid is for studies only"):
        main(["--world", near, "--navigator", "oracle_grid", "--mcu"])


def test_navigator_for_studies_only_drives_a_trial(near: str) -> None:
    assert main(["--world", near, "--navigator", "oracle_grid", "--noise", "none"]) == 0


def test_refusal_is_one_line_and_exit_code_2(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert sidestep(["trial", "--world", "nowhere"]) == 2
    assert sidestep(["trial", "--world", near, "--param", "v_maxx=1"]) == 2
    assert sidestep(["trial", "--world", near, "--trace", "/nowhere/at/all.csv"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 3
    assert "v_maxx" in printed.err


def test_trace_has_a_line_per_tick(
    near: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trace.csv"
    assert main(["--world", near, "--json", "--trace", str(path)]) == 0
    outcome = json.loads(capsys.readouterr().out)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == outcome["ticks"] + 1
    assert [float(rows[k]["time_s"]) for k in (0, 1, 2)] == [0.0, 0.05, 0.1]
    assert abs(float(rows[-1]["true_x_m"]) - 1.4) < 0.1
    assert abs(float(rows[-1]["x_m"]) - 1.4) < 0.06
    assert float(rows[-1]["cov_hh_rad2"]) > 0.0
    assert all(None not in row.values() for row in rows)


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(text.splitlines()))


def test_trace_on_stdout_precedes_the_outcome(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--world", near, "--json", "--trace", "-"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert len(lines) == json.loads(last)["ticks"] + 2
    assert rows_of("\n".join(lines))[0]["time_s"] == "0.0"


def test_start_goal_and_time_options_override_the_world(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--start", "2.4", "1.4", "180", "--goal", "0.5", "0.5", "--at", "7.5"]
    assert main(["--world", near, "--json", "--trace", "-", "--noise", "none", *words]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    first, outcome = rows_of("\n".join(lines))[0], json.loads(last)
    assert (first["true_x_m"], first["true_y_m"]) == ("2.4", "1.4")
    assert first["time_s"] == "7.5"
    assert float(first["true_heading_rad"]) == pytest.approx(pi)
    assert outcome["ticks"] == pytest.approx(outcome["time_s"] * 20)
    assert outcome["heading_error_rad"] is None
    assert outcome["shortest_path_m"] is None
    assert outcome["position_error_m"] < 0.06


def test_explicit_defaults_do_not_change_the_digest(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["--world", near, "--json"])
    usual = json.loads(capsys.readouterr().out)
    words = ["--start", "0.6", "1", "0", "--goal", "1.4", "1", "0", "--at", "0"]
    main(["--world", near, "--json", *words])
    assert json.loads(capsys.readouterr().out)["digest"] == usual["digest"]


def test_timeout_counts_from_the_start(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--world", near, "--json", "--at", "60", "--timeout", "0.5"]) == 1
    outcome = json.loads(capsys.readouterr().out)
    assert (outcome["outcome"], outcome["time_s"], outcome["ticks"]) == ("timeout", 0.5, 10)


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        (["--start", "9", "1", "0"], "outside"),
        (["--start", "0.05", "1", "0"], "the outer wall"),
        (["--start", "1", "1", "361"], "--start: heading"),
        (["--goal", "1"], "not 1 numbers"),
        (["--goal", "1", "1", "0", "0"], "not 4 numbers"),
        (["--goal", "1", "1", "-400"], "--goal: heading"),
        (["--goal", "-1e3", "1"], "outside"),
    ],
)
def test_invalid_start_or_goal_is_refused_with_reason(
    near: str, words: list[str], printed: str
) -> None:
    with pytest.raises(UserError, match=printed):
        main(["--world", near, *words])
