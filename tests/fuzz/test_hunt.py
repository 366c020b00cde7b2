"""The hunt finds errors, endless loops, excessive memory and dead processes."""

import argparse
import os
from collections.abc import Callable
from math import inf
from pathlib import Path

import pytest

from checks.fuzz import hunt as fuzz
from checks.fuzz import hunt as fuzz_hunt
from checks.fuzz.hunt import (
    TARGETS,
    Block,
    FuzzFinding,
    FuzzTally,
    hunt,
    keep,
    report_of,
    share_out,
)
from checks.fuzz.target import FuzzTarget
from runtime.errors import RemoteError, UserError


def of(run: Callable[[bytes, Path], object], weight: int = 20) -> FuzzTarget:
    return FuzzTarget(name="made", samples=lambda: [b"[1, 22, 333]"], run=run, weight=weight)


def hunt_blocks(monkeypatch: pytest.MonkeyPatch, target: FuzzTarget, inputs: int = 3) -> FuzzTally:
    monkeypatch.setattr(fuzz_hunt, "TARGETS", {target.name: target})
    monkeypatch.setattr(fuzz_hunt, "LONGEST_S", 0.05)
    return hunt(target.name, 1, 0, inputs)


def endless(_data: bytes, _folder: Path) -> None:
    while True:
        pass


def refuse(_data: bytes, _folder: Path) -> None:
    raise RemoteError("no")


def divide(data: bytes, _folder: Path) -> float:
    return 1 / data.count(b"never there")


def grow(_data: bytes, _folder: Path) -> int:
    return len(bytearray(400_000_000))


def test_unexpected_error_is_found_with_input_and_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tally = hunt_blocks(monkeypatch, of(divide))
    assert (tally.inputs, tally.accepted, len(tally.finds)) == (3, 0, 3)
    find = tally.finds[0]
    assert find.data == b"[1, 22, 333]"
    assert "ZeroDivisionError" in find.what
    assert find.where.startswith("tests/fuzz/test_hunt.py:")


def test_endless_loop_is_ended_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    tally = hunt_blocks(monkeypatch, of(endless), inputs=1)
    assert tally.finds[0].what.startswith("hangs")


def test_excessive_memory_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz_hunt, "MOST_MB", -1.0)
    assert hunt_blocks(monkeypatch, of(grow), inputs=1).finds[0].where == "memory"


def test_refusal_is_no_finding_and_accepted_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    assert hunt_blocks(monkeypatch, of(refuse)).finds == []
    taken = hunt_blocks(monkeypatch, of(lambda data, _: data))
    assert (taken.accepted, taken.finds) == (3, [])


def die(*_: object) -> None:
    os._exit(3)


def test_dead_process_is_a_finding_and_hunt_continues(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(fuzz, "hunt", die)
    tallies = fuzz.hunt_blocks(iter([Block("frame", 1, 0, 5), Block("frame", 1, 5, 9)]), 1, inf)
    assert [one.finds[0].what for one in tallies] == ["the process died"] * 2
    assert tallies[0].finds[0].where == "inputs 0 to 5"


def test_inputs_are_shared_by_weight_and_none_twice() -> None:
    light, heavy = of(refuse, weight=10), TARGETS["frame"]
    seen = list(share_out([light, heavy], 3100, seed=1))
    for name, count in (("made", 100), ("frame", 3000)):
        mine = [block for block in seen if block.name == name]
        assert sum(block.end - block.begin for block in mine) == count
        assert [block.begin for block in mine[1:]] == [block.end for block in mine[:-1]]


def test_one_input_per_defect_is_kept_and_reproducible(
    tmp_path: Path,
) -> None:
    finds = [
        FuzzFinding("world", 7, "KeyError", "a.py:1", b"x = 1"),
        FuzzFinding("world", 9, "Key", "a.py:1", b"y"),
    ]
    keep(finds, tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["world-7"]
    parser = argparse.ArgumentParser()
    fuzz.add_options(parser)
    report = fuzz.measure(parser.parse_args(["--again", str(tmp_path / "world-7")]))
    assert report.figures[0].median == 0.0, "refused, as it should be"
    with pytest.raises(UserError, match="expected a name TARGET-NUMBER"):
        fuzz.run_again(tmp_path / "something")


def test_report_lists_each_defect_with_its_count() -> None:
    finds = [FuzzFinding("world", n, "KeyError: 'a'", "a.py:1 KeyError", b"") for n in (4, 8)]
    report = report_of([FuzzTally("world", inputs=10, accepted=2, finds=finds)], finds, 10)
    assert not report.met
    assert "FOUND 2 x world 4: a.py:1 KeyError: KeyError: 'a'" in report.notes
