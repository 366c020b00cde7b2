"""The runner: worker processes, tasks, rows on disk, and progress."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from io import StringIO
from math import isnan, nan
from pathlib import Path
from signal import SIGINT, SIGTERM
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as tuned
from hypothesis import strategies as st

from protocol.outcome import doubt_m
from protocol.wire.enums import GoalState
from protocol.world import WALL_THICKNESS_M, Polyline, World
from robot.core import states
from robot.core.parameters import DEFAULTS
from runtime.errors import UserError
from study.runner import conduct, store
from study.runner import workers as pools
from study.runner.conduct import (
    FLUSH_S,
    MAX_FLUSH_S,
    Collector,
    StudyProgress,
    collect,
    duration_text,
    finish,
    missing_tasks,
    recover,
    stored_rows,
)
from study.runner.plan import TrialTask
from study.runner.rows import FAILED, TrialRow, machine
from study.runner.run_task import (
    StudyContext,
    failed,
    lap_m,
    mahalanobis2,
    published_score,
    row_of,
    trial_of,
)
from study.runner.store import rows_of, table_of
from study.runner.workers import Pool, dask_address
from study.trial.trial import run_trial
from tests.support.each import each
from tests.support.studies import (
    CODE,
    Watch,
    boxed,
    context_of,
    deadly,
    faulty,
    floor,
    ids,
    rows,
    spoil,
    tasks,
)

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


def run(jobs: int, made: Sequence[TrialTask], *worlds: World) -> dict[str, TrialRow]:
    """Return the rows by trial; fail when a trial comes twice."""
    with Pool(jobs, context_of(*worlds)) as pool:
        rows = [row for row in pool.run(made) if row is not None]
    found = {row.trial_id: row for row in rows}
    assert len(found) == len(rows)
    return found


def test_digests_do_not_depend_on_worker_count() -> None:
    worlds = (floor(), boxed())
    made = tasks(*worlds, noise=("none", "harsh"), seeds=3, navigators=("vgm:left", "bug:right"))
    one, two = run(1, made, *worlds), run(2, made, *worlds)
    assert len(one) == len(made) == 16
    assert {name: row.digest for name, row in one.items()} == {
        name: row.digest for name, row in two.items()
    }


def test_dead_worker_is_replaced_and_its_trials_rerun(tmp_path: Path) -> None:
    worlds = (floor(), deadly(tmp_path / "marks", times=1))
    made = tasks(*worlds, noise=("default",), seeds=3)
    rows = run(1, made, *worlds)
    assert len(list((tmp_path / "marks").iterdir())) == 1
    assert sorted(rows) == sorted(task.trial_id for task in made)
    assert {row.outcome for row in rows.values()} == {"reached"}


class PlayedFuture:
    """A future of Dask; it ends in `DyingCluster.get`."""

    status: str
    result: Callable[[float], TrialRow]

    def add_done_callback(self, _: object) -> None:
        """Do nothing."""


class DyingCluster:
    """A Dask client whose workers die of the world `deadly`, with all tasks that they hold."""

    status = "running"

    def __init__(self) -> None:
        self.held: list[tuple[PlayedFuture, TrialRow]] = []
        self.ended: list[PlayedFuture] = []

    def nthreads(self) -> dict[str, int]:
        return {"worker": 1}

    def submit(self, _: object, task: TrialTask, context: StudyContext, *, pure: bool) -> Any:
        future = PlayedFuture()
        self.held.append((future, failed(task, context, "an outcome")))
        return future

    def put(self, future: Any) -> None:
        self.ended.append(future)

    def get(self, timeout: float) -> Any:
        """Return a future that has ended; all tasks end at the same time."""
        if not self.ended:
            is_deadly = any(row.world == "deadly" for _, row in self.held)
            for future, row in self.held:
                future.status = "error" if is_deadly else "finished"
                future.result = partial(died_or, None if is_deadly else row)
                self.ended.append(future)
            self.held.clear()
        return self.ended.pop(0)


def died_or(row: TrialRow | None, _timeout_s: float) -> TrialRow:
    from distributed import KilledWorker

    if row is None:
        raise KilledWorker("task", SimpleNamespace(address="worker"), 1)
    return row


@each(
    ("given", "dialled"),
    [
        ("tcp/10.0.0.5:8786", "tcp://10.0.0.5:8786"),
        ("tls/host:1", "tls://host:1"),
        ("tcp://10.0.0.5:8786", "tcp://10.0.0.5:8786"),
        ("10.0.0.5:8786", "10.0.0.5:8786"),
    ],
)
def test_scheduler_is_named_as_dask_or_as_the_bus_does(given: str, dialled: str) -> None:
    assert dask_address(given) == dialled


def test_trial_beside_one_that_kills_dask_workers_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    worlds = (floor(), floor("deadly"), floor("other"))
    cluster = DyingCluster()
    monkeypatch.setattr(pools, "SimpleQueue", {Any: lambda: cluster})
    rows = [*pools.run_on_cluster(cluster, context_of(*worlds), tasks(*worlds))]
    reasons = {row.world: row.reason for row in rows if row is not None}
    assert reasons.pop("deadly") == "the Dask workers that ran it died 2 times"
    assert reasons == {"floor": "an outcome", "other": "an outcome"}


def test_trial_that_kills_two_workers_fails_alone(
    tmp_path: Path,
) -> None:
    worlds = (deadly(tmp_path / "marks", times=2), floor(), boxed())
    made = sorted(tasks(*worlds), key=lambda task: task.place)
    rows = run(1, made, *worlds)
    assert len(rows) == 3
    bad = [row for row in rows.values() if row.outcome == FAILED]
    assert [row.world for row in bad] == ["deadly"]
    assert bad[0].reason == "its worker process died 2 times, last killed by SIGKILL"


def test_raising_trial_does_not_affect_others() -> None:
    worlds = (faulty(), floor())
    rows = run(2, tasks(*worlds), *worlds)
    assert sorted(row.outcome for row in rows.values()) == [FAILED, "reached"]


def test_workers_that_cannot_start_raise_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pools, "run_worker", int)  # a worker whose work is over at once
    made = tasks(floor())
    with (
        Pool(1, context_of(floor())) as pool,
        pytest.raises(UserError, match=r"cannot start.*exit code"),
    ):
        list(pool.run(made))


def test_leaving_the_pool_kills_its_workers() -> None:
    made = tasks(boxed(), noise=("default",), seeds=4)
    with Pool(2, context_of(boxed())) as pool:
        next(pool.run(made))
        processes = [worker.process for worker in pool._workers]
        assert all(process.is_alive() for process in processes)
    assert not any(process.is_alive() for process in processes)


def test_pool_starts_no_more_workers_than_trials() -> None:
    made = tasks(floor())
    with Pool(8, context_of(floor())) as pool:
        rows = pool.run(made)
        next(rows)
        assert len(pool._workers) == 1
        list(rows)


BLOCKED = """
from pathlib import Path
from study.runner.workers import Pool
from tests.support.studies import context_of, floor, tasks

