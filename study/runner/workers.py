"""Processes and Dask clusters that run the trials of a study or the climbs of a search.

In a pool a task is run again when its worker dies. Every worker has its own pipe, so that no lock
is held by a dead process. A worker exits when its pipe is closed, which also happens when the study
is killed.
"""

import gc
import multiprocessing
import os
import re
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from queue import Empty, SimpleQueue
from types import ModuleType
from typing import Any, Final, NamedTuple, Self

from runtime.errors import UserError
from study.runner.plan import TrialTask
from study.runner.rows import TrialRow, code
from study.runner.run_task import StudyContext, failed, row_of

READY: Final = "ready"
POOL_AHEAD: Final = 2
"""Tasks given to a worker in advance, so that it never waits for the next one."""

MAX_DEATHS: Final = 2
"""A trial whose worker died this many times has failed."""

MAX_FALSE_STARTS: Final = 3
REFRESH_S: Final = 1.0


@dataclass
class Worker:
    """A process, the study's end of its pipe, and the tasks given to it, the oldest first."""

    process: BaseProcess
    pipe: Connection
    held: deque[TrialTask] = field(default_factory=deque)
    ready: bool = False


class Pool:
    """Worker processes for trials: `with Pool(...) as pool: for row in pool.run(tasks)`.

    Leaving the context kills the workers.
    """

    def __init__(self, jobs: int, context: StudyContext) -> None:
        self._jobs = jobs
        self._context = context
        self._workers: list[Worker] = []
        self._waiting: deque[TrialTask] = deque()
        self._deaths: Counter[str] = Counter()
        self._false_starts = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
            worker.pipe.close()
        self._workers.clear()

    def run(self, tasks: Iterable[TrialTask]) -> Iterator[TrialRow | None]:
        """Yield rows as they arrive; None about once a second while none arrives.

        Raises UserError when several workers die before they are ready.
        """
        self._waiting.extend(tasks)
        while len(self._workers) < min(self._jobs, len(self._waiting)):
            self._workers.append(_start_worker(self._context))
        while self._waiting or any(worker.held for worker in self._workers):
            for worker in self._workers:
                self._send_tasks(worker)
            ready = wait([worker.pipe for worker in self._workers], REFRESH_S)
            if not ready:
                yield None
            for worker in [one for one in self._workers if one.pipe in ready]:
                yield from self._receive(worker)

    def _send_tasks(self, worker: Worker) -> None:
        """Send tasks in advance; one at a time near the end, to share the last tasks evenly."""
        most = POOL_AHEAD if len(self._waiting) > POOL_AHEAD * len(self._workers) else 1
        while worker.ready and self._waiting and len(worker.held) < most:
            try:
                worker.pipe.send(self._waiting[0])
            except OSError:
                return  # it died; reading its pipe reports that
            worker.held.append(self._waiting.popleft())

    def _receive(self, worker: Worker) -> Iterator[TrialRow]:
        try:
            reply = worker.pipe.recv()
        except (OSError, EOFError):
            yield from self._replace(worker)
            return
        if reply == READY:
            worker.ready, self._false_starts = True, 0
            return
        worker.held.popleft()
        assert isinstance(reply, TrialRow)
        yield reply

    def _replace(self, worker: Worker) -> Iterator[TrialRow]:
        """Start a new worker; run the task of the dead one again, or yield it as failed."""
        worker.process.join()
        worker.pipe.close()
        end = _exit_text(worker.process.exitcode)
        if not worker.ready:
            self._false_starts += 1
            if self._false_starts >= MAX_FALSE_STARTS:
                raise UserError(
                    f"worker processes cannot start ({end}); see above, or try --jobs 1"
                )
        if worker.held:
            task = worker.held[0]
            self._deaths[task.trial_id] += 1
            if self._deaths[task.trial_id] >= MAX_DEATHS:
                worker.held.popleft()
                reason = f"its worker process died {MAX_DEATHS} times, last {end}"
                yield failed(task, self._context, reason)
        self._waiting.extendleft(reversed(worker.held))
        self._workers[self._workers.index(worker)] = _start_worker(self._context)


