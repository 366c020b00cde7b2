"""The fuzzer: decoders that only refuse, inputs it has found, and the hunt."""

import argparse
import os
from collections.abc import Callable
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checks.fuzz import hunt as fuzz
from checks.fuzz import hunt as fuzz_hunt
from checks.fuzz.hunt import (
    TARGETS,
    Block,
    FuzzFinding,
    FuzzTally,
    hunt,
    keep,
    limited,
    report_of,
    share_out,
    watch,
)
from checks.fuzz.target import FuzzTarget
from checks.fuzz.wire import TICK_MESSAGES, bomb, packed
from protocol.wire.messages import PlanarOdometry
from runtime.errors import RemoteError, UserError
from tests.support.each import each

FEW = settings().max_examples // 10
BEYOND = 10_000
"""The number of an input that is a mutation."""

every_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)


def try_input(target: FuzzTarget, data: bytes) -> bool:
    with TemporaryDirectory() as folder, watch(), limited(10.0):
        return target.accepts(data, Path(folder))


@each("target", TARGETS.values())
def test_good_samples_are_accepted(target: FuzzTarget) -> None:
    assert [try_input(target, sample) for sample in target.good].count(False) == 0
    assert target.good


@every_target
@settings(max_examples=FEW, deadline=None)
@given(data=st.binary(max_size=300))
def test_random_bytes_only_cause_refusals(target: FuzzTarget, data: bytes) -> None:
    try_input(target, data)


@every_target
@settings(max_examples=FEW, deadline=None)
@given(seed=st.integers(0, 1 << 32))
def test_mutated_samples_only_cause_refusals(target: FuzzTarget, seed: int) -> None:
    try_input(target, target.input(seed, BEYOND))


def test_same_seed_and_number_give_the_same_input() -> None:
    for target in TARGETS.values():
        assert target.input(3, BEYOND) == target.input(3, BEYOND)
    world = TARGETS["world"]
    assert len({world.input(3, BEYOND + number) for number in range(50)}) > 40


def test_short_hunt_finds_nothing() -> None:
    parser = argparse.ArgumentParser()
    fuzz.add_options(parser)
    report = fuzz.measure(parser.parse_args(["--inputs", "40", "--jobs", "1"]))
    assert report.met, report.text()
    assert report.figures[0].median >= 40


DOTTED = b"a" + b".a" * 60_000 + b" = 1"
LONG = b"[parameters]\nd_obs_m = " + b"9" * 5000
HUGE = b"[parameters]\nd_obs_m = 0x" + b"f" * 400
PLAN = b"""{"fileType": "Plan", "mission": {"plannedHomePosition": [48.1, 11.5, 0], "items": []},
"geoFence": {"circles": [{"inclusion": true, "circle": {"center": [1e308, 1], "radius": 1}}]}}"""
ROUND = b"[fence]\ncorners = [" + b", ".join(b"[%d, %d]" % (n, n * n) for n in range(400)) + b"]"

HEADLESS = msgspec.structs.replace(
    next(one for one in TICK_MESSAGES if isinstance(one, PlanarOdometry)), heading_rad=float("nan")
)

FOUND = {
    "a key of sixty thousand parts in a world": ("world", DOTTED),
    "the same in a mission": ("mission_toml", DOTTED),
    "the same in a configuration": ("settings", DOTTED),
    "a configuration that is deep": ("settings", b"a = " + b"[" * 100_000),
    "a number too long to be read": ("settings", LONG),
    "a number too large for a float": ("parameter_file", HUGE),
    "a number too long in a mission": ("mission_toml", b"a = " + b"9" * 5000),
    "a fence of very many corners": ("fence", ROUND),
    "a fence beyond the Earth": ("mission_plan", PLAN),
    "saved parameters that are deep": ("stored_parameters", b"[" * 100_000),
    "saved parameters too large for a float": (
        "stored_parameters",
        b'{"d_obs_m": ' + b"9" * 4000 + b"}",
    ),
    "a list of parameters that is deep": ("parameter_list", b"[" * 100_000),
    "a deeply nested world of the plant": ("world_facts", b'{"a":' * 100_000),
    "settings of a study that are deep": ("study_settings", b"[" * 100_000),
    "rows of a study with a name that is no text": (
        "study_rows",
        TARGETS["study_rows"].good[0].replace(b"noise", b"n\xffise"),
    ),
    "a number with what is no blank before it": (
        "scenarios",
        b"version 1\n0\tworld.map\t\x1e16\t12\t1\t1\t9\t8\t11.2\n",
    ),
    "an origin that is no address": (
        "door",
        b"/ws\nCookie: sidestep_8765=abcdefgh0123456789\nOrigin: http://[\n",
    ),
    "a robot with a heading that is no number": ("recording", packed(HEADLESS, after=1)),
    "a table of truth values two bytes wide": (
        "barn_grid",
        TARGETS["barn_grid"].good[2].replace(b"|b1", b"|b2"),
    ),
    "a port of very many digits": ("web_address", b"127.0.0.1:" + b"9" * 6600),
    "settings of a study whose worlds are a text": ("study_settings", b'{"worlds": "box"}'),
    "a port in non-ASCII digits": ("web_address", "127.0.0.1:8²".encode()),
    "a kilobyte that unpacks to a gigabyte": ("mcap", bomb(1 << 30, 9)),
    "a chunk that announces an exabyte": ("mcap", bomb(1 << 20, 9, announced=1 << 60)),
}


@pytest.mark.parametrize("found", FOUND.values(), ids=FOUND)
def test_input_is_refused_or_accepted_in_time(found: tuple[str, bytes], tmp_path: Path) -> None:
    name, data = found
    with watch(), limited(5.0):
        TARGETS[name].accepts(data, tmp_path)


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
    assert find.where.startswith("tests/unit/checks/test_fuzz.py:")


def test_endless_loop_is_ended_and_found(monkeypatch: pytest.MonkeyPatch) -> None:
    tally = hunt_blocks(monkeypatch, of(endless), inputs=1)
    assert tally.finds[0].what.startswith("hangs")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_endless_loop_is_found_although_an_alarm_came_in_a_finalizer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Endless:
        def __del__(self) -> None:
            endless(b"", Path())

    def run(data: bytes, folder: Path) -> None:
        Endless()
        end_s = process_time() + 1.0
        while process_time() < end_s:
            pass

    tally = hunt_blocks(monkeypatch, of(run), inputs=1)
    assert [find.what[:5] for find in tally.finds] == ["hangs"]


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
