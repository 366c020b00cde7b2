"""Requests run in a separate thread, one at a time."""

from threading import Event, current_thread
from time import monotonic

from ground.station.robot.background_requests import JobResult, RequestThread
from runtime.errors import UserError
from tests.support.until import PATIENCE_S, until


def test_job_runs_in_the_thread_and_returns_once() -> None:
    worker = RequestThread("somewhere else")
    assert worker.start(lambda: JobResult(True, current_thread().name))
    found: list[JobResult] = []
    until(lambda: found.append(one) if (one := worker.done()) else found)
    assert found == [JobResult(True, "somewhere else")]
    assert worker.done() is None
    worker.close(monotonic() + PATIENCE_S)


def test_one_job_at_a_time() -> None:
    worker, go = RequestThread("one"), Event()
    assert worker.start(lambda: JobResult(go.wait(PATIENCE_S), ""))
    assert not worker.start(lambda: JobResult(True, ""))
    go.set()
    until(worker.done)
    assert worker.start(lambda: JobResult(True, ""))
    worker.close(monotonic() + PATIENCE_S)


def fails() -> JobResult:
    raise UserError("no such thing")


def test_failed_job_returns_its_error() -> None:
    worker = RequestThread("one")
    worker.start(fails)
    found: list[JobResult] = []
    until(lambda: found.append(one) if (one := worker.done()) else found)
    assert found == [JobResult(False, "no such thing")]
    assert worker.start(lambda: JobResult(True, ""))
    until(worker.done)
    worker.close(monotonic() + PATIENCE_S)


def test_close_waits_until_the_deadline_only() -> None:
    worker, go = RequestThread("one"), Event()
    worker.start(lambda: JobResult(go.wait(2 * PATIENCE_S), ""))
    began_s = monotonic()
    worker.close(monotonic() + 0.1)
    assert monotonic() - began_s < PATIENCE_S
    assert not worker.start(lambda: JobResult(True, ""))
    go.set()


def test_unused_thread_closes_at_once() -> None:
    worker = RequestThread("one")
    worker.close(monotonic())
    assert not worker.start(lambda: JobResult(True, ""))