made = tasks(floor(), noise=('default',), seeds=8)
with Pool(2, context_of(floor())) as pool:
    rows = pool.run(made)
    next(rows)
    for worker in pool._workers:
        status = Path(f"/proc/{worker.process.pid}/status").read_text()
        print(status.split("SigBlk:")[1].split()[0])
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc here")
def test_workers_block_interrupt_signals() -> None:
    """Run in a new process: Python starts a helper with the first worker that unmasks signals."""
    ran = subprocess.run(
        [sys.executable, "-c", BLOCKED], check=True, capture_output=True, text=True, timeout=60
    )
    masks = [int(line, 16) for line in ran.stdout.split()]
    assert len(masks) == 2
    for mask in masks:
        assert {number for number in (SIGINT, SIGTERM) if mask >> number - 1 & 1} == {
            SIGINT,
            SIGTERM,
        }


@each(
    ("code", "message"),
    [(-9, "killed by SIGKILL"), (-99, "killed by signal 99"), (3, "ended with exit code 3")],
)
def test_exit_codes_are_described(code: int, message: str) -> None:
    assert pools._exit_text(code) == message


FINITE = st.floats(-10.0, 10.0)


def test_row_holds_the_values_of_the_outcome() -> None:
    world = boxed()
    (task,) = tasks(world, noise=("default",))
    row = row_of(task, context_of(world))
    outcome = run_trial(trial_of(task, world))
    assert outcome.reached
    for name in ("outcome", "reason", "time_s", "path_m", "contacts", "ticks", "digest"):
        assert getattr(row, name) == getattr(outcome, name)
    assert (row.world, row.family, row.shortest_path_m) == (world.name, "disc", 2.4)
    assert row.goal_state == GoalState.REACHED
    assert row.min_clearance_m <= row.mean_clearance_m
    assert row.position_error_m == pytest.approx(
        ((row.true_x_m - world.goal.x_m) ** 2 + (row.true_y_m - world.goal.y_m) ** 2) ** 0.5
    )


