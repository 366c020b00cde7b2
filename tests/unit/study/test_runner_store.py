"""What a study keeps: rows, provenance, scores and settings."""

import errno
import json
import os
import subprocess
from collections.abc import Mapping
from dataclasses import fields, replace
from math import inf, isnan, nan, pi
from pathlib import Path
from shutil import which
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.recording import metadata
from plant.corpus import generate
from plant.model.configuration import Body
from protocol.world import GoalPose, Polyline, Start, World, WorldPolygon
from runtime.cli import compiled
from runtime.errors import UserError
from study.runner import store
from study.runner.rows import ADDED, COLUMNS, ROOT, TrialRow, code, code_digest, machine
from study.runner.run_task import FULL_SCORE, lap_m, published_score, spl
from study.runner.store import (
    FILE,
    SCHEMA,
    check_settings,
    exclusive,
    rows_of,
    settings_of,
    table_of,
    with_added,
)
from tests.support.each import each
from tests.support.plant import plain_world
from tests.support.studies import CODE, boxed, floor, ids, list_of, rows, settings, spoil


def names(directory: Path) -> list[str]:
    return sorted(str(path.relative_to(directory)) for path in directory.rglob("*.parquet*"))


def test_rows_are_read_in_order_of_trial_id(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(3, start=5))
    store.write_shard(tmp_path, rows(2))
    assert [int(name, 16) for name in ids(store.read(tmp_path))] == [0, 1, 5, 6, 7]


def test_duplicate_trial_keeps_the_first_row(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(2, reason="first"))
    store.write_shard(tmp_path, rows(3, reason="second"))
    table = store.read(tmp_path)
    assert table["reason"].to_pylist() == ["first", "first", "second"]


def test_new_shard_never_replaces_another(tmp_path: Path) -> None:
    files = [store.write_shard(tmp_path, rows(1, start=number)) for number in range(3)]
    files[1].unlink()
    assert store.write_shard(tmp_path, rows(1, start=9)).name > files[2].name


def test_compact_keeps_every_row_in_one_file(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(4))
    store.write_shard(tmp_path, rows(4, start=2))
    before = store.read(tmp_path)
    store.compact(tmp_path, before, {"command": "sidestep study"})
    assert names(tmp_path) == [store.RESULTS]
    assert store.read(tmp_path) == before or ids(store.read(tmp_path)) == ids(before)


def test_results_metadata_hold_the_command(tmp_path: Path) -> None:
    file = store.compact(tmp_path, table_of(rows(1)), {"command": "sidestep study --jobs 3"})
    assert pq.read_schema(file).metadata[b"sidestep.command"] == b"sidestep study --jobs 3"


def test_shard_left_by_a_kill_is_not_counted_twice(
    tmp_path: Path,
) -> None:
    shard = store.write_shard(tmp_path, rows(3))
    kept = shard.read_bytes()
    store.compact(tmp_path, store.read(tmp_path), {})
    shard.write_bytes(kept)
    assert len(ids(store.read(tmp_path))) == 3


@pytest.mark.parametrize("content", [b"", b"PAR1", b"no parquet at all", b"\0" * 5000])
def test_unreadable_file_is_reported_with_advice(tmp_path: Path, content: bytes) -> None:
    store.write_shard(tmp_path, rows(2))
    bad = tmp_path / store.SHARDS / "000009.parquet"
    bad.write_bytes(content)
    with pytest.raises(UserError, match=r"000009\.parquet: cannot be read.*run the study again"):
        store.read(tmp_path)
    found = store.find(tmp_path)
    assert [file for file, _ in found.unreadable] == [bad]
    assert len(ids(found.table)) == 2


def test_truncated_shard_does_not_affect_others(tmp_path: Path) -> None:
    spoil(store.write_shard(tmp_path, rows(2)))
    store.write_shard(tmp_path, rows(2, start=2))
    assert len(store.find(tmp_path).unreadable) == 1
    assert len(ids(store.find(tmp_path).table)) == 2


