"""Virtual time: an event queue, and tasks that wait in it instead of in the operating system.

A task is a greenlet. Product code that blocks (a sleep, a queue, a query) runs unmodified in one:
each wait is an event of the queue. Only one task runs at a time. The order of events depends only
on their times and the order in which they were added.
"""

from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any, Final

from greenlet import GreenletExit, getcurrent, greenlet

from runtime.units import NS_PER_S


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
        scheduler.hub.switch()
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
