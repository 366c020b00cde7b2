"""`export` from the command line: inputs, tables, and refusals."""

import builtins
import csv
import io
import json
from collections.abc import Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from ground.cli.main import main
from tests.support.ground.recording.made import PublishedFrame, mcap, run, tlog


@pytest.fixture
def frames() -> list[PublishedFrame]:
    return list(run(20))


@pytest.fixture
def log(tmp_path: Path, frames: list[PublishedFrame]) -> str:
    return str(mcap(tmp_path / "a.mcap", frames))


def rows_of(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text)))


def test_both_files_of_a_run_give_the_same_table(
    tmp_path: Path, frames: list[PublishedFrame], log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", log]) == 0
    from_mcap = capsys.readouterr().out
    assert main(["export", str(tlog(tmp_path / "a.tlog", frames))]) == 0
    assert capsys.readouterr().out == from_mcap
    assert from_mcap.startswith("time_s,utc_s,topic,message,field,value\n")


def test_wide_csv_comes_back_as_it_was(tmp_path: Path, log: str) -> None:
    out = tmp_path / "wide.csv"
    words = ["--shape", "wide", "--rate", "10", "--from", "0.2", "--to", "0.6", "--out", str(out)]
    assert main(["export", log, *words]) == 0
    head, *rows = rows_of(out.read_text())
    assert [row[0] for row in rows] == [f"0.{n}00000" for n in range(2, 7)]
    assert {len(row) for row in rows} == {len(head)}
    x_m = head.index("tlm/odometry.x_m")
    assert [row[x_m] for row in rows] == ["0.6", "0.6", "0.6", "0.6", "0.625"]


@pytest.mark.parametrize("shape", ["long", "wide"])
def test_parquet_holds_what_the_csv_holds(tmp_path: Path, log: str, shape: str) -> None:
    text, table = tmp_path / "a.csv", tmp_path / "a.parquet"
    assert main(["export", log, "--shape", shape, "--out", str(text)]) == 0
    words = ["--shape", shape, "--format", "parquet", "--out", str(table)]
    assert main(["export", log, *words]) == 0
    head, *rows = rows_of(text.read_text())
    found = pyarrow.parquet.read_table(table).to_pylist()
    assert len(found) == len(rows)
    for row, values in zip(rows, found, strict=True):
        assert list(values) == head
        assert all(map(same, row, values.values()))


def same(text: str, value: object) -> bool:
    if value is None:
        return text == ""
    if isinstance(value, float):
        return float(text) == value or (isnan(value) and text == "nan")
    return text == str(value)


def test_a_damaged_file_gives_what_is_left_and_ends_with_1(
    tmp_path: Path, log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Path(log).read_bytes()
    Path(log).write_bytes(whole[: len(whole) // 3])
    assert main(["export", log, "--out", str(tmp_path / "t.csv"), "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["rows"] > 0
    assert printed["lost_bytes"] > 0
    assert "skipped" in printed["damage"]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--format", "parquet"], "add --out"),
        (["--json"], "add --out"),
        (["--rate", "10"], "needs --shape wide"),
        (["--shape", "wide", "--rate", "0"], "out of range"),
        (["--shape", "wide", "--rate", "1e9"], "out of range"),
        (["--from", "3", "--to", "2"], "is after"),
        (["--out", "/proc/none/a.csv"], "No such file"),
    ],
)
def test_what_does_not_go_together_is_refused_with_the_reason(
    log: str, words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", log, *words]) == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize("linked", [False, True])
def test_a_recording_is_not_overwritten_by_its_table(
    tmp_path: Path, log: str, linked: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    out, before = Path(log), Path(log).read_bytes()
    if linked:
        out = tmp_path / "table.csv"
        out.symlink_to(log)
    assert main(["export", log, "--out", str(out)]) == 2
    assert "is the recording itself" in capsys.readouterr().err
    assert Path(log).read_bytes() == before


def test_missing_pyarrow_names_the_package(
    log: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real_import = builtins.__import__

    def without(
        name: str,
        globals_: Mapping[str, object] | None = None,
        locals_: Mapping[str, object] | None = None,
        fromlist: Sequence[str] = (),
        level: int = 0,
    ) -> Any:
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return real_import(name, globals_, locals_, fromlist, level)

    monkeypatch.setattr(builtins, "__import__", without)
    assert main(["export", log, "--format", "parquet", "--out", "x.parquet"]) == 2
    assert "pip install 'sidestep[study]'" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "nowhere.tlog"]) == 2
    assert "nowhere.tlog: No such file" in capsys.readouterr().err


def test_empty_recording_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = tmp_path / "empty.tlog"
    empty.touch()
    assert main(["export", str(empty)]) == 1
    assert (
        "0 frames, 0 rows: the recording is empty; `sidestep rec list`" in capsys.readouterr().err
    )