def test_shard_with_other_columns_is_refused(tmp_path: Path) -> None:
    odd = table_of(rows(1)).append_column("mood", pa.array(["good"]))
    (tmp_path / store.SHARDS).mkdir()
    pq.write_table(odd, tmp_path / store.SHARDS / "000001.parquet")
    with pytest.raises(UserError, match=r"other columns.*mood"):
        store.read(tmp_path)


def test_full_disk_keeps_earlier_shards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store.write_shard(tmp_path, rows(2))

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UserError, match=r"No space left on device.*free disk space"):
        store.write_shard(tmp_path, rows(2, start=2))
    assert names(tmp_path) == ["shards/000001.parquet"]
    assert len(ids(store.read(tmp_path))) == 2


def test_set_aside_overwrites_nothing(tmp_path: Path) -> None:
    places = []
    for text in ("one", "two", "three"):
        bad = tmp_path / "000001.parquet"
        bad.write_text(text)
        places.append(store.set_aside(tmp_path, bad))
    assert [place.read_text() for place in places] == ["one", "two", "three"]


@pytest.mark.parametrize("make", [False, True])
def test_directory_without_a_study_is_reported(tmp_path: Path, make: bool) -> None:
    place = tmp_path / "nothing"
    if make:
        place.mkdir()
    with pytest.raises(UserError, match="sidestep study"):
        store.read(place)


FLOATS = st.floats(allow_nan=False) | st.sampled_from([inf, -inf])


def test_columns_are_the_fields_in_order() -> None:
    assert tuple(SCHEMA.names) == COLUMNS == tuple(field.name for field in fields(TrialRow))


def test_only_optional_values_are_nullable() -> None:
    nullable = {field.name for field in SCHEMA if field.nullable}
    assert nullable == {
        *("shortest_path_m", "reachable", "heading_error_rad"),
        *("lap_m", "thinnest_wall_m", "spl", "published_score"),
    }


def test_columns_added_later_have_a_value_for_older_tables() -> None:
    table = table_of(rows(2))
    older = table.drop_columns(list(ADDED))
    assert with_added(older).schema.names == SCHEMA.names
    (first, _) = rows_of(with_added(older))
    assert (first.lap_m, first.spl) == (None, None)
    assert isnan(first.doubt_m)
    assert with_added(table) is table


def test_table_that_lacks_other_columns_is_left_as_it_is() -> None:
    broken = table_of(rows(1)).drop_columns(["seed", "doubt_m"])
    assert with_added(broken) is broken


@given(
    length_m=FLOATS | st.none(),
    error_rad=FLOATS | st.none(),
    reachable=st.booleans() | st.none(),
    x_m=FLOATS,
    seed=st.integers(0, 2**62),
    reason=st.text(),
)
def test_rows_survive_a_round_trip(
    length_m: float | None,
    error_rad: float | None,
    reachable: bool | None,
    x_m: float,
    seed: int,
    reason: str,
) -> None:
    numbers: dict[str, Any] = {field.name: 0.5 for field in SCHEMA if field.type == "double"}
    row = replace(rows(1)[0], **numbers)
    row = replace(row, shortest_path_m=length_m, heading_error_rad=error_rad)
    row = replace(row, reachable=reachable, x_m=x_m, seed=seed, reason=_encodable(reason))
    assert rows_of(table_of([row])) == [row]


def _encodable(text: str) -> str:
    return text.encode("utf-8", "replace").decode()


def test_nan_is_not_stored_as_null() -> None:
    row = replace(rows(1)[0], path_m=nan, heading_error_rad=nan)
    (back,) = rows_of(table_of([row]))
    assert isnan(back.path_m)
    assert back.heading_error_rad is not None
    assert isnan(back.heading_error_rad)


@each("column", ["world", "seed", "dirty", "path_m"])
def test_missing_required_value_is_refused(column: str) -> None:
    missing: dict[str, Any] = {column: None}
    with pytest.raises(ValueError, match=column):
        table_of(rows(1, **missing))


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in (
        "robot/core/brain.py",
        "plant/sim/simulation.py",
        "runtime/calibrations/none.toml",
    ):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(name)
    return tmp_path


