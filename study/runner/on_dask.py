"""The same trials on a Dask cluster that is there already."""

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
REFRESH_S: Final = 1.0
MAX_WITHOUT_WORKERS_S: Final = 120.0
AHEAD: Final = 4
"""Tasks per thread that the cluster holds: enough to be busy, few enough to be stopped soon."""

ASK_EVERY: Final = 50
KEPT: Final = "what is done is kept, and the same command goes on from there"
MAX_KILLINGS: Final = 2
"""Dask gives a task up when several workers died while they had it, though it may only have been
on the same worker as the one they died of. Given up this often, it has failed."""


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """A client of the scheduler, whose workers run the code that we do.

    Raises UserError when nobody answers, nobody works there, or other code is there.
    """
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise UserError(f"--dask: {error.name} is missing; pip install 'sidestep[dask]'") from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UserError(
            f"--dask {address}: no scheduler answers there ({_first_line(error)}); "
            "start one with `dask scheduler`, or leave --dask out"
        ) from None
    with client:
        _check_workers(client, address)
        yield client


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise UserError(
            f"--dask {address}: the scheduler has no workers; start some with "
            f"`dask worker {address}`"
        ) from None
    for worker, said in client.run(code_digest, on_error="return").items():
        if isinstance(said, OSError):
            continue  # it died while it was asked; another takes its place
        if isinstance(said, Exception):
            reason = f"cannot run sidestep ({_first_line(said)})"
        elif said != code().digest:
            reason = "runs other code than this"
        else:
            continue
        fix = "install this very version of 'sidestep[study,dask]' there"
        raise UserError(f"--dask {address}: worker {worker} {reason}; {fix}")


def code_digest() -> str:
    """Of the code on the machine that is asked."""
    return code().digest


def run(
    client: Any, context: StudyContext, tasks: Iterable[TrialTask]
) -> Iterator[TrialRow | None]:
    """Rows as they come, None now and then. What a worker that dies was at is run by another.

    Raises UserError when the scheduler is gone or has had no workers for a while.
    """
    waiting, running = iter(tasks), dict[Any, TrialTask]()
    over, killings = SimpleQueue[Any](), Counter[str]()

    def submit(task: TrialTask) -> None:
        future = _submit(client, context, task)
        running[future] = task
        future.add_done_callback(over.put)

    room = ClusterCapacity(client)
    while True:
        for task in islice(waiting, max(0, room.most() - len(running))):
            submit(task)
        if not running:
            return
        try:
            future = over.get(timeout=REFRESH_S)
        except Empty:
            room.ask(REFRESH_S)
            yield None
            continue
        ended = running.pop(future, None)
        if ended is None:
            continue  # told of twice: its result was lost and made again
        row = _result(future, ended, context, killings)
        if row is None:
            submit(ended)
        else:
            yield row


class ClusterCapacity:
    """How much the cluster should hold; asking costs a round trip, so it is not done every time."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._threads = self._times = 0
        self._idle_s = 0.0

    def most(self) -> int:
        """Raises UserError when the scheduler is gone."""
        if self._times % ASK_EVERY == 0:
            self.ask(0.0)
        self._times += 1
        return AHEAD * max(1, self._threads)

    def ask(self, waited_s: float) -> None:
        """Raises UserError when the scheduler is gone, or has had no workers for a while."""
        try:
            alive = self._client.status == "running"
            self._threads = sum(self._client.nthreads().values()) if alive else 0
        except (OSError, TimeoutError):
            alive = False
        if not alive:
            raise UserError(f"--dask: the scheduler is gone; {KEPT}")
        self._idle_s = 0.0 if self._threads else self._idle_s + waited_s
        if self._idle_s >= MAX_WITHOUT_WORKERS_S:
            raise UserError(f"--dask: the cluster has no workers left; {KEPT}")


def _submit(client: Any, context: StudyContext, task: TrialTask) -> Any:
    """With its own world: data scattered before would be lost with the worker that has it."""
    alone = replace(context, worlds=(context.worlds[task.place],))
    return client.submit(row_of, replace(task, place=0), alone, pure=False)


def _result(
    future: Any, task: TrialTask, context: StudyContext, killings: Counter[str]
) -> TrialRow | None:
    """None: it is to be run again."""
    from distributed import KilledWorker

    if future.status not in ("finished", "error"):
        return None  # cancelled or lost, with a scheduler that began anew
    try:
        # The worker that has it may be dead by now, and so may be those that try again.
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
    return failed(task, context, "the Dask workers that ran it died, again and again")


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
