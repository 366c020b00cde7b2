"""`sidestep study --dask`: the same trials on a cluster, whose workers may die."""

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from protocol.world import World
from runtime.errors import UserError
from study.runner import workers as executors
from study.runner.plan import TrialTask
from study.runner.rows import FAILED, TrialRow, code
from study.runner.run_task import StudyContext
from study.runner.workers import Pool
from tests.support.study.made import boxed, context_of, floor, tasks
from tests.support.study.trouble import deadly

MAX_DEATHS = 1
"""Dask rejects a task after more deaths of its workers; each death costs a start of a worker."""

if TYPE_CHECKING:
    from distributed import LocalCluster

pytestmark = pytest.mark.stack


@contextmanager
def local_cluster(workers: int) -> Iterator["LocalCluster"]:
    """Start a scheduler with so many worker processes, which it replaces when they die."""
    import dask.config
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": MAX_DEATHS}),
        LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        ) as cluster,
    ):
        yield cluster


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with local_cluster(2) as cluster:
        yield cluster.scheduler_address


def run(address: str, made: Sequence[TrialTask], *worlds: World) -> dict[str, TrialRow]:
    with executors.cluster(address) as client:
        return by_trial(executors.run_on_cluster(client, context_of(*worlds), made))


def by_trial(rows: Iterator[TrialRow | None]) -> dict[str, TrialRow]:
    found = [row for row in rows if row is not None]
    assert len({row.trial_id for row in found}) == len(found), "a trial came twice"
    return {row.trial_id: row for row in found}


def digests(rows: dict[str, TrialRow]) -> dict[str, str]:
    return {name: row.digest for name, row in rows.items()}


def test_the_rows_are_those_of_our_own_processes(address: str) -> None:
    worlds = (floor(), boxed())
    made = tasks(*worlds, noise=("none", "harsh"), seeds=3)
    with Pool(1, context_of(*worlds)) as pool:
        ours = by_trial(pool.run(made))
    assert digests(run(address, made, *worlds)) == digests(ours)
    assert len(ours) == len(made)


def test_trials_outlive_dask_workers_and_one_that_kills_them_has_failed(tmp_path: Path) -> None:
    with local_cluster(2) as cluster:
        address = cluster.scheduler_address
        killed_from_outside_they_cost_no_trial(address)
        one_that_dies_costs_no_trial(address, tmp_path / "once")
        a_trial_that_every_worker_dies_of_has_failed(address, tmp_path / "always")


def one_that_dies_costs_no_trial(address: str, marks: Path) -> None:
    worlds = (floor(), deadly(marks, times=1), boxed())
    made = tasks(*worlds, noise=("default",), seeds=4)
    rows = run(address, made, *worlds)
    assert len(list(marks.iterdir())) == 1
    assert sorted(rows) == sorted(task.trial_id for task in made)
    assert {row.outcome for row in rows.values()} == {"reached"}


def killed_from_outside_they_cost_no_trial(address: str) -> None:
    made = tasks(boxed(), noise=("default",), seeds=12)
    with executors.cluster(address) as client:
        pids = list(client.run(os.getpid).values())
        coming = executors.run_on_cluster(client, context_of(boxed()), made)
        first = next(row for row in coming if row is not None)
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        rows = by_trial(coming)
    assert first.trial_id not in rows
    assert len(rows) == len(made) - 1
    assert {row.outcome for row in rows.values()} == {"reached"}


def a_trial_that_every_worker_dies_of_has_failed(address: str, marks: Path) -> None:
    worlds = (deadly(marks, times=99), floor())
    rows = run(address, tasks(*worlds), *worlds)
    ends = {row.world: row.outcome for row in rows.values()}
    assert ends == {"deadly": FAILED, "floor": "reached"}
    assert any("workers that ran it died" in row.reason for row in rows.values())


def test_a_study_on_dask_is_like_any_other(address: str, tmp_path: Path) -> None:
    from study.cli.study import main
    from study.runner.store import read

    words = ["--worlds", "open", "box", "--noise", "none", "--no-report"]
    assert main([*words, "--dask", address, "--output", str(tmp_path / "dask")]) == 0
    assert main([*words, "--jobs", "1", "--output", str(tmp_path / "ours")]) == 0
    one, other = read(tmp_path / "dask"), read(tmp_path / "ours")
    assert one.num_rows == 14
    assert one["trial_id"].equals(other["trial_id"])
    assert one["digest"].equals(other["digest"])


def test_other_code_on_the_workers_is_refused(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = code()._replace(digest="other")
    monkeypatch.setattr(executors, "code", lambda: other)
    with pytest.raises(UserError, match="runs other code than this"), executors.cluster(address):
        raise AssertionError("other code was let in")


def test_absent_scheduler_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "CONNECT_S", 1.0)
    gone = "tcp://127.0.0.1:1"
    with pytest.raises(UserError, match="no scheduler answers"), executors.cluster(gone):
        raise AssertionError("nobody is there")


def test_invalid_address_is_reported() -> None:
    with pytest.raises(UserError, match="--dask"), executors.cluster("no address: at all"):
        raise AssertionError("that is no address")


def test_scheduler_without_workers_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "FIRST_WORKER_S", 1.0)
    with (
        local_cluster(0) as cluster,
        pytest.raises(UserError, match="has no workers"),
        executors.cluster(cluster.scheduler_address),
    ):
        raise AssertionError("nobody works there")


def test_a_scheduler_that_goes_away_ends_the_study_with_what_is_done() -> None:
    made = tasks(boxed(), noise=("default",), seeds=40)
    with (
        local_cluster(1) as cluster,
        executors.cluster(cluster.scheduler_address) as client,
    ):
        coming = executors.run_on_cluster(client, context_of(boxed()), made)
        assert next(row for row in coming if row is not None).outcome == "reached"
        cluster.close()
        with pytest.raises(UserError, match="finished trials are kept"):
            exhaust(coming)


def exhaust(coming: Iterator[Any]) -> None:
    for _ in coming:
        pass


def test_every_task_travels_with_its_own_world_only() -> None:
    sent: list[tuple[TrialTask, StudyContext]] = []

    class Client:
        def submit(self, _: object, task: TrialTask, context: StudyContext, **__: object) -> None:
            sent.append((task, context))

    worlds = (floor(), boxed())
    for task in tasks(*worlds):
        executors._submit(Client(), context_of(*worlds), task)
    assert all(task.place == 0 and len(context.worlds) == 1 for task, context in sent)
    assert {context.worlds[0].name for _, context in sent} == {"floor", "disc"}
