"""Shards are complete or absent, each trial is read once, and nothing written is lost."""

import errno
import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from runtime.errors import UserError
from study.runner import store
from study.runner.store import table_of
from tests.support.study.made import ids, rows, spoil


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