def test_row_holds_scores_doubt_and_top_speed() -> None:
    world = boxed()
    row = row_of(tasks(world, noise=("default",))[0], context_of(world))
    assert (row.top_speed_m_s, row.lap_m) == (DEFAULTS.v_max_m_s, None)
    assert row.spl == pytest.approx(2.4 / row.path_m)
    assert row.published_score == pytest.approx(
        published_score(True, row.time_s, 2.4, row.top_speed_m_s)
    )
    assert row.doubt_m == doubt_m(row.cov_xx_m2, row.cov_xy_m2, row.cov_yy_m2)


def test_row_of_an_unreachable_goal_has_a_lap_and_no_score() -> None:
    ring = Polyline(((1.9, 0.6), (2.7, 0.6), (2.7, 1.4), (1.9, 1.4), (1.9, 0.6)))
    world = replace(floor(far_m=1.3), obstacles=(ring,), reachable=False, shortest_path_m=None)
    row = row_of(tasks(world)[0], context_of(world))
    assert row.lap_m == lap_m(world)
    assert row.lap_m is not None
    assert (row.spl, row.published_score) == (None, None)
    assert row.thinnest_wall_m == WALL_THICKNESS_M


def test_ticks_are_split_by_branch() -> None:
    world = boxed()
    (task,) = tasks(world)
    row = row_of(task, context_of(world))
    assert row.ticks_passing_left + row.ticks_passing_right > 0
    spent = row.ticks_to_goal + row.ticks_passing_left + row.ticks_passing_right
    assert 0 < spent + row.ticks_aligning <= row.ticks + 1


def test_row_reproduces_its_digest() -> None:
    world = boxed()
    (task,) = tasks(world, noise=("harsh",), parameters={"d_obs_m": 0.31})
    row = row_of(task, context_of(world))
    (stored,) = rows_of(table_of([row]))
    assert run_trial(trial_of(stored, world)).digest == row.digest


def test_row_holds_its_provenance() -> None:
    world = floor()
    row = row_of(tasks(world)[0], context_of(world, study="night"))
    assert (row.study, row.commit, row.dirty, row.version) == ("night", "c0ffee", False, "0.1.0")
    assert row.python == ".".join(map(str, sys.version_info[:3]))
    assert (row.numpy, row.pymunk) == (machine().numpy, machine().pymunk)
    assert row.machine
    assert row.platform
    assert row.started_utc.endswith("+00:00")
    assert CODE.digest not in row.commit


def test_raising_trial_is_a_failed_row() -> None:
    row = row_of(tasks(floor("faulty"))[0], context_of(faulty()))
    assert (row.outcome, row.reason) == (FAILED, "RuntimeError: the floor gave way")
    assert isnan(row.time_s)
    assert row.ticks == 0
    assert row.goal_state == states.NONE


