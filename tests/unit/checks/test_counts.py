"""The counted work of the hot paths: that it is exact, and that more of it fails."""

from collections.abc import Iterator
from math import sqrt
from pathlib import Path

import pytest

from checks.speed import counts
from checks.speed.counts import CountedPath, Work, WorkCounter, compared, core_step, read
from robot.core.perception import sonar_ring


def sums(count: int) -> float:
    total = 0.0
    for number in range(count):
        total += sqrt(number)
    return total


def work_of(count: int) -> Work:
    counter = WorkCounter()
    assert counter.run(sums, count) == sums(count)
    return CountedPath("sums", "run", 1, counter).work


def test_each_bytecode_and_each_c_function_counts() -> None:
    few, many = work_of(10), work_of(20)
    assert few == work_of(10)
    assert many.calls - few.calls == 10
    assert many.bytecodes - few.bytecodes == 10 * (work_of(1).bytecodes - work_of(0).bytecodes)
    assert many.total > many.bytecodes > few.bytecodes > 50


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return an empty table, for one path of ten ticks."""

    def paths() -> Iterator[CountedPath]:
        yield core_step("vgm")

    file = tmp_path / "counts.toml"
    monkeypatch.setattr(counts, "TABLE", file)
    monkeypatch.setattr(counts, "TICKS", 10)
    monkeypatch.setattr(counts, "counted_paths", paths)
    return file


def slow_down(monkeypatch: pytest.MonkeyPatch) -> None:
    update = sonar_ring.update

    def slow_update(*arguments: object) -> None:
        sums(50)
        update(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(sonar_ring, "update", slow_update)


def test_slower_function_of_the_core_fails(
    table: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert counts.main(["--accept"]) == 0
    assert counts.main([]) == 0
    assert "counts:" not in capsys.readouterr().out
    slow_down(monkeypatch)
    assert counts.main([]) == 1
    out = capsys.readouterr().out
    assert "counts: FAILED: core step, vgm: +" in out
    was = read()[counts.VERSION]["core step, vgm"]
    assert f"work, {was.total:.0f} -> " in out
    assert f"`{counts.COMMAND} --accept` accepts" in out


def test_gain_passes_with_a_line_that_asks_to_commit_it(
    table: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with monkeypatch.context() as slowed:
        slow_down(slowed)
        counts.main(["--accept"])
    assert counts.main([]) == 0
    assert "counts: core step, vgm: -" in capsys.readouterr().out


def test_functions_with_the_most_bytecodes_are_shown(
    table: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    slow_down(monkeypatch)
    monkeypatch.setattr(counts, "VERSION", "3.0")
    counts.main(["--accept", "--functions", "3"])
    assert "sums (checks/test_counts.py:" in capsys.readouterr().out


def test_other_python_is_named_and_its_figures_are_added(
    table: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    counts.main(["--accept"])
    mine = read()
    monkeypatch.setattr(counts, "VERSION", "3.0")
    capsys.readouterr()
    assert counts.main([]) == 0
    assert "counts: not counted for Python 3.0" in capsys.readouterr().out
    assert counts.main(["--accept"]) == 0
    assert read() == {"3.0": next(iter(mine.values())), **mine}


def test_change_within_the_tolerance_is_neither_worse_nor_better() -> None:
    accepted = {"a": Work(1000.0, 0.0), "b": Work(500.0, 100.0)}
    for share in (0.98, 1.0, 1.02):
        found = {name: Work(*(share * one for one in work)) for name, work in accepted.items()}
        assert compared(found, accepted) == ([], [])


def test_path_that_is_new_or_gone_fails() -> None:
    work = Work(1.0, 0.0)
    worse, better = compared({"a": work, "b": work}, {"b": work, "c": work})
    assert [line.partition(":")[0] for line in worse] == ["a", "c"]
    assert better == []


def test_committed_figures_are_of_the_same_paths_in_each_python() -> None:
    tables = read()
    assert len({frozenset(paths) for paths in tables.values()}) == 1
    assert {version.split(".")[0] for version in tables} == {"3"}
