"""The command line of `sidestep study`: refusals, runs and continued runs."""

import importlib.util
import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from sidestep.__main__ import main
from study.cli import study as study_cli
from study.cli import study_run
from study.cli.study_run import parser
from study.runner.store import RESULTS, SHARDS, commands_of, read, rows_of, write_shard
from tests.support.each import each
from tests.support.studies import ids, rows, spoil

SMALL = ("--worlds", "open", "--noise", "none", "default", "--navigators", "vgm", "--jobs", "1")


def study(place: Path, *words: str, small: tuple[str, ...] = SMALL) -> int:
    """Run the verb and return its exit code."""
    return main(["study", *small, "--no-report", "--output", str(place), *words])


@pytest.fixture(scope="module")
def finished_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("once") / "s"
    assert study(place) == 0
    return place


@pytest.fixture
def finished(finished_once: Path, tmp_path: Path) -> Path:
    """Return the folder of a finished study."""
    return shutil.copytree(finished_once, tmp_path / "s")


def summary_printed(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


def test_results_contain_their_provenance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert study(tmp_path / "s", "--json") == 0
    summary = summary_printed(capsys)
    assert (summary["trials"], summary["outcomes"]) == (2, {"reached": 2})
    assert 0.0 < summary["cpu_s_per_simulated_h"] < 3600.0
    metadata = pq.read_schema(tmp_path / "s" / RESULTS).metadata
    assert b"sidestep study --worlds open" in metadata[b"sidestep.command"]
    assert json.loads(metadata[b"sidestep.settings"])["noise"] == ["none", "default"]
    assert list((tmp_path / "s" / SHARDS).iterdir()) == []
    assert set(read(tmp_path / "s")["study"].to_pylist()) == {"s"}


def test_repeated_command_runs_nothing(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = read(finished)
    capsys.readouterr()
    assert study(finished, "--json") == 0
    assert summary_printed(capsys)["run_now"] == 0
    assert read(finished).equals(before)


def test_trials_of_a_damaged_shard_are_run_again(
    finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = read(finished)
    (finished / RESULTS).unlink()
    write_shard(finished, rows_of(whole.slice(0, 1)))
    bad = write_shard(finished, rows_of(whole.slice(1, 1)))
    spoil(bad)
    capsys.readouterr()
    assert study(finished, "--json") == 0
    printed = capsys.readouterr()
    assert f"{bad}: cannot be read" in printed.err
    assert json.loads(printed.out)["run_now"] == 1
    assert ids(read(finished)) == ids(whole)
    assert read(finished)["digest"].equals(whole["digest"])


def test_changed_settings_require_mixed(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert study(finished, "--seeds", "2") == 2
    assert "seeds was 1, is 2" in capsys.readouterr().err
    assert study(finished, "--seeds", "2", "--mixed", "--json") == 0
    printed = capsys.readouterr()
    assert "--mixed: continuing although seeds was 1, is 2" in printed.err
    assert json.loads(printed.out)["run_now"] == 1


def test_results_list_each_command_once(finished: Path) -> None:
    for _ in range(2):
        assert study(finished, "--seeds", "2", "--mixed") == 0
    first, second = commands_of(finished).splitlines()
    assert "--mixed" not in first
    assert second.endswith("--seeds 2 --mixed")


@each(
    ("words", "message"),
    [
        (("--navigators", "vmg"), "did you mean 'vgm'"),
        (("--noise", "harch"), "did you mean 'harsh'"),
        (("--worlds", "opne"), "did you mean 'open'"),
        (("--families", "forests"), "no such family: 'forests'"),
        (("--param", "d_ob_m=1"), "--param or the [robot] of world open"),
        (("--param", "d_obs_m=1e9"), "d_obs_m"),
        (("--worlds", "nowhere.toml"), "nowhere.toml"),
    ],
)
def test_unknown_names_are_refused_before_any_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    assert study(tmp_path / "s", *words) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


@each(
    "words",
    [
        ("--seeds", "0"),
        ("--jobs", "-1"),
        ("--timeout", "nan"),
        ("--timeout", "0"),
        ("--param", "d_obs_m=inf"),
        ("--output",),
        ("--unheard-of",),
    ],
)
def test_wrong_usage_is_exit_code_2(tmp_path: Path, words: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as ended:
        study(tmp_path, *words)
    assert ended.value.code == 2


def test_missing_extra_is_reported_with_its_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    there = importlib.util.find_spec

    def find(name: str, package: str | None = None) -> Any:
        return None if name == study_cli.NEEDED else there(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", find)
    assert main(["study", "--quick"]) == 2
    assert "pyarrow missing; pip install 'sidestep[study]'" in capsys.readouterr().err


def test_study_of_a_user_is_judged_by_nobody_elses_figures(tmp_path: Path) -> None:
    assert main(["study", *SMALL, "--output", str(tmp_path)]) == 0
    report = (tmp_path / "report.md").read_text()
    assert "## Verdict" in report
    assert not [words for words in ("Figures to reach", "paper's figures") if words in report]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["figures_to_reach"], summary["claims"]) == ([], [])


def test_ctrl_c_prints_how_to_continue(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object, **_named: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(study_run, "run_tasks", stopped)
    assert study(tmp_path) == 130
    printed = capsys.readouterr().err
    assert "stopped; 0 of 2 trials are in" in printed
    assert f"sidestep study {' '.join(SMALL)}" in printed


def test_failed_trial_is_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:

    monkeypatch.setattr(study_run, "run_tasks", lambda *_, **_named: write_shard(tmp_path, rows(1)))
    assert study(tmp_path) == 1
    assert "1 failed" in capsys.readouterr().out


def test_quick_runs_all_navigators_in_fixed_worlds() -> None:
    options = parser().parse_args(["--quick"])
    made = study_run.prepare(options, ["--quick"])
    assert len(made.worlds) == 38
    assert len(made.tasks) == 38 * 7 * 2
    assert str(made.directory) == "study-quick"
