"""Substitutes for threads, queues, locks and clocks, with the interfaces that product code uses."""

from collections import deque
from collections.abc import Callable, Iterable
from queue import Empty
from typing import Any, Generic, TypeVar

from runtime.units import NS_PER_S
from verification.simulation.hosts.scheduler import Task, current_host, current_task

T = TypeVar("T")


def _deadline_ns(timeout_s: float | None) -> int | None:
    if timeout_s is None:
        return None
    return current_host().scheduler.now_ns + max(0, round(timeout_s * NS_PER_S))


class SimulatedQueue(Generic[T]):
    """As queue.SimpleQueue."""

    def __init__(self) -> None:
        self._items: deque[T] = deque()
        self._reader: Task | None = None

    def put(self, item: T, block: bool = True, timeout: float | None = None) -> None:
        self._items.append(item)
        if self._reader is not None:
            self._reader.wake()
            self._reader = None

    put_nowait = put

    def get(self, block: bool = True, timeout: float | None = None) -> T:
        if not self._items and block:
            deadline_ns = _deadline_ns(timeout)
            task = current_task()
            while not self._items:
                if deadline_ns is not None and task.host.scheduler.now_ns >= deadline_ns:
                    break
                self._reader = task
                task.wait_until(deadline_ns)
            self._reader = None
        if not self._items:
            raise Empty
        return self._items.popleft()

    def get_nowait(self) -> T:
        if not self._items:
            raise Empty
        return self._items.popleft()

    def qsize(self) -> int:
        return len(self._items)

    def empty(self) -> bool:
        return not self._items


class SimulatedWakeUp:
    """As protocol.pulse.WakeUp."""

    def __init__(self) -> None:
        self._calls: SimulatedQueue[None] = SimulatedQueue()

    def wake(self) -> None:
        if self._calls.empty():
            self._calls.put(None)

    def wait(self, timeout_s: float | None = None) -> bool:
        try:
            self._calls.get(timeout=timeout_s)
        except Empty:
            return False
        return True


class SimulatedEvent:
    """As threading.Event."""

    def __init__(self) -> None:
        self._set = False
        self._waiting: list[Task] = []

    def is_set(self) -> bool:
        return self._set

    def set(self) -> None:
        self._set = True
        waiting, self._waiting = self._waiting, []
        for task in waiting:
            task.wake()

    def clear(self) -> None:
        self._set = False

    def wait(self, timeout: float | None = None) -> bool:
        deadline_ns = _deadline_ns(timeout)
        task = current_task()
        while not self._set:
            if deadline_ns is not None and task.host.scheduler.now_ns >= deadline_ns:
                break
            self._waiting.append(task)
            task.wait_until(deadline_ns)
        return self._set


class SimulatedThread:
    """As threading.Thread; it belongs to the host that makes it."""

    def __init__(
        self,
        group: None = None,
        target: Callable[..., object] | None = None,
        name: str | None = None,
        args: Iterable[Any] = (),
        kwargs: dict[str, Any] | None = None,
        *,
        daemon: bool | None = None,
    ) -> None:
        self.name = name or ""
        self.daemon = daemon
        self._target = target
        self._arguments = tuple(args)
        self._named = kwargs or {}
        self._task: Task | None = None
        self._ended = SimulatedEvent()

    def run(self) -> None:
        if self._target is not None:
            self._target(*self._arguments, **self._named)

    def start(self) -> None:
        self._task = current_host().spawn(self._work)

    def _work(self) -> None:
        try:
            self.run()
        finally:
            self._ended.set()

    def is_alive(self) -> bool:
        return self._task is not None and not self._ended.is_set()

    def join(self, timeout: float | None = None) -> None:
        if self.is_alive():
            self._ended.wait(timeout)


class SimulatedThreading:
    """As the module `threading`; locks of product code are never held over a wait."""

    Thread = SimulatedThread
    Event = SimulatedEvent

    def __init__(self) -> None:
        import threading

        self.Lock = threading.Lock
        self.RLock = threading.RLock
        self.Condition = threading.Condition

    @staticmethod
    def current_thread() -> object:
        return current_host()


class SimulatedTime:
    """As the module `time`, by the clock of the host whose code runs."""

    @staticmethod
    def monotonic_ns() -> int:
        return current_host().now_ns()

    @staticmethod
    def monotonic() -> float:
        return current_host().now_ns() / NS_PER_S

    @staticmethod
    def time_ns() -> int:
        host = current_host()
        return host.scheduler.now_ns + host.wall_offset_ns

    @staticmethod
    def time() -> float:
        return SimulatedTime.time_ns() / NS_PER_S


class SimulatedClock:
    """As runtime.clock.Clock of one host; CPU time is what `spend` has added to it."""

    def __init__(self) -> None:
        self._host = current_host()
        self.cpu_spent_ns = 0
        self.stage_cost_ns = 100_000

    def now_ns(self) -> int:
        return self._host.now_ns()

    def cpu_ns(self) -> int:
        """Each look costs a stage: product code looks once per stage."""
        self.cpu_spent_ns += self.stage_cost_ns
        return self.cpu_spent_ns

    def sleep_until(self, deadline_ns: int) -> None:
        current_task().wait_until(
            max(deadline_ns - self._host.clock_offset_ns, self._host.scheduler.now_ns)
        )
