"""Worker processes give the same rows however many they are, and may die."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from signal import SIGINT, SIGTERM

import pytest

from plant.model.types import World
from runtime.errors import UserError
from study.runner import pool as pools
from study.runner.plan import TrialTask
from study.runner.pool import Pool
from study.runner.rows import FAILED, TrialRow
from tests.support.study.made import boxed, context_of, floor, tasks
from tests.support.study.trouble import deadly, faulty


def run(jobs: int, made: Sequence[TrialTask], *worlds: World) -> dict[str, TrialRow]:
    """The rows by trial; fails when one comes twice."""
    with Pool(jobs, context_of(*worlds)) as pool:
        rows = [row for row in pool.run(made) if row is not None]
    found = {row.trial_id: row for row in rows}
    assert len(found) == len(rows)
    return found


def test_the_digests_are_equal_for_one_worker_and_for_three() -> None:
    worlds = (floor(), boxed())
    made = tasks(*worlds, noise=("none", "harsh"), seeds=3, navigators=("vgm:left", "bug:right"))
    one, three = run(1, made, *worlds), run(3, made, *worlds)
    assert len(one) == len(made) == 16
    assert {name: row.digest for name, row in one.items()} == {
        name: row.digest for name, row in three.items()
    }


def test_a_worker_that_dies_is_replaced_and_its_trials_run_again(tmp_path: Path) -> None:
    worlds = (floor(), deadly(tmp_path / "marks", times=1))
    made = tasks(*worlds, noise=("default",), seeds=3)
    rows = run(1, made, *worlds)
    assert len(list((tmp_path / "marks").iterdir())) == 1
    assert sorted(rows) == sorted(task.trial_id for task in made)
    assert {row.outcome for row in rows.values()} == {"reached"}


def test_a_trial_that_kills_its_worker_twice_has_failed_and_the_others_have_not(
    tmp_path: Path,
) -> None:
    worlds = (deadly(tmp_path / "marks", times=2), floor(), boxed())
    made = sorted(tasks(*worlds), key=lambda task: task.place)
    rows = run(1, made, *worlds)
    assert len(rows) == 3
    bad = [row for row in rows.values() if row.outcome == FAILED]
    assert [row.world for row in bad] == ["deadly"]
    assert bad[0].reason == "its worker process died 2 times, at last killed by SIGKILL"


def test_a_trial_that_raises_is_a_row_among_the_others() -> None:
    worlds = (faulty(), floor())
    rows = run(2, tasks(*worlds), *worlds)
    assert sorted(row.outcome for row in rows.values()) == [FAILED, "reached"]


def test_workers_that_cannot_begin_are_an_error_and_no_endless_attempt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pools, "work", int)  # a worker whose work is over at once
    made = tasks(floor())
    with (
        Pool(1, context_of(floor())) as pool,
        pytest.raises(UserError, match=r"cannot start.*exit code"),
    ):
        list(pool.run(made))


def test_leaving_the_pool_ends_the_workers_at_once() -> None:
    made = tasks(boxed(), noise=("default",), seeds=4)
    with Pool(2, context_of(boxed())) as pool:
        next(pool.run(made))
        processes = [worker.process for worker in pool._workers]
        assert all(process.is_alive() for process in processes)
    assert not any(process.is_alive() for process in processes)


def test_no_more_workers_than_trials() -> None:
    made = tasks(floor())
    with Pool(8, context_of(floor())) as pool:
        rows = pool.run(made)
        next(rows)
        assert len(pool._workers) == 1
        list(rows)


BLOCKED = """
from pathlib import Path
from study.runner.pool import Pool
from tests.support.study.made import context_of, floor, tasks

made = tasks(floor(), noise=('default',), seeds=8)
with Pool(2, context_of(floor())) as pool:
    rows = pool.run(made)
    next(rows)
    for worker in pool._workers:
        status = Path(f"/proc/{worker.process.pid}/status").read_text()
        print(status.split("SigBlk:")[1].split()[0])
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc here")
def test_ctrl_c_is_not_for_the_workers_nor_for_the_first_of_them() -> None:
    """In a process of its own, for Python starts a helper with the first worker that unmasks it."""
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


@pytest.mark.parametrize(
    ("code", "says"),
    [(-9, "killed by SIGKILL"), (-99, "killed by signal 99"), (3, "ended with exit code 3")],
)
def test_how_a_worker_ended_is_said_in_words(code: int, says: str) -> None:
    assert pools._end_of(code) == says