def _start_worker(context: StudyContext) -> Worker:
    """Spawn a worker that shares only the pipe with this process and ignores Ctrl-C."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=run_worker, args=(theirs, context), name="trials", daemon=True)
    # Start the tracker first: starting it along with a process would reset the signal mask.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    # A worker needs nothing of the program: to import that would run it again.
    program = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        process.start()
    finally:
        sys.modules["__main__"] = program
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    theirs.close()
    return Worker(process, ours)


def run_worker(pipe: Connection, context: StudyContext) -> None:
    """Run the tasks from the pipe until it is closed."""
    gc.collect()
    gc.freeze()
    try:
        pipe.send(READY)
        while True:
            pipe.send(row_of(pipe.recv(), context))
    except (OSError, EOFError):
        return


def _exit_text(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        try:
            return f"killed by {signal.Signals(-exit_code).name}"
        except ValueError:
            return f"killed by signal {-exit_code}"
    return f"ended with exit code {exit_code}"


CONNECT_S: Final = 10.0
FIRST_WORKER_S: Final = 10.0
MAX_WITHOUT_WORKERS_S: Final = 120.0
FETCH_S: Final = 10.0
"""Time for a result to arrive; then its trial is run again, if there are workers."""

DASK_AHEAD: Final = 4
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
    address = dask_address(address)
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


def dask_address(text: str) -> str:
    """Return the address of a scheduler, which may be written as an endpoint of the bus."""
    return re.sub(r"^(tcp|tls)/(?!/)", r"\1://", text)


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


def run_on_cluster(
    client: Any, context: StudyContext, tasks: Iterable[TrialTask]
) -> Iterator[TrialRow | None]:
    """Yield rows as they arrive; None about once a second while none arrives.

    Tasks of a worker that dies are run by another one. Dask gives up all tasks that such a worker
    held, so each of these is run again, alone and last, to find the one that it died of. Raises
    UserError when the scheduler has gone or has had no workers for `MAX_WITHOUT_WORKERS_S`.
    """
    waiting, running, suspects = iter(tasks), dict[Any, TrialTask](), deque[TrialTask]()
    done, killings = SimpleQueue[Any](), Counter[str]()

    def submit(task: TrialTask) -> None:
        future = _submit(client, context, task)
        running[future] = task
        future.add_done_callback(done.put)

    capacity = ClusterCapacity(client)
    while True:
        for task in islice(waiting, max(0, DASK_AHEAD * capacity.threads() - len(running))):
            submit(task)
        if not running:
            if not suspects:
                return
            submit(suspects.popleft())
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
        if row is not None:
            yield row
        elif killings[ended.trial_id]:
            suspects.append(ended)
        else:
            submit(ended)


class ClusterCapacity:
    """Number of threads and tasks of the cluster, queried seldom as it costs a round trip."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._threads = self._times = 0
        self._idle_s = 0.0

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
        # The worker that holds the result may have died, and so may all that could repeat it.
        row: TrialRow = future.result(FETCH_S)
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


class Workers(NamedTuple):
    """An executor, and a function that returns how many tasks it runs at the same time.

    The function raises UserError if the scheduler of a Dask cluster has gone.
    """

    executor: Executor
    threads: Callable[[], int]


@contextmanager
def workers(jobs: int, dask: str | None) -> Iterator[Workers]:
    """Yield workers; their processes end with the context, also in the middle of a task.

    `jobs` is the number of processes; a Dask cluster has its own number of threads, which may
    change. Raises UserError for a Dask cluster that cannot be used.
    """
    if dask is not None:
        with cluster(dask) as client:
            capacity = ClusterCapacity(client)
            yield Workers(client.get_executor(pure=False), capacity.threads)
        return
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, spawn, initializer=_begin)
    try:
        yield Workers(pool, lambda: jobs)
    finally:
        # Only the tasks of this search are children of this process.
        for child in multiprocessing.active_children():
            child.kill()
        pool.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    """Leave Ctrl-C to the parent, and end when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
