"""The store: shards are whole or not there, each trial is there once, nothing written is lost."""

import errno
import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from runtime.errors import UserError
from study.runner import store
from study.runner.rows import table_of
from tests.support.study.made import ids, rows, spoil


def names(directory: Path) -> list[str]:
    return sorted(str(path.relative_to(directory)) for path in directory.rglob("*.parquet*"))


def test_what_was_written_is_read_in_the_order_of_the_trials(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(3, start=5))
    store.write_shard(tmp_path, rows(2))
    assert [int(name, 16) for name in ids(store.read(tmp_path))] == [0, 1, 5, 6, 7]


def test_a_trial_that_is_there_twice_counts_once_and_as_it_was_first(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(2, reason="first"))
    store.write_shard(tmp_path, rows(3, reason="second"))
    table = store.read(tmp_path)
    assert table["reason"].to_pylist() == ["first", "first", "second"]


def test_shards_never_take_the_place_of_one_that_is_there(tmp_path: Path) -> None:
    files = [store.write_shard(tmp_path, rows(1, start=number)) for number in range(3)]
    files[1].unlink()
    assert store.write_shard(tmp_path, rows(1, start=9)).name > files[2].name


def test_compacting_keeps_every_row_and_leaves_one_file(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(4))
    store.write_shard(tmp_path, rows(4, start=2))
    before = store.read(tmp_path)
    store.compact(tmp_path, before, {"command": "sidestep study"})
    assert names(tmp_path) == [store.RESULTS]
    assert store.read(tmp_path) == before or ids(store.read(tmp_path)) == ids(before)


def test_results_say_in_their_own_metadata_what_made_them(tmp_path: Path) -> None:
    file = store.compact(tmp_path, table_of(rows(1)), {"command": "sidestep study --jobs 3"})
    assert pq.read_schema(file).metadata[b"sidestep.command"] == b"sidestep study --jobs 3"


def test_killed_between_results_and_the_removal_of_shards_counts_nothing_twice(
    tmp_path: Path,
) -> None:
    shard = store.write_shard(tmp_path, rows(3))
    kept = shard.read_bytes()
    store.compact(tmp_path, store.read(tmp_path), {})
    shard.write_bytes(kept)
    assert len(ids(store.read(tmp_path))) == 3


@pytest.mark.parametrize("content", [b"", b"PAR1", b"no parquet at all", b"\0" * 5000])
def test_a_file_that_is_no_parquet_is_named_with_what_to_do(tmp_path: Path, content: bytes) -> None:
    store.write_shard(tmp_path, rows(2))
    bad = tmp_path / store.SHARDS / "000009.parquet"
    bad.write_bytes(content)
    with pytest.raises(UserError, match=r"000009\.parquet: cannot be read.*run the study again"):
        store.read(tmp_path)
    found = store.find(tmp_path)
    assert [file for file, _ in found.unreadable] == [bad]
    assert len(ids(found.table)) == 2


def test_a_truncated_shard_is_unreadable_and_the_others_are_not(tmp_path: Path) -> None:
    spoil(store.write_shard(tmp_path, rows(2)))
    store.write_shard(tmp_path, rows(2, start=2))
    assert len(store.find(tmp_path).unreadable) == 1
    assert len(ids(store.find(tmp_path).table)) == 2


def test_a_shard_with_other_columns_is_named_with_them(tmp_path: Path) -> None:
    odd = table_of(rows(1)).append_column("mood", pa.array(["good"]))
    (tmp_path / store.SHARDS).mkdir()
    pq.write_table(odd, tmp_path / store.SHARDS / "000001.parquet")
    with pytest.raises(UserError, match=r"other columns.*mood"):
        store.read(tmp_path)


def test_a_full_disk_is_told_and_leaves_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.write_shard(tmp_path, rows(2))

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UserError, match=r"No space left on device.*make room"):
        store.write_shard(tmp_path, rows(2, start=2))
    assert names(tmp_path) == ["shards/000001.parquet"]
    assert len(ids(store.read(tmp_path))) == 2


def test_what_is_set_aside_takes_nothing_elses_place(tmp_path: Path) -> None:
    places = []
    for text in ("one", "two", "three"):
        bad = tmp_path / "000001.parquet"
        bad.write_text(text)
        places.append(store.set_aside(tmp_path, bad))
    assert [place.read_text() for place in places] == ["one", "two", "three"]


@pytest.mark.parametrize("make", [False, True])
def test_a_place_without_a_study_says_how_to_make_one(tmp_path: Path, make: bool) -> None:
    place = tmp_path / "nothing"
    if make:
        place.mkdir()
    with pytest.raises(UserError, match="sidestep study"):
        store.read(place)
