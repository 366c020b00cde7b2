"""The event loop of a verb, which a signal ends."""

import asyncio
import signal
from collections.abc import Callable, Coroutine
from functools import partial
from types import FrameType
from typing import Any, TypeVar

from ground.client.robot_link import call_soon

T = TypeVar("T")


def run_until_signal(work: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine to its end; the first signal cancels it, and further ones are ignored.

    A handler that raises would interrupt the event loop itself. When all clean-up has ended, the
    signal goes to the handler from before, which raises.
    """
    received: list[int] = []
    cancel: Callable[[], object] = lambda: None  # noqa: E731

    async def program() -> T:
        nonlocal cancel
        task = asyncio.current_task()
        assert task is not None, "a loop runs coroutines in tasks"
        cancel = partial(call_soon, asyncio.get_running_loop(), task.cancel)
        if received:
            raise asyncio.CancelledError
        return await work()

    def note(number: int, _: FrameType | None) -> None:
        received.append(number)
        if len(received) == 1:
            cancel()

    kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, note) for number in kinds}
    try:
        return asyncio.run(program())
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])
