"""Executors for climbs and shrinking: processes of this machine, a Dask cluster, or in place."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import Any, NamedTuple

from study.runner import on_dask


class InPlace(Executor):
    """Run every task at once in this process."""

    def submit(self, call: Any, /, *args: Any, **keywords: Any) -> "Future[Any]":
        """Run a task and return its result as a future."""
        done: Future[Any] = Future()
        try:
            done.set_result(call(*args, **keywords))
        except Exception as error:
            done.set_exception(error)
        return done


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
        with on_dask.cluster(dask) as client:
            capacity = on_dask.ClusterCapacity(client)
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