@pytest.mark.parametrize(
    "name", ["robot/core/brain.py", "plant/new.py", "runtime/calibrations/none.toml"]
)
def test_digest_covers_files_that_a_trial_runs(tree: Path, name: str) -> None:
    before = code_digest(tree)
    (tree / name).write_text("otherwise")
    assert code_digest(tree) != before


@pytest.mark.parametrize("name", ["README.md", "study/report.py", "plant/worlds_of_others.toml"])
def test_digest_ignores_other_files(tree: Path, name: str) -> None:
    before = code_digest(tree)
    (tree / name).parent.mkdir(exist_ok=True)
    (tree / name).write_text("otherwise")
    assert code_digest(tree) == before


def test_moving_a_line_between_files_changes_the_digest(tree: Path) -> None:
    (tree / "plant/a.py").write_text("x")
    (tree / "plant/b.py").write_text("")
    before = code_digest(tree)
    (tree / "plant/a.py").write_text("")
    (tree / "plant/b.py").write_text("x")
    assert code_digest(tree) != before


@pytest.mark.skipif(which("git") is None, reason="no git on this machine")
def test_commit_is_that_of_the_checkout() -> None:
    answer = subprocess.run(
        ["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    assert code().commit == (answer.stdout.strip() or "unknown")
    assert len(code().digest) == len(CODE.digest) * 32


@pytest.mark.parametrize(
    ("listed", "known", "dirty"),
    [("abc", "abc", False), ("abc+", "abc", True), ("unknown", "unknown", False)],
)
def test_compiled_installation_reports_its_compiled_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listed: str, known: str, dirty: bool
) -> None:
    monkeypatch.setattr(metadata, "ROOT", tmp_path)
    monkeypatch.setattr(compiled, "commit", lambda: listed)
    code.cache_clear()
    try:
        assert (code().commit, code().dirty) == (known, dirty)
    finally:
        code.cache_clear()


def test_machine_info_is_complete() -> None:
    assert "unknown" not in machine()
    assert all(machine())


RADIUS_M = Body().radius_m
RING = Polyline(((4.0, 2.0), (6.0, 2.0), (6.0, 4.0), (4.0, 4.0), (4.0, 2.0)), 0.02)
GROWN_M = RADIUS_M + 0.01


@each(("time_s", "score"), [(10.0, 0.5), (20.0, 0.5), (40.0, 0.25), (80.0, 0.125), (400.0, 0.125)])
def test_published_score_is_clipped_at_2_and_8(time_s: float, score: float) -> None:
    assert published_score(True, time_s, 3.0, 0.3) == pytest.approx(score)


def test_scores_of_failures_are_zero_and_none_without_a_way() -> None:
    assert (published_score(False, 10.0, 3.0, 0.3), spl(False, 3.0, 3.0)) == (0.0, 0.0)
    assert (published_score(True, 10.0, None, 0.3), spl(True, 3.0, None)) == (None, None)


def test_spl_never_exceeds_one() -> None:
    assert spl(True, 6.0, 3.0) == 0.5
    assert spl(True, 2.9, 3.0) == 1.0
    assert spl(True, 0.0, 0.0) == 1.0
    assert published_score(True, 0.1, 0.0, 0.3) == FULL_SCORE


def room(*obstacles: Polyline | WorldPolygon, walls: bool = True) -> World:
    return plain_world("room", (8.0, 6.0), (1.0, 1.0), (5.0, 3.0), *obstacles, walls=walls)


@each("walls", [True, False])
def test_lap_round_a_closed_ring_has_round_corners(walls: bool) -> None:
    assert lap_m(room(RING, walls=walls)) == pytest.approx(8.0 + 2 * pi * GROWN_M, rel=0.005)


def test_lap_inside_a_ring_is_shorter_than_its_wall() -> None:
    caught = replace(room(RING), start=Start(x_m=5.0, y_m=3.0), goal=GoalPose(x_m=1.0, y_m=1.0))
    assert lap_m(caught) == pytest.approx(4 * (2.0 - 2 * GROWN_M), rel=0.01)


def test_islands_do_not_lengthen_the_lap() -> None:
    box = WorldPolygon(((1.5, 3.0), (2.5, 3.0), (2.5, 4.0), (1.5, 4.0)))
    assert lap_m(room(RING, box)) == pytest.approx(lap_m(room(RING)) or 0.0, rel=1e-9)


def test_reachable_goal_has_no_lap() -> None:
    gap = Polyline(((5.2, 2.0), (6.0, 2.0), (6.0, 4.0), (4.0, 4.0), (4.0, 2.0), (4.8, 2.0)), 0.02)
    assert lap_m(room(gap)) is None
    assert lap_m(replace(room(RING), start=Start(x_m=4.0, y_m=2.0))) is None


@each("index", range(4))
def test_every_generated_unreachable_world_has_a_lap(index: int) -> None:
    assert 1.0 < (lap_m(generate("unreachable", index, 3)) or 0.0) < 200.0


WORLDS = list_of(floor(), boxed())


def usual() -> dict[str, Any]:
    return settings_of(WORLDS, settings(), CODE, machine())


def settled(directory: Path, wanted: Mapping[str, Any], *, mixed: bool = False) -> list[str]:
    return check_settings(directory, wanted, CODE, mixed=mixed)


def test_equal_settings_are_accepted(tmp_path: Path) -> None:
    assert settled(tmp_path, usual()) == []
    assert settled(tmp_path, usual()) == []


@each(
    ("changed", "message"),
    [
        ({"seeds": 3}, "seeds was 1, is 3"),
        ({"noise": ["none", "harsh"]}, "noise was none, is none harsh"),
        ({"timeout_s": None}, "timeout_s was 20.0, is null"),
        ({"parameters": {"d_obs_m": 0.4}}, 'parameters was {}, is {"d_obs_m": 0.4}'),
        ({"calibrated": False}, "calibrated was true, is false"),
        ({"code": "d2"}, "other code (it was made at commit c0ffee)"),
        ({"numpy": "9.9"}, "numpy was"),
        ({"worlds": {"floor": "another"}}, "2 worlds were, 1 are (disc, floor)"),
    ],
)
def test_different_settings_are_refused_by_name(
    tmp_path: Path, changed: dict[str, Any], message: str
) -> None:
    settled(tmp_path, usual())
    with pytest.raises(UserError) as refused:
        settled(tmp_path, usual() | changed)
    assert message in str(refused.value)
    assert "--mixed" in str(refused.value)
    assert settled(tmp_path, usual()) == []


def test_mixed_reports_the_difference_once(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    assert settled(tmp_path, usual() | {"seeds": 3}, mixed=True) == ["seeds was 1, is 3"]
    assert settled(tmp_path, usual() | {"seeds": 3}) == []


def test_message_lists_a_few_of_many_worlds(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    many = {f"w{number:02}": "x" for number in range(40)}
    with pytest.raises(UserError, match=r"2 worlds were, 40 are \(disc, floor, w00 and 39 more\)"):
        settled(tmp_path, usual() | {"worlds": many})


@pytest.mark.parametrize("content", ["", "{", "[1]", "\x00"])
def test_unreadable_settings_are_reported_with_advice(tmp_path: Path, content: str) -> None:
    (tmp_path / FILE).write_text(content)
    with pytest.raises(UserError, match=r"settings\.json: .*remove it"):
        settled(tmp_path, usual())


def test_settings_are_stored_with_the_commit(tmp_path: Path) -> None:
    settled(tmp_path, usual())
    assert json.loads((tmp_path / FILE).read_text())["commit"] == "c0ffee"


def test_second_study_in_a_directory_is_refused(tmp_path: Path) -> None:
    with (
        exclusive(tmp_path / "new"),
        pytest.raises(UserError, match="another study is writing there"),
        exclusive(tmp_path / "new"),
    ):
        raise AssertionError("both are in")


def test_lock_is_released_at_the_end(tmp_path: Path) -> None:
    for _ in range(2):
        with exclusive(tmp_path / "new"):
            assert (tmp_path / "new").is_dir()


def test_file_as_output_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(UserError, match=r"--output .*taken"), exclusive(tmp_path / "taken"):
        raise AssertionError("a file is no directory")
