"""Where climbs and shrinking run: in processes of this machine, on a Dask cluster, or in place."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import Any

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


@contextmanager
def workers(jobs: int, dask: str | None) -> Iterator[Executor]:
    """Yield an executor; its processes end with the context, also in the middle of a task.

    Raises UserError for a Dask cluster that cannot be used.
    """
    if dask is not None:
        with on_dask.cluster(dask) as client:
            yield client.get_executor(pure=False)
        return
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, spawn, initializer=_begin)
    try:
        yield pool
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
