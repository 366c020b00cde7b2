"""Send requests to the robot from separate threads, so that the display never waits."""

import logging
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from time import monotonic
from typing import NamedTuple, Protocol, TypeAlias

from runtime.errors import LocalError, RemoteError

LOG = logging.getLogger(__name__)


class JobResult(NamedTuple):
    """Result of a request in one or more lines: `ok 14 ms`, or the robot's reason."""

    ok: bool
    text: str


Job: TypeAlias = Callable[[], JobResult]


class RequestWorker(Protocol):
    """A worker for one job at a time."""

    @property
    def busy(self) -> bool:
        """True while a job runs or its result waits."""
        ...

    def start(self, job: Job) -> bool:
        """Start a job; return False if it cannot start now."""
        ...

    def done(self) -> JobResult | None:
        """Return the result of a job, once."""
        ...

    def close(self, deadline_s: float) -> None:
        """Stop until the deadline, in monotonic time."""


class RequestThread:
    """A thread that runs one job at a time; it starts with the first job."""

    def __init__(self, name: str) -> None:
        self.busy = False
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._outcomes: SimpleQueue[JobResult] = SimpleQueue()
        self._thread = Thread(target=self._work, name=name, daemon=True)
        self._closed = False

    def start(self, job: Job) -> bool:
        """Start a job; return False while another one runs, or after `close`."""
        if self.busy or self._closed:
            return False
        if not self._thread.is_alive():
            self._thread.start()
        self.busy = True
        self._jobs.put(job)
        return True

    def done(self) -> JobResult | None:
        """Return the result of a job once; then another one may start."""
        try:
            outcome = self._outcomes.get_nowait()
        except Empty:
            return None
        self.busy = False
        return outcome

    def close(self, deadline_s: float) -> None:
        """Accept no more jobs; wait for the present one until the deadline (monotonic time)."""
        self._closed = True
        self._jobs.put(None)
        if self._thread.is_alive():
            self._thread.join(max(0.0, deadline_s - monotonic()))

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._outcomes.put(outcome_of(job))


def outcome_of(job: Job) -> JobResult:
    """Run a job; an exception becomes a result in words."""
    try:
        return job()
    except (RemoteError, LocalError) as error:
        return JobResult(False, str(error))
    except Exception as error:
        LOG.exception("a request has failed")
        return JobResult(False, f"internal error of the ground station: {error!r}")
