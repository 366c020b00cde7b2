"""Substitutes for threads, queues, locks and clocks, with the interfaces that product code uses."""

from collections import deque
from collections.abc import Callable, Iterable
from math import ceil
from queue import Empty
from selectors import EVENT_READ, SelectorKey
from typing import Any, Generic, TypeVar

from checks.simulation.hosts.scheduler import Task, current_host, current_task
from runtime.units import NS_PER_S

T = TypeVar("T")


def _deadline_ns(timeout_s: float | None) -> int | None:
    if timeout_s is None:
        return None
    # A wait for less than a nanosecond must not end before that.
    return current_host().scheduler.now_ns + max(0, ceil(timeout_s * NS_PER_S))


class SimulatedQueue(Generic[T]):
    """Replaces queue.SimpleQueue."""

    def __init__(self) -> None:
        self._items: deque[T] = deque()
        self._reader: Task | None = None

    def put(self, item: T, block: bool = True, timeout: float | None = None) -> None:
        """Add an item."""
        self._items.append(item)
        if self._reader is not None:
            self._reader.wake()
            self._reader = None

    put_nowait = put

    def get(self, block: bool = True, timeout: float | None = None) -> T:
        """Remove and return an item; wait for it if `block`."""
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
        """Remove and return an item; raise Empty without one."""
        return self.get(block=False)

    def qsize(self) -> int:
        """Return the number of items."""
        return len(self._items)

    def empty(self) -> bool:
        """Return whether there is no item."""
        return not self._items


class SimulatedWakeUp:
    """Replaces protocol.pulse.WakeUp."""

    def __init__(self) -> None:
        self._calls: SimulatedQueue[None] = SimulatedQueue()

    def wake(self) -> None:
        """Wake the waiting task."""
        if self._calls.empty():
            self._calls.put(None)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for `wake`; return False after the timeout."""
        try:
            self._calls.get(timeout=timeout_s)
        except Empty:
            return False
        return True


class SimulatedEvent:
    """Replaces threading.Event."""

    def __init__(self) -> None:
        self._set = False
        self._waiting: list[Task] = []

    def is_set(self) -> bool:
        """Return whether the event is set."""
        return self._set

    def set(self) -> None:
        """Set the event and wake all waiting tasks."""
        self._set = True
        waiting, self._waiting = self._waiting, []
        for task in waiting:
            task.wake()

    def clear(self) -> None:
        """Reset the event."""
        self._set = False

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the event and return whether it is set."""
        deadline_ns = _deadline_ns(timeout)
        task = current_task()
        while not self._set:
            if deadline_ns is not None and task.host.scheduler.now_ns >= deadline_ns:
                break
            self._waiting.append(task)
            task.wait_until(deadline_ns)
        return self._set


class SimulatedThread:
    """Replaces threading.Thread; it belongs to the host that creates it."""

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
        """Call the target."""
        if self._target is not None:
            self._target(*self._arguments, **self._named)

    def start(self) -> None:
        """Start the thread as a task."""
        self._task = current_host().spawn(self._work)

    def _work(self) -> None:
        try:
            self.run()
        finally:
            self._ended.set()

    def is_alive(self) -> bool:
        """Return whether the thread is running."""
        return self._task is not None and not self._ended.is_set()

    def join(self, timeout: float | None = None) -> None:
        """Wait for the end of the thread."""
        if self.is_alive():
            self._ended.wait(timeout)


class SimulatedPool:
    """Replaces a ThreadPoolExecutor of one thread; it ends with its process."""

    def __init__(self, _threads: int, thread_name_prefix: str = "") -> None:
        self._jobs: SimulatedQueue[Callable[[], object]] = SimulatedQueue()
        self.submit = self._jobs.put
        SimulatedThread(name=thread_name_prefix, target=self._work).start()

    def _work(self) -> None:
        while True:
            self._jobs.get()()


class SimulatedPipe:
    """Replaces the gateway's WakeUp; stands for the descriptor of its reading end, too."""

    def __init__(self) -> None:
        self.reader = self
        self.ready = False
        self.waiting: Task | None = None

    def wake(self) -> None:
        """End the present or the next wait."""
        self.ready = True
        if self.waiting is not None:
            self.waiting.wake()

    def clear(self) -> None:
        """Forget all calls of `wake`."""
        self.ready = False


class SimulatedSelectors:
    """Replaces the module `selectors`, for descriptors that are simulated pipes."""

    EVENT_READ = EVENT_READ

    class PollSelector:
        """Replaces selectors.PollSelector."""

        def __init__(self) -> None:
            self._keys: dict[SimulatedPipe, Any] = {}

        def register(self, pipe: SimulatedPipe, events: int, data: object = None) -> None:
            """Wait for a pipe, too."""
            key: Any = SelectorKey(pipe, 0, events, data)  # type: ignore[arg-type]
            self._keys[pipe] = key

        def select(self, timeout: float) -> list[tuple[Any, int]]:
            """Return the keys of the pipes that are ready; wait for one until the timeout."""
            deadline_ns = _deadline_ns(timeout) or 0
            task = current_task()
            while not (ready := [key for pipe, key in self._keys.items() if pipe.ready]):
                if task.host.scheduler.now_ns >= deadline_ns:
                    break
                for pipe in self._keys:
                    pipe.waiting = task
                task.wait_until(deadline_ns)
            return [(key, EVENT_READ) for key in ready]


class SimulatedThreading:
    """Replaces the module `threading`; product code never waits with a lock held."""

    Thread = SimulatedThread
    Event = SimulatedEvent

    def __init__(self) -> None:
        import threading

        self.Lock = threading.Lock
        self.RLock = threading.RLock
        self.Condition = threading.Condition

    @staticmethod
    def current_thread() -> object:
        """Return the host, as identity of its threads."""
        return current_host()


class SimulatedTime:
    """Replaces the module `time` by the clock of the current host."""

    @staticmethod
    def monotonic_ns() -> int:
        """Return the monotonic time."""
        return current_host().now_ns()

    @staticmethod
    def monotonic() -> float:
        """Return the monotonic time in seconds."""
        return current_host().now_ns() / NS_PER_S

    @staticmethod
    def thread_time_ns() -> int:
        """Return no CPU time: in lockstep no budget is enforced."""
        return 0

    @staticmethod
    def time_ns() -> int:
        """Return the wall-clock time."""
        host = current_host()
        return host.scheduler.now_ns + host.wall_offset_ns

    @staticmethod
    def time() -> float:
        """Return the wall-clock time in seconds."""
        return SimulatedTime.time_ns() / NS_PER_S


class SimulatedClock:
    """Replaces runtime.clock.Clock of a host."""

    def __init__(self) -> None:
        self._host = current_host()
        self.cpu_spent_ns = 0
        self.stage_cost_ns = 100_000

    def now_ns(self) -> int:
        """Return the monotonic time."""
        return self._host.now_ns()

    def cpu_ns(self) -> int:
        """Return the CPU time; each call adds the cost of a stage, as calls are one per stage."""
        self.cpu_spent_ns += self.stage_cost_ns
        return self.cpu_spent_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Wait until a monotonic time."""
        current_task().wait_until(
            max(deadline_ns - self._host.clock_offset_ns, self._host.scheduler.now_ns)
        )
