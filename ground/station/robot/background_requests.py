"""What is asked of the robot, in threads of their own, so that nobody who shows it waits."""

import logging
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from time import monotonic
from typing import NamedTuple, Protocol, TypeAlias

from runtime.errors import LocalError, RemoteError

LOG = logging.getLogger(__name__)


class JobResult(NamedTuple):
    """How a request ended, in one or more lines: `ok 14 ms`, or the robot's reason."""

    ok: bool
    text: str


Job: TypeAlias = Callable[[], JobResult]


class RequestWorker(Protocol):
    """One worker, with one job at a time."""

    @property
    def busy(self) -> bool: ...
    def start(self, job: Job) -> bool: ...
    def done(self) -> JobResult | None: ...
    def close(self, deadline_s: float) -> None: ...


class RequestThread:
    """A thread that does one job after the other; it begins with the first."""

    def __init__(self, name: str) -> None:
        self.busy = False
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._outcomes: SimpleQueue[JobResult] = SimpleQueue()
        self._thread = Thread(target=self._work, name=name, daemon=True)
        self._closed = False

    def start(self, job: Job) -> bool:
        """False when the one before is not done, or the lane is closed."""
        if self.busy or self._closed:
            return False
        if not self._thread.is_alive():
            self._thread.start()
        self.busy = True
        self._jobs.put(job)
        return True

    def done(self) -> JobResult | None:
        """What came of the job, once; then there may be another."""
        try:
            outcome = self._outcomes.get_nowait()
        except Empty:
            return None
        self.busy = False
        return outcome

    def close(self, deadline_s: float) -> None:
        """No more jobs; the one under way has until the deadline (monotonic), then it is left."""
        self._closed = True
        self._jobs.put(None)
        if self._thread.is_alive():
            self._thread.join(max(0.0, deadline_s - monotonic()))

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._outcomes.put(outcome_of(job))


def outcome_of(job: Job) -> JobResult:
    """Do it; whatever goes wrong comes back in words."""
    try:
        return job()
    except (RemoteError, LocalError) as error:
        return JobResult(False, str(error))
    except Exception as error:
        LOG.exception("a request has failed")
        return JobResult(False, f"this is a fault of the ground station: {error!r}")
