"""Run the trials of a study on an existing Dask cluster."""

from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, Final

from runtime.errors import UserError
from study.runner.plan import TrialTask
from study.runner.provenance import code
from study.runner.rows import TrialRow
from study.runner.run_task import StudyContext, failed, row_of

CONNECT_S: Final = 10.0
FIRST_WORKER_S: Final = 10.0
REFRESH_S: Final = 1.0
MAX_WITHOUT_WORKERS_S: Final = 120.0
AHEAD: Final = 4
"""Tasks per thread in the cluster: enough to keep it busy, few enough to stop quickly."""

ASK_EVERY: Final = 50
KEPT: Final = "finished trials are kept; give the same command again to continue"
MAX_KILLINGS: Final = 2
"""Dask rejects a task when several workers died that held it, though another task on the same
workers may have been the cause. A task rejected this often has failed."""


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """Yield a client of the scheduler whose workers run the same code as this process.

    Raises UserError when no scheduler answers, it has no workers, or a worker runs other code.
    """
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise UserError(f"--dask: {error.name} is missing; pip install 'sidestep[dask]'") from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UserError(
            f"--dask {address}: no scheduler answers ({_first_line(error)}); "
            "start one with `dask scheduler`, or leave --dask out"
        ) from None
    with client:
        _check_workers(client, address)
        yield client


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_S)
    except TimeoutError:
        raise UserError(
            f"--dask {address}: the scheduler has no workers; start some with "
            f"`dask worker {address}`"
        ) from None
    for worker, digest in client.run(code_digest, on_error="return").items():
        if isinstance(digest, OSError):
            continue  # the worker died during the call; another replaces it
        if isinstance(digest, Exception):
            reason = f"cannot run sidestep ({_first_line(digest)})"
        elif digest != code().digest:
            reason = "runs other code than this process"
        else:
            continue
        fix = "install the same version of 'sidestep[study,dask]' there"
        raise UserError(f"--dask {address}: worker {worker} {reason}; {fix}")


def code_digest() -> str:
    """Return the digest of the code on the machine that runs this function."""
    return code().digest


def run(
    client: Any, context: StudyContext, tasks: Iterable[TrialTask]
) -> Iterator[TrialRow | None]:
    """Yield rows as they arrive; None about once a second while none arrives.

    Tasks of a worker that dies are run by another one. Raises UserError when the scheduler has gone
    or has had no workers for `MAX_WITHOUT_WORKERS_S`.
    """
    waiting, running = iter(tasks), dict[Any, TrialTask]()
    done, killings = SimpleQueue[Any](), Counter[str]()

    def submit(task: TrialTask) -> None:
        future = _submit(client, context, task)
        running[future] = task
        future.add_done_callback(done.put)

    capacity = ClusterCapacity(client)
    while True:
        for task in islice(waiting, max(0, capacity.max_tasks() - len(running))):
            submit(task)
        if not running:
            return
        try:
            future = done.get(timeout=REFRESH_S)
        except Empty:
            capacity.query(REFRESH_S)
            yield None
            continue
        ended = running.pop(future, None)
        if ended is None:
            continue  # reported twice: its result was lost and computed again
        row = _result(future, ended, context, killings)
        if row is None:
            submit(ended)
        else:
            yield row


class ClusterCapacity:
    """Number of threads and tasks of the cluster, queried seldom as it costs a round trip."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._threads = self._times = 0
        self._idle_s = 0.0

    def max_tasks(self) -> int:
        """Return how many tasks to keep in the cluster; UserError if the scheduler has gone."""
        return AHEAD * self.threads()

    def threads(self) -> int:
        """Return the number of threads, at least 1; UserError if the scheduler has gone."""
        if self._times % ASK_EVERY == 0:
            self.query(0.0)
        self._times += 1
        return max(1, self._threads)

    def query(self, waited_s: float) -> None:
        """Count the threads; raise UserError if the scheduler or its workers have gone."""
        try:
            alive = self._client.status == "running"
            self._threads = sum(self._client.nthreads().values()) if alive else 0
        except (OSError, TimeoutError):
            alive = False
        if not alive:
            raise UserError(f"--dask: the scheduler has gone; {KEPT}")
        self._idle_s = 0.0 if self._threads else self._idle_s + waited_s
        if self._idle_s >= MAX_WITHOUT_WORKERS_S:
            raise UserError(f"--dask: the cluster has no workers left; {KEPT}")


def _submit(client: Any, context: StudyContext, task: TrialTask) -> Any:
    """Submit a task with its own world: scattered data is lost with the worker that holds it."""
    own_context = replace(context, worlds=(context.worlds[task.place],))
    return client.submit(row_of, replace(task, place=0), own_context, pure=False)


def _result(
    future: Any, task: TrialTask, context: StudyContext, killings: Counter[str]
) -> TrialRow | None:
    """Return the row of an ended task; None if it must be run again."""
    from distributed import KilledWorker

    if future.status not in ("finished", "error"):
        return None  # cancelled or lost by a restart of the scheduler
    try:
        # The worker that holds the result may have died, and so may those that retry.
        row: TrialRow = future.result()
        return row
    except KilledWorker:
        pass
    except (CancelledError, OSError, TimeoutError):
        return None
    except Exception as error:
        return failed(task, context, f"{type(error).__name__}: {_first_line(error)}")
    killings[task.trial_id] += 1
    if killings[task.trial_id] < MAX_KILLINGS:
        return None
    return failed(task, context, f"the Dask workers that ran it died {MAX_KILLINGS} times")


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
