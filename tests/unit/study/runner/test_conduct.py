"""Rows are written to disk soon, and stored trials are not run again."""

import errno
import os
from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as tuned
from hypothesis import strategies as st

from runtime.errors import UserError
from study.runner import conduct, store
from study.runner.conduct import (
    FLUSH_S,
    MAX_FLUSH_S,
    Collector,
    StudyProgress,
    collect,
    finish,
    missing_tasks,
    recover,
    stored_rows,
)
from study.runner.plan import TrialTask
from study.runner.rows import TrialRow
from tests.support.study.made import Watch, floor, ids, rows, spoil, tasks

MAX_EXAMPLES = max(5, tuned().max_examples // 20)


def gather(directory: Path, coming: Iterator[TrialRow | None], watch: Watch) -> None:
    collect(coming, Collector(directory, watch), StudyProgress(9, 0, StringIO(), watch))


def shards(directory: Path) -> int:
    return len(list((directory / store.SHARDS).glob("*.parquet")))


def test_rows_are_written_at_intervals_and_at_the_end(tmp_path: Path) -> None:
    watch, seen = Watch(), []

    def coming() -> Iterator[TrialRow | None]:
        for row in rows(6):
            seen.append(shards(tmp_path))
            watch.now_s += FLUSH_S * 0.6
            yield row

    gather(tmp_path, coming(), watch)
    assert seen == [0, 0, 1, 1, 2, 2]
    assert len(ids(store.read(tmp_path))) == 6


def test_buffered_rows_are_written_while_idle(tmp_path: Path) -> None:
    watch = Watch()

    def coming() -> Iterator[TrialRow | None]:
        yield rows(1)[0]
        assert shards(tmp_path) == 0
        watch.now_s += MAX_FLUSH_S
        yield None
        assert shards(tmp_path) == 1

    gather(tmp_path, coming(), watch)


@pytest.mark.parametrize("after", [False, True])
def test_interrupted_write_keeps_each_row_once(
    after: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(directory: Path, rows: list[TrialRow]) -> Path:
        monkeypatch.undo()
        if after:
            store.write_shard(directory, rows)
        raise KeyboardInterrupt

    monkeypatch.setattr(conduct, "write_shard", interrupted)
    watch = Watch()

    def coming() -> Iterator[TrialRow | None]:
        for row in rows(2):
            watch.now_s += MAX_FLUSH_S
            yield row

    with pytest.raises(KeyboardInterrupt):
        gather(tmp_path, coming(), watch)
    assert len(ids(store.read(tmp_path))) == 1


def test_write_interval_grows_up_to_its_limit(tmp_path: Path) -> None:
    watch = Watch()
    collector = Collector(tmp_path, watch)
    for row in rows(250):
        watch.now_s += 3.6
        collector.add(row)
        collector.flush_if_due()
    assert 900.0 / MAX_FLUSH_S * 0.8 <= shards(tmp_path) <= 175


@pytest.mark.parametrize("error", [KeyboardInterrupt, UserError, RuntimeError])
def test_rows_are_written_on_any_exception(tmp_path: Path, error: type[BaseException]) -> None:
    def coming() -> Iterator[TrialRow | None]:
        yield from rows(3)
        raise error

    with pytest.raises(error):
        gather(tmp_path, coming(), Watch())
    assert len(ids(store.read(tmp_path))) == 3


def test_full_disk_ends_the_study_and_keeps_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = Watch()

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def coming() -> Iterator[TrialRow | None]:
        for number, row in enumerate(rows(4)):
            watch.now_s += MAX_FLUSH_S
            if number == 3:
                monkeypatch.setattr(os, "fsync", full)
            yield row

    with pytest.raises(UserError, match="No space left"):
        gather(tmp_path, coming(), watch)
    monkeypatch.undo()
    assert len(ids(store.read(tmp_path))) == 3


def numbered(count: int) -> list[TrialTask]:
    (one,) = tasks(floor())
    return [replace(one, trial_id=f"{number:032x}") for number in range(count)]


def test_stored_trials_are_not_run_again(tmp_path: Path) -> None:
    assert missing_tasks(numbered(4), stored_rows(tmp_path)) == numbered(4)
    store.write_shard(tmp_path, rows(2, start=1))
    left = missing_tasks(numbered(4), stored_rows(tmp_path))
    assert [int(task.trial_id, 16) for task in left] == [0, 3]


def test_trials_of_a_damaged_shard_are_missing(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(2))
    bad = store.write_shard(tmp_path, rows(2, start=2))
    spoil(bad)
    messages = list(recover(tmp_path))
    assert len(messages) == 1
    assert str(bad) in messages[0]
    assert "run again" in messages[0]
    left = missing_tasks(numbered(4), stored_rows(tmp_path))
    assert [int(task.trial_id, 16) for task in left] == [2, 3]
    assert list(recover(tmp_path)) == []


def test_damaged_results_are_set_aside(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(2))
    results = finish(tmp_path, {})
    spoil(results)
    assert str(results) in next(recover(tmp_path))
    assert stored_rows(tmp_path) is None
    assert (tmp_path / store.ASIDE / store.RESULTS).exists()


def test_unfinished_files_are_removed(tmp_path: Path) -> None:
    store.write_shard(tmp_path, rows(1))
    left = [
        tmp_path / store.SHARDS / f"000002.parquet{store.UNFINISHED}",
        tmp_path / f"{store.RESULTS}{store.UNFINISHED}",
    ]
    for file in left:
        file.write_bytes(b"half")
    assert list(recover(tmp_path)) == []
    assert not any(file.exists() for file in left)
    assert len(ids(store.read(tmp_path))) == 1


@tuned(
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    max_examples=MAX_EXAMPLES,
    deadline=None,
)
@given(st.lists(st.tuples(st.integers(0, 9), st.integers(1, 4), st.booleans()), max_size=6))
def test_any_interruptions_end_with_each_trial_once(
    tmp_path: Path, calls: list[tuple[int, int, bool]]
) -> None:
    """Write some missing trials per call; damage the last shard of some calls."""
    directory = tmp_path / str(len(list(tmp_path.iterdir())))
    directory.mkdir()
    for _, count, spoilt in calls:
        list(recover(directory))
        left = missing_tasks(numbered(12), stored_rows(directory))
        made = [rows(1, start=int(task.trial_id, 16))[0] for task in left[:count]]
        if made:
            shard = store.write_shard(directory, made)
            if spoilt:
                spoil(shard)
                continue
            finish(directory, {})
    list(recover(directory))
    for row in missing_tasks(numbered(12), stored_rows(directory)):
        store.write_shard(directory, rows(1, start=int(row.trial_id, 16)))
    finish(directory, {})
    assert [int(name, 16) for name in ids(store.read(directory))] == list(range(12))
