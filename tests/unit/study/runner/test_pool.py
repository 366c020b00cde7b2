"""Worker processes give the same rows whatever their number, and may die."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from signal import SIGINT, SIGTERM

import pytest

from protocol.world import World
from runtime.errors import UserError
from study.runner import workers as pools
from study.runner.plan import TrialTask
from study.runner.rows import FAILED, TrialRow
from study.runner.workers import Pool
from tests.support.each import each
from tests.support.study.made import boxed, context_of, floor, tasks
from tests.support.study.trouble import deadly, faulty


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
