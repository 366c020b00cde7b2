"""The same trials on a Dask cluster that is there already."""

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import islice
from typing import Any, Final

from protocol.errors import UserError
from study.one import Bench, failed, row_of
from study.plan import Task
from study.provenance import code
from study.rows import Row

CONNECT_S: Final = 10.0
REFRESH_S: Final = 1.0
MOST_WITHOUT_WORKERS_S: Final = 120.0
AHEAD: Final = 4
"""Tasks per thread that the cluster holds: enough to be busy, few enough to be stopped soon."""

MOST_KILLINGS: Final = 2
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


def run(client: Any, bench: Bench, tasks: Iterable[Task]) -> Iterator[Row | None]:
    """Rows as they come, None now and then. What a worker that dies was at is run by another.

    Raises UserError when the scheduler is gone or has had no workers for a while.
    """
    waiting, running = iter(tasks), dict[Any, Task]()
    killings = Counter[str]()
    idle_s = 0.0
    while True:
        threads = sum(_threads(client).values())
        for task in islice(waiting, max(0, AHEAD * max(1, threads) - len(running))):
            running[_submit(client, bench, task)] = task
        if not running:
            return
        idle_s = 0.0 if threads else idle_s + REFRESH_S
        if idle_s >= MOST_WITHOUT_WORKERS_S:
            raise UserError("--dask: the cluster has no workers left; what is done is kept")
        done = _wait(list(running))
        if not done:
            yield None
        for future in done:
            task = running.pop(future)
            row = _result(future, task, bench, killings)
            if row is None:
                running[_submit(client, bench, task)] = task
            else:
                yield row


def _threads(client: Any) -> dict[str, int]:
    """Raises UserError when the scheduler is gone."""
    with suppress(OSError, TimeoutError):
        if client.status == "running":
            found: dict[str, int] = client.nthreads()
            return found
    raise UserError("--dask: the scheduler is gone; what is done is kept, run it again to go on")


def _submit(client: Any, bench: Bench, task: Task) -> Any:
    """With its own world: data scattered before would be lost with the worker that has it."""
    alone = replace(bench, worlds=(bench.worlds[task.place],))
    return client.submit(row_of, replace(task, place=0), alone, pure=False)


def _wait(futures: list[Any]) -> list[Any]:
    """Those that are over, or none after a while."""
    from distributed import wait

    try:
        return list(wait(futures, timeout=REFRESH_S, return_when="FIRST_COMPLETED").done)
    except TimeoutError:
        return []
    except Exception as error:
        # wait() raises what one of them was cancelled with; which one, they say themselves.
        over = [future for future in futures if future.done()]
        if not over:
            raise UserError(f"--dask: {_first_line(error)}; what is done is kept") from None
        return over


def _result(future: Any, task: Task, bench: Bench, killings: Counter[str]) -> Row | None:
    """None: it is to be run again."""
    from distributed import KilledWorker

    if future.status == "finished":
        row: Row = future.result()
        return row
    if future.status != "error":
        return None  # cancelled or lost, with a scheduler that began anew
    error = future.exception()
    if not isinstance(error, KilledWorker):
        return failed(task, bench, f"{type(error).__name__}: {_first_line(error)}")
    killings[task.trial_id] += 1
    if killings[task.trial_id] < MOST_KILLINGS:
        return None
    return failed(task, bench, "the Dask workers that ran it died, again and again")


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
