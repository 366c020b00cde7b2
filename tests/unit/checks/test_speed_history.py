"""`make speed`: an older commit beside this one, what has moved, and the history."""

import subprocess
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from checks.evidence import FIGURES, RATIOS, CommitHistory
from checks.harness.figures import BenchmarkReport, figure
from checks.site import speed
from checks.site.speed import FigureSpread, SpeedRow, comparison, row_of, tables
from checks.speed import against
from checks.speed.against import compared, in_turn, instructions, missing
from checks.speed.trial_costs import measured, timed


def git(folder: Path, *words: str) -> str:
    identity = ("-c", "user.name=ada", "-c", "user.email=ada@example.org")
    done = subprocess.run(
        ("git", "-C", str(folder), *identity, *words), capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a checkout with two commits."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    git(folder, "init", "--quiet")
    for number in range(2):
        (folder / "file").write_text(str(number))
        git(folder, "add", "file")
        git(folder, "commit", "--quiet", "-m", f"test: commit {number}")
    return folder


def test_commit_in_the_history_is_not_missing(checkout: Path) -> None:
    assert missing(git(checkout, "rev-parse", "HEAD~1"), checkout) == ""


def test_unknown_commit_is_named(checkout: Path) -> None:
    assert missing("1234567", checkout) == "commit 1234567 is not in the history of this checkout"


def test_shallow_clone_and_folder_without_git_are_named(checkout: Path, tmp_path: Path) -> None:
    shallow, old = tmp_path / "shallow", git(checkout, "rev-parse", "HEAD~1")
    git(tmp_path, "clone", "--quiet", "--depth", "1", checkout.as_uri(), str(shallow))
    assert "`git fetch --unshallow` fetches it" in missing(old, shallow)
    bare = tmp_path / "bare"
    bare.mkdir()
    assert "no git checkout" in missing(old, bare)


def test_ratios_are_those_of_neighbours_in_time() -> None:
    costs = {"now": [2.0, 8.0, 2.0], "before": [1.0, 4.0, 2.0], "compiled": [0.5, 2.0, 1.0]}
    figures = {one.name: one.values for one in compared("trial", "us", costs)}
    assert figures == {
        "trial: now / before": (2.0, 2.0, 1.0),
        "trial: least now / least before": (2.0,),
        "trial: pure / compiled": (4.0, 4.0, 2.0),
        "trial: now": (2.0, 8.0, 2.0),
    }


def test_step_of_compiled_modules_that_cannot_be_timed_is_left_out() -> None:
    names = [one.name for one in compared("s", "us", {"now": [1], "before": [1], "compiled": [0]})]
    assert names == ["s: now / before", "s: now"]


def test_jobs_take_turns_in_both_directions() -> None:
    ran: list[str] = []
    jobs = {name: partial(ran.append, name) for name in "ab"}
    assert in_turn(jobs, 2) == {"a": [None] * 2, "b": [None] * 2}
    assert "".join(ran) == "abba"


def test_trial_and_step_are_measured() -> None:
    found = measured("open", "vgm")
    assert 0.0 < found["step_us"] < found["trial_us"]


def test_each_timed_call_adds_its_cost() -> None:
    costs_us: list[float] = []
    run = timed(max, costs_us)
    assert (run(1, 2), run(4, 3)) == (2, 4)
    assert len(costs_us) == 2


def test_instructions_of_a_tick_are_those_of_one_trial_more(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def run(_folder: Path, _navigator: str, trials: int) -> tuple[int, int]:
        return 50, 1_000_000 + 2_000 * trials

    monkeypatch.setattr(against, "cachegrind", run)
    assert instructions(tmp_path, "vgm") == 40.0


BENCHMARK = """
import json, pathlib
count = pathlib.Path("count")
count.write_text(count.read_text() + "x" if count.exists() else "x")
if len(count.read_text()) < {attempts}:
    raise RuntimeError("the robot refused")
print(json.dumps({{"figures": [{{"name": "resident", "median": 40.0}}]}}))
"""


def test_robot_of_a_busy_machine_is_measured_again(tmp_path: Path) -> None:
    (tmp_path / "benchmarks.py").write_text(BENCHMARK.format(attempts=2))
    assert against.robot_cost(tmp_path, 1.0) == {"resident": 40.0}


def test_robot_that_cannot_be_measured_is_named_with_its_error(tmp_path: Path) -> None:
    (tmp_path / "benchmarks.py").write_text(BENCHMARK.format(attempts=99))
    with pytest.raises(RuntimeError, match="4 times: RuntimeError: the robot refused"):
        against.robot_cost(tmp_path, 1.0)


RATIO = "trial: forest_dense, ours / ir-sim"
STEP = "against: trial, vgm: now / before"


def row(
    figures: Mapping[str, FigureSpread], work: float = 100.0, before: str = "old", commit: str = "c"
) -> SpeedRow:
    return SpeedRow("2026-11-28", commit, before, {"cores": 2}, dict(figures), {"trial": work})


def lines(now: SpeedRow, last: SpeedRow | None) -> list[str]:
    return [line for line in comparison(now, last) if line.startswith("  ")]


def test_figure_moves_when_the_spreads_are_apart() -> None:
    last = row({RATIO: FigureSpread(8.0, 7.0, 9.0)})
    for spread, has_moved in (
        (FigureSpread(8.8, 8.0, 9.5), False),
        (FigureSpread(9.5, 9.1, 9.9), True),
        (FigureSpread(6.0, 5.5, 6.9), True),
    ):
        shown, _ = lines(row({RATIO: spread}), last)
        assert shown.endswith("MOVED") == has_moved
        assert "was 8 (7 to 9)" in shown


def test_exact_figure_and_work_move_by_more_than_a_percent() -> None:
    last = row({RATIO: FigureSpread(100.0, 100.0, 100.0)})
    for value, has_moved in ((100.5, False), (102.0, True), (98.0, True)):
        found = lines(row({RATIO: FigureSpread(value, value, value)}, work=value), last)
        assert [line.endswith("MOVED") for line in found] == [has_moved] * 2


def test_ratios_to_different_commits_are_not_compared() -> None:
    spread, other = FigureSpread(1.0, 1.0, 1.0), FigureSpread(2.0, 2.0, 2.0)
    found = lines(row({STEP: other}, before="new"), row({STEP: spread}, before="old"))
    assert "was" not in found[0]


def test_first_measurement_has_nothing_to_compare_with() -> None:
    first = next(comparison(row({}), None))
    assert first == "nothing was committed to compare with"


def report(name: str, **values: float) -> dict[str, Any]:
    figures = tuple(figure(title, value) for title, value in values.items())
    return BenchmarkReport(benchmark=name, figures=figures, machine={"cores": 2}).as_json()


def test_row_has_the_ratios_of_the_history_only() -> None:
    reports = {
        "trial": report("trial", **{"forest_dense, ours / ir-sim": 8.123456, "forest_dense": 1.0})
    }
    made = row_of("c", "old", {"cores": 2}, reports, {})
    assert made.figures == {RATIO: FigureSpread(8.123, 8.123, 8.123)}
    assert made.machine == {"cores": 2}


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return the page of a history on which `make speed` writes played figures."""
    page = tmp_path / "figures.md"
    page.write_text(f"# Figures\n\n{speed.BEGIN}{speed.END}")
    monkeypatch.setattr(speed, "PAGE", page)
    monkeypatch.setattr(speed, "DATA", tmp_path / "speed.json")
    monkeypatch.setattr(speed, "PLOT", tmp_path / "speed.svg")
    monkeypatch.setattr(speed, "missing", lambda _commit, _root: "")
    monkeypatch.setattr(speed, "counted", lambda: {"trial": 100.0})
    monkeypatch.setattr(CommitHistory, "changes_since", lambda _self, _commit: [])
    monkeypatch.setattr(CommitHistory, "head", lambda _self: "abcdef12")
    monkeypatch.setattr(CommitHistory, "_missing", lambda _self: "")

    def measured(arguments: tuple[str, ...]) -> dict[str, Any]:
        if arguments[0] == "against":
            assert arguments[1:] == ("--against", against.BASELINE)
            return report("against", **{"trial, vgm: now / before": 1.25})
        return report(arguments[0], **{"forest_dense, ours / ir-sim": 8.0})

    monkeypatch.setattr(speed, "measured", measured)
    return page


def test_record_appends_a_row_and_completes_that_of_the_same_commit(
    played: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert speed.main(["--record", "trial", "against"]) == 0
    assert "nothing was committed" in capsys.readouterr().out
    assert speed.main(["--record", "trial"]) == 0
    assert "nothing moved beyond noise" in capsys.readouterr().out
    monkeypatch.setattr(CommitHistory, "head", lambda _self: "98765432")
    assert speed.main(["--record", "trial"]) == 0
    assert [one.commit for one in speed.read()] == ["abcdef12", "98765432"]
    text = played.read_text()
    assert text.count("| `abcdef12` |") == text.count("| `98765432` |") == 2
    assert all("load" in one.machine for one in speed.read())
    assert "| 8 | 1.25 |" in text
    assert "abcdef12" in speed.PLOT.read_text()


def test_without_record_nothing_is_written(played: Path) -> None:
    before = played.read_text()
    assert speed.main(["trial"]) == 0
    assert played.read_text() == before
    assert not speed.DATA.exists()


def test_uncommitted_changes_are_not_recorded(
    played: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(CommitHistory, "changes_since", lambda _self, _commit: ["robot/run.py"])
    assert speed.main(["--record"]) == 2
    assert "robot/run.py" in capsys.readouterr().err


def test_missing_commit_is_named_and_the_rest_is_measured(
    played: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(speed, "missing", missing)
    monkeypatch.setattr(speed, "ROOT", played.parent)
    assert speed.main(["--against", "1234567", "against", "trial"]) == 0
    shown = capsys.readouterr()
    assert "no comparison with an older commit: commit 1234567 is not here" in shown.err
    assert "trial / ir-sim" in shown.out


def test_benchmark_that_fails_is_named_and_exits_with_1(
    played: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(speed, "measured", lambda _arguments: None)
    assert speed.main(["trial"]) == 1
    assert "speed: trial could not be measured" in capsys.readouterr().err


def test_missing_figure_is_a_dash_in_the_history() -> None:
    text = tables([row({}), row({RATIO: FigureSpread(8.0, 7.0, 9.0)})])
    assert "| - | - |" in text
    assert "| 8 (7 to 9) | - |" in text


def test_sections_of_the_page_are_those_that_are_measured() -> None:
    assert {*RATIOS} == {*speed.MEASURED} & {*FIGURES}


def test_committed_page_shows_the_committed_history() -> None:
    text = speed.PAGE.read_text(encoding="utf-8")
    assert text.count(speed.BEGIN) == text.count(speed.END) == 1
    if rows := speed.read():
        assert tables(rows) in text
        assert speed.plot(rows).alone() == speed.PLOT.read_text(encoding="utf-8")


def test_script_of_the_trials_runs_alone(tmp_path: Path) -> None:
    done = subprocess.run(
        (sys.executable, "-P", str(against.SCRIPT), "open", "vgm", "1"),
        capture_output=True,
        text=True,
        check=True,
    )
    assert int(done.stdout) > 20
