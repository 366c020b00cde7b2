"""An asyncio event loop on simulated time: its waits are those of a task of the scheduler.

Jobs of executors are simulated threads. One loop runs at a time in a simulation.
"""

import asyncio
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from math import ceil
from typing import Any, Final

from greenlet import GreenletExit

from checks.simulation.hosts.scheduler import current_host, current_task
from checks.simulation.hosts.threads import SimulatedQueue, SimulatedThread
from runtime.units import NS_PER_S

MOST_WAITS: Final = 9
"""A killed program waits at most so often in its clean-up, each time in vain."""


class SimulatedLoop(asyncio.BaseEventLoop):
    """Replaces the event loop of a program, in the task that creates it."""

    def __init__(self) -> None:
        super().__init__()
        self._selector = self
        self._host, self._waiter = current_host(), current_task()
        self._is_woken = False

    def time(self) -> float:
        """Return the monotonic time of the host."""
        return self._host.now_ns() / NS_PER_S

    def select(self, timeout: float | None) -> list[Any]:
        """Wait until the time is up, or until another task calls the loop."""
        if not self._is_woken:
            scheduler = self._host.scheduler
            until_ns = None if timeout is None else scheduler.now_ns + ceil(timeout * NS_PER_S)
            asyncio._set_running_loop(None)
            self._waiter.wait_until(until_ns)
            asyncio._set_running_loop(self)
        self._is_woken = False
        return []

    def _process_events(self, _events: list[Any]) -> None:
        """Have no events of descriptors."""

    def _write_to_self(self) -> None:
        """End the wait of `select`."""
        self._is_woken = True
        self._waiter.wake()

    def run_in_executor(  # type: ignore[override]  # of typeshed, with TypeVarTuple
        self, executor: "SimulatedExecutor | None", job: Callable[..., Any], *arguments: Any
    ) -> "asyncio.Future[Any]":
        """Run a job in a thread of an executor, or in a thread of its own."""
        threads = SimulatedExecutor(1) if executor is None else executor
        return asyncio.wrap_future(threads.submit(job, *arguments), loop=self)

    def run(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a program to its end; its host may be killed meanwhile."""
        self.set_exception_handler(lambda _loop, _context: None)
        program = self.create_task(work)
        asyncio._set_running_loop(self)
        try:
            while not program.done():
                self._run_once()  # type: ignore[attr-defined]
        except GreenletExit:
            self._abandon()
            raise
        finally:
            asyncio._set_running_loop(None)
            self.close()
        program.result()

    def _abandon(self) -> None:
        """End all coroutines of a killed program; their clean-up has no effect any more."""
        asyncio._set_running_loop(self)
        known: set[asyncio.Task[Any]] = set()
        while tasks := asyncio.all_tasks(self) - known:  # clean-up may begin others
            known |= tasks
            for task in tasks:
                task._log_destroy_pending = False  # type: ignore[attr-defined]
                coroutine: Any = task.get_coro()
                for _ in range(MOST_WAITS):
                    try:
                        coroutine.throw(GreenletExit())
                    except BaseException:
                        break


class SimulatedExecutor:
    """Replaces a ThreadPoolExecutor; its threads end with the process."""

    def __init__(self, threads: int, thread_name_prefix: str = "") -> None:
        self._left = threads
        self._name = thread_name_prefix
        self._jobs: SimulatedQueue[Callable[[], None]] = SimulatedQueue()

    def submit(self, job: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        """Run a job when a thread is free."""
        done: Future[Any] = Future()

        def work() -> None:
            if not done.set_running_or_notify_cancel():
                return
            try:
                result = job(*arguments)
            except Exception as error:
                done.set_exception(error)
            else:
                done.set_result(result)

        self._jobs.put(work)
        if self._left:
            self._left -= 1
            SimulatedThread(name=self._name, target=self._work).start()
        return done

    def _work(self) -> None:
        while not self._jobs.empty():
            self._jobs.get()()
        self._left += 1

    def shutdown(self, **_: object) -> None:
        """Wait for nothing: a thread ends with its last job."""
