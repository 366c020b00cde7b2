"""Threads for the blocking work of an asyncio program, and waits that no cancellation ends."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import Future
from threading import Thread
from typing import Any, TypeVar

T = TypeVar("T")


def in_own_thread(job: Callable[[], T], name: str) -> "asyncio.Future[T]":
    """Run a job in a thread of its own, which outlives a cancellation."""
    future: Future[T] = Future()

    def work() -> None:
        try:
            result = job()
        except BaseException as error:
            future.set_exception(error)
        else:
            future.set_result(result)

    Thread(target=work, name=name, daemon=True).start()
    return asyncio.wrap_future(future)


async def finish(work: Coroutine[Any, Any, T]) -> T:
    """Await the work to its end, even if the caller is cancelled meanwhile."""
    task = asyncio.ensure_future(work)
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError:
            continue
    return task.result()


async def settled(work: Awaitable[Any]) -> None:
    """Wait until the work has ended, by a result, an error or a cancellation."""
    await asyncio.gather(work, return_exceptions=True)
