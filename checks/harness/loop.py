"""An event loop on a clock of its own: what waits in it takes no real time.

Several of them may take turns in one thread, even within the callback of another loop.
"""

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from math import ceil
from selectors import DefaultSelector, SelectorKey
from typing import Any, TypeVar

from runtime.clock import Clock
from runtime.units import NS_PER_S

T = TypeVar("T")


class ClockSelector(DefaultSelector):
    """Waits by a function while no descriptor is ready."""

    def __init__(self, wait: Callable[[float | None], None]) -> None:
        super().__init__()
        self._wait = wait

    def select(self, timeout: float | None = None) -> list[tuple[SelectorKey, int]]:
        """Return the descriptors that are ready; without one wait for `timeout` seconds."""
        ready = super().select(0)
        if not ready:
            self._wait(timeout)
        return ready


class PlayedLoop(asyncio.SelectorEventLoop):
    """An event loop whose waits move the clock; sockets are real, and read when they are ready."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(ClockSelector(self._wait))
        self._clock = clock
        self._until_ns: int | None = None
        self._is_idle = False

    def time(self) -> float:
        """Return the time of the clock in seconds."""
        return self._clock.now_ns() / NS_PER_S

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end; RuntimeError if it waits for what never comes."""
        program = self.create_task(work)
        with self._running():
            while not program.done():
                self._turn()
        return program.result()

    def advance(self, ns: int = 0) -> None:
        """Let time pass exactly so long; run what is due until then."""
        self._until_ns, self._is_idle = self._clock.now_ns() + ns, False
        try:
            with self._running():
                while not self._is_idle:
                    self._turn()
        finally:
            self._until_ns = None

    def run_in_executor(  # type: ignore[override]  # of typeshed, with TypeVarTuple
        self, executor: Any, job: Callable[..., T], *arguments: Any
    ) -> "asyncio.Future[T]":
        """Run a job in a thread of an executor; without one at once: it takes no time."""
        if executor is not None:
            return super().run_in_executor(executor, job, *arguments)
        done: asyncio.Future[T] = self.create_future()
        try:
            done.set_result(job(*arguments))
        except Exception as error:
            done.set_exception(error)
        return done

    @contextmanager
    def _running(self) -> Iterator[None]:
        before = asyncio._get_running_loop()
        asyncio._set_running_loop(self)
        try:
            yield
        finally:
            asyncio._set_running_loop(before)

    def _turn(self) -> None:
        self._run_once()  # type: ignore[attr-defined]
        self._is_idle = self._is_idle and not self._ready  # type: ignore[attr-defined]

    def _wait(self, timeout_s: float | None) -> None:
        """Move the clock to the end of a wait, or to that of `advance`; 0 is no wait."""
        now_ns, until_ns = self._clock.now_ns(), self._until_ns
        due_ns = None if timeout_s is None else now_ns + ceil(timeout_s * NS_PER_S)
        if due_ns is None and until_ns is None:
            raise RuntimeError("nothing is left that could end this wait")
        self._is_idle = until_ns is not None and now_ns >= until_ns and due_ns != now_ns
        self._clock.sleep_until(min(one for one in (due_ns, until_ns) if one is not None))