def test_failed_row_fits_the_schema() -> None:
    row = failed(tasks(floor())[0], context_of(floor()), "not reached")
    assert table_of([row])["reason"].to_pylist() == ["not reached"]


def test_start_in_an_obstacle_is_aborted_with_reason() -> None:
    stuck = replace(boxed(), start=replace(floor().start, x_m=2.2))
    row = row_of(tasks(stuck)[0], context_of(stuck))
    assert row.outcome == "aborted"
    assert row.reason not in ("", "ok")
    assert row.min_clearance_m < 0.0


@given(FINITE, FINITE, st.floats(0.01, 5.0))
def test_mahalanobis_counts_standard_deviations(x_m: float, y_m: float, sigma_m: float) -> None:
    found = mahalanobis2(x_m, y_m, (sigma_m**2, 0.0, sigma_m**2))
    assert found == pytest.approx((x_m**2 + y_m**2) / sigma_m**2, abs=1e-9)


@given(FINITE, FINITE, st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.floats(-0.9, 0.9))
def test_mahalanobis_is_never_negative(
    x_m: float, y_m: float, xx: float, yy: float, correlation: float
) -> None:
    assert mahalanobis2(x_m, y_m, (xx, correlation * (xx * yy) ** 0.5, yy)) >= -1e-9


@each("spread", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (nan, 0.0, 1.0)])
def test_singular_covariance_gives_nan(spread: tuple[float, float, float]) -> None:
    assert isnan(mahalanobis2(0.1, 0.1, spread))


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


def test_line_shows_trials_rate_and_time_left() -> None:
    watch, file = Watch(), StringIO()
    progress = StudyProgress(100, 10, file, watch)
    for row in rows(30, time_s=120.0):
        progress.add(row)
    watch.now_s += 60.0
    progress.show_if_due()
    assert file.getvalue() == ("40/100 trials (40 %), 1.0 simulated h/min, 2 min left, 30 failed\n")


def test_no_time_left_before_the_first_trial() -> None:
    file = StringIO()
    StudyProgress(5, 0, file, Watch()).show_if_due()
    assert file.getvalue() == "0/5 trials (0 %)\n"


def test_terminal_line_is_overwritten() -> None:
    watch, file = Watch(), Terminal()
    progress = StudyProgress(5, 0, file, watch)
    for _ in range(4):
        watch.now_s += 1.0
        progress.show_if_due()
    progress.close()
    assert file.getvalue().count("\n") == 1
    assert file.getvalue().count("\r") == 5


def test_log_lines_are_sparse() -> None:
    watch, file = Watch(), StringIO()
    progress = StudyProgress(5, 0, file, watch)
    for _ in range(600):
        watch.now_s += 0.1
        progress.show_if_due()
    assert 2 <= file.getvalue().count("\n") <= 3


def test_failed_trial_does_not_change_simulated_time() -> None:
    progress = StudyProgress(5, 0, StringIO(), Watch())
    for row in rows(3):
        progress.add(row)
    assert progress.simulated_s == 0.0


@each(
    ("span_s", "words"),
    [(0.0, "0 s"), (89.4, "89 s"), (90.0, "2 min"), (3600.0, "60 min"), (11_100.0, "3 h 05 min")],
)
def test_durations_are_formatted_by_magnitude(span_s: float, words: str) -> None:
    assert duration_text(span_s) == words


@given(st.integers(0, 50), st.integers(0, 50), st.floats(0.0, 1e6))
def test_line_is_valid_for_any_progress(before: int, now: int, elapsed_s: float) -> None:
    watch = Watch()
    progress = StudyProgress(before + now + 1, before, StringIO(), watch)
    for row in rows(now):
        progress.add(row)
    watch.now_s += elapsed_s
    assert f"{before + now}/{before + now + 1} trials" in progress.line()
