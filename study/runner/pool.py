"""Worker processes that are expected to die: what one was at is run again by another.

Every worker has its own pipe, so nobody waits for a lock that a dead one holds. A worker sees its
pipe closed when the study is gone, however that went, and ends.
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
"""Tasks a worker holds, so that it never waits for the next one."""

MAX_DEATHS: Final = 2
"""A trial that has cost so many workers is not run again."""

MAX_FALSE_STARTS: Final = 3
REFRESH_S: Final = 1.0


@dataclass
class Worker:
    """A process, our end of its pipe, and what it has been given, the oldest first."""

    process: BaseProcess
    pipe: Connection
    held: deque[TrialTask] = field(default_factory=deque)
    ready: bool = False


class Pool:
    """`with Pool(...) as pool: for row in pool.run(tasks)`; leaving it ends the workers at once."""

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
        """Rows as they come; None now and then while nothing comes.

        Raises UserError when workers die before they have begun.
        """
        self._waiting.extend(tasks)
        while len(self._workers) < min(self._jobs, len(self._waiting)):
            self._workers.append(_hire(self._context))
        while self._waiting or any(worker.held for worker in self._workers):
            for worker in self._workers:
                self._feed(worker)
            ready = wait([worker.pipe for worker in self._workers], REFRESH_S)
            if not ready:
                yield None
            for worker in [one for one in self._workers if one.pipe in ready]:
                yield from self._hear(worker)

    def _feed(self, worker: Worker) -> None:
        """Near the end nobody holds more than one, so that nobody waits for what another holds."""
        most = AHEAD if len(self._waiting) > AHEAD * len(self._workers) else 1
        while worker.ready and self._waiting and len(worker.held) < most:
            try:
                worker.pipe.send(self._waiting[0])
            except OSError:
                return  # it is dead, which is heard of on the pipe
            worker.held.append(self._waiting.popleft())

    def _hear(self, worker: Worker) -> Iterator[TrialRow]:
        try:
            said = worker.pipe.recv()
        except (OSError, EOFError):
            yield from self._bury(worker)
            return
        if said == READY:
            worker.ready, self._false_starts = True, 0
            return
        worker.held.popleft()
        assert isinstance(said, TrialRow)
        yield said

    def _bury(self, worker: Worker) -> Iterator[TrialRow]:
        """Another takes its place; what it was at is run once more, or else has failed."""
        worker.process.join()
        worker.pipe.close()
        end = _end_of(worker.process.exitcode)
        if not worker.ready:
            self._false_starts += 1
            if self._false_starts >= MAX_FALSE_STARTS:
                raise UserError(
                    f"a worker process cannot start ({end}); try --jobs 1, or see above"
                )
        if worker.held:
            task = worker.held[0]
            self._deaths[task.trial_id] += 1
            if self._deaths[task.trial_id] >= MAX_DEATHS:
                worker.held.popleft()
                reason = f"its worker process died {MAX_DEATHS} times, at last {end}"
                yield failed(task, self._context, reason)
        self._waiting.extendleft(reversed(worker.held))
        self._workers[self._workers.index(worker)] = _hire(self._context)


def _hire(context: StudyContext) -> Worker:
    """Spawned, not forked: it shares nothing with us but the pipe. Ctrl-C is for us alone."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=work, args=(theirs, context), name="trials", daemon=True)
    # Started with the first process otherwise, and that takes the mask off again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    theirs.close()
    return Worker(process, ours)


def work(pipe: Connection, context: StudyContext) -> None:
    """Run what comes until nobody is there any more."""
    gc.collect()
    gc.freeze()
    try:
        pipe.send(READY)
        while True:
            pipe.send(row_of(pipe.recv(), context))
    except (OSError, EOFError):
        return


def _end_of(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        try:
            return f"killed by {signal.Signals(-exit_code).name}"
        except ValueError:
            return f"killed by signal {-exit_code}"
    return f"ended with exit code {exit_code}"
