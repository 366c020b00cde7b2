"""Virtual time: scenarios as events in time, an event queue, and tasks that wait in it.

A scenario is data: the same list of events gives the same run. A task is a greenlet. Product code
that blocks (a sleep, a queue, a query) runs unmodified in one: each wait is an event of the queue
instead of a wait in the operating system. Only one task runs at a time. The order of events depends
only on their times and the order in which they were added.

Substitutes for threads, queues, locks and clocks have the interfaces that product code uses. So has
an asyncio event loop: its waits are those of a task, and jobs of its executors are simulated
threads. One loop runs at a time in a simulation.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine, Iterable
from concurrent.futures import Future
from heapq import heappop, heappush
from math import ceil
from queue import Empty
from typing import Any, Final, Generic, NamedTuple, TypeAlias, TypeVar

import msgspec
from greenlet import GreenletExit, getcurrent, greenlet

from checks.harness.loop import PlayedLoop
from runtime.units import NS_PER_MS, NS_PER_S

Argument: TypeAlias = int | float | str

STATION: Final = "station"
"""The operator that uses the ground station instead of the command line."""

OPERATORS: Final = ("operator-a", "operator-b", "operator-c", STATION)


class Event(NamedTuple):
    """An event at a time; `salt` seeds what the event draws itself."""

    time_ns: int
    kind: str
    arguments: tuple[Argument, ...]
    salt: int

    def __str__(self) -> str:
        words = " ".join(str(argument) for argument in self.arguments)
        return f"{self.time_ns / NS_PER_MS:9.1f} ms  {self.kind} {words}".rstrip()


class EventScenario(NamedTuple):
    """Everything that a run depends on: the seed of its setting, its duration and its events.

    In lockstep the plant's clock drives the robot.
    """

    seed: int
    duration_ns: int
    events: tuple[Event, ...]
    lockstep: bool = False


def to_json(scenario: EventScenario) -> str:
    """Return a scenario as JSON."""
    return msgspec.json.encode(scenario).decode()


def from_json(text: str) -> EventScenario:
    """Read a scenario; msgspec.ValidationError if the text is no scenario."""
    return msgspec.json.decode(text, type=EventScenario)


class Scheduler:
    """Events in order of time; events of the same time in the order in which they were added."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.events = 0
        self._heap: list[tuple[int, int, Callable[..., object], tuple[Any, ...]]] = []
        self._sequence = 0
        self._hub = getcurrent()

    @property
    def hub(self) -> greenlet:
        """The greenlet in which events run; a task that waits switches to it."""
        return self._hub

    def at(self, when_ns: int, action: Callable[..., object], *arguments: Any) -> None:
        """Call `action` at a time, or next if the time has passed."""
        self._sequence += 1
        heappush(self._heap, (when_ns, self._sequence, action, arguments))

    def run(self, until_ns: int) -> None:
        """Run all events up to a time."""
        heap = self._heap
        while heap and heap[0][0] <= until_ns:
            when_ns, _, action, arguments = heappop(heap)
            if when_ns > self.now_ns:
                self.now_ns = when_ns
            self.events += 1
            action(*arguments)
        self.now_ns = until_ns


class Host:
    """A simulated process: its tasks and its clock; it runs, is suspended or has ended.

    A suspended host (as by SIGSTOP) runs nothing. What arrives within the first second waits, as in
    the buffers of a connection; the rest is lost with the connection.
    """

    KEEPS_NS: Final = NS_PER_S
    running: "Host | None" = None
    """The host whose code runs now."""

    def __init__(self, scheduler: Scheduler, name: str, clock_offset_ns: int = 0) -> None:
        self.name = name
        self.scheduler = scheduler
        self.alive = True
        self.clock_offset_ns = clock_offset_ns
        self.error: BaseException | None = None
        self.wall_offset_ns = 1_795_000_000 * NS_PER_S
        """Offset of the wall clock to simulated time."""
        self._suspended_ns: int | None = None
        self._waiting: list[tuple[Callable[..., object], tuple[Any, ...]]] = []
        self._tasks: list[Task] = []

    def now_ns(self) -> int:
        """Return the monotonic time of this host."""
        return self.scheduler.now_ns + self.clock_offset_ns

    @property
    def suspended(self) -> bool:
        """True if the host is suspended."""
        return self._suspended_ns is not None

    def deliver(self, action: Callable[..., object], *arguments: Any) -> None:
        """Call the callback of an arrival, unless the connection has ended meanwhile."""
        since_ns = self._suspended_ns
        if since_ns is None or self.scheduler.now_ns - since_ns <= self.KEEPS_NS:
            self.call(action, *arguments)

    def call(self, action: Callable[..., object], *arguments: Any) -> None:
        """Call `action` in this host, now or when the host is resumed."""
        if not self.alive:
            return
        if self._suspended_ns is not None:
            self._waiting.append((action, arguments))
            return
        before, Host.running = Host.running, self
        try:
            action(*arguments)
        except Exception as error:  # an invariant judges it
            self.error = error
        finally:
            Host.running = before

    def spawn(self, body: Callable[[], object]) -> "Task":
        """Start a task (a thread of this process)."""
        task = Task(self, body)
        self._tasks = [one for one in self._tasks if not one.dead]
        self._tasks.append(task)
        self.scheduler.at(self.scheduler.now_ns, task.start)
        return task

    def suspend(self) -> None:
        """Suspend the host."""
        if self._suspended_ns is None:
            self._suspended_ns = self.scheduler.now_ns

    def resume(self) -> None:
        """Resume the host, first with the arrivals that waited."""
        if self._suspended_ns is None:
            return
        self._suspended_ns = None
        waiting, self._waiting = self._waiting, []
        for action, arguments in waiting:
            self.call(action, *arguments)

    def kill(self) -> None:
        """End the host; cleanup code of its tasks has no effect."""
        self.alive = False
        self._waiting = []
        before, Host.running = Host.running, self
        try:
            for task in self._tasks:
                if not task.dead:
                    task.throw(GreenletExit)
        finally:
            Host.running = before
        self._tasks = []


