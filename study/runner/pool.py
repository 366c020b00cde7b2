"""A pool of worker processes in which a task is run again when its worker dies.

Every worker has its own pipe, so that no lock is held by a dead process. A worker exits when its
pipe is closed, which also happens when the study is killed.
"""

import gc
import multiprocessing
import signal
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Final, Self

from runtime.errors import UserError
from study.runner.plan import TrialTask
from study.runner.rows import TrialRow
from study.runner.run_task import StudyContext, failed, row_of

READY: Final = "ready"
AHEAD: Final = 2
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
        most = AHEAD if len(self._waiting) > AHEAD * len(self._workers) else 1
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
    try:
        process.start()
    finally:
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