class Task(greenlet):  # type: ignore[misc]  # it carries no types
    """A thread of a simulated process."""

    def __init__(self, host: Host, body: Callable[[], object]) -> None:
        super().__init__(self._guarded, host.scheduler.hub)
        self.host = host
        self._body = body
        self._token = 0

    def start(self) -> None:
        """Run the task in its host."""
        self.host.call(self.switch)

    def _guarded(self) -> None:
        try:
            self._body()
        except GreenletExit:
            pass
        except Exception as error:  # an invariant judges it
            self.host.error = error

    def wait_until(self, deadline_ns: int | None) -> None:
        """Wait for `wake`, or until a scheduler time if `deadline_ns` is not None."""
        host = self.host
        if not host.alive:
            raise GreenletExit
        self._token += 1
        scheduler = host.scheduler
        if deadline_ns is not None:
            scheduler.at(deadline_ns, self._continue, self._token)
        loop = asyncio._get_running_loop()
        asyncio._set_running_loop(None)  # meanwhile those of other programs run
        try:
            scheduler.hub.switch()
        finally:
            asyncio._set_running_loop(loop)
        if not host.alive:
            raise GreenletExit

    def wake(self) -> None:
        """End the wait of this task at this instant, after the current event."""
        scheduler = self.host.scheduler
        scheduler.at(scheduler.now_ns, self._continue, self._token)

    def interrupt(self, error: BaseException) -> None:
        """Raise an error in the task, where it waits."""
        if not self.dead:
            self._token += 1
            self.host.call(self.throw, error)

    def _continue(self, token: int) -> None:
        if token == self._token and not self.dead:
            self.host.call(self._resume, token)

    def _resume(self, token: int) -> None:
        """Continue once, even if the wait ended while the host was suspended."""
        if token == self._token and not self.dead:
            self._token += 1
            self.switch()


def current_task() -> Task:
    """Return the running task; RuntimeError in an event, which must not wait."""
    task = getcurrent()
    if not isinstance(task, Task):
        raise RuntimeError("code in the bus's thread must not wait")
    return task


def current_host() -> Host:
    """Return the host whose code runs; RuntimeError if there is none."""
    task = getcurrent()
    if isinstance(task, Task):
        return task.host
    if Host.running is None:
        raise RuntimeError("no simulated process runs now")
    return Host.running


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


MOST_WAITS: Final = 9
"""A killed program waits at most so often in its clean-up, each time in vain."""


class SimulatedLoop(PlayedLoop):
    """Replaces the event loop of a program, in the task that creates it."""

    def __init__(self) -> None:
        super().__init__(SimulatedClock())
        self._waiter = current_task()
        self._is_woken = False
        self.set_exception_handler(lambda _loop, _context: None)

    def run_in_executor(  # type: ignore[override]  # of typeshed, with TypeVarTuple
        self, executor: "SimulatedExecutor | None", job: Callable[..., Any], *arguments: Any
    ) -> "asyncio.Future[Any]":
        """Run a job in a thread of an executor, or in a thread of its own."""
        threads = SimulatedExecutor(1) if executor is None else executor
        return asyncio.wrap_future(threads.submit(job, *arguments), loop=self)

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a program to its end, then cancel what it has left; its host may be killed."""
        try:
            try:
                return super().run(work)
            finally:
                self._cancel_rest()
        except GreenletExit:
            with self._running():
                self._abandon()
            raise
        finally:
            self.close()

    def _cancel_rest(self) -> None:
        """Cancel the tasks that are left, as `asyncio.run` does, and let them end."""
        rest = asyncio.all_tasks(self) if self._waiter.host.alive else set()
        for task in rest:
            task.cancel()
        with self._running():
            while not all(task.done() for task in rest):
                self._turn()

    def _wait(self, timeout_s: float | None) -> None:
        """Wait until the time is up, or until another task calls the loop."""
        if not self._is_woken:
            self._waiter.wait_until(_deadline_ns(timeout_s))
        self._is_woken = False

    def _write_to_self(self) -> None:
        """End the wait."""
        self._is_woken = True
        self._waiter.wake()

    def _abandon(self) -> None:
        """End all coroutines of a killed program; their clean-up has no effect any more."""
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
