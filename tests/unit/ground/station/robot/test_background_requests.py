"""Requests are done in a thread of their own, one at a time."""

from threading import Event, current_thread
from time import monotonic

from ground.station.robot.background_requests import JobResult, RequestThread
from runtime.errors import UserError
from tests.support.until import PATIENCE_S, until


def test_a_job_is_done_elsewhere_and_its_outcome_fetched_once() -> None:
    lane = RequestThread("somewhere else")
    assert lane.start(lambda: JobResult(True, current_thread().name))
    found: list[JobResult] = []
    until(lambda: found.append(one) if (one := lane.done()) else found)
    assert found == [JobResult(True, "somewhere else")]
    assert lane.done() is None
    lane.close(monotonic() + PATIENCE_S)


def test_there_is_one_job_at_a_time_until_its_outcome_is_fetched() -> None:
    lane, go = RequestThread("one"), Event()
    assert lane.start(lambda: JobResult(go.wait(PATIENCE_S), ""))
    assert not lane.start(lambda: JobResult(True, ""))
    go.set()
    until(lane.done)
    assert lane.start(lambda: JobResult(True, ""))
    lane.close(monotonic() + PATIENCE_S)


def fails() -> JobResult:
    raise UserError("no such thing")


def test_errors_come_back_in_words_and_the_lane_lives_on() -> None:
    lane = RequestThread("one")
    lane.start(fails)
    found: list[JobResult] = []
    until(lambda: found.append(one) if (one := lane.done()) else found)
    assert found == [JobResult(False, "no such thing")]
    assert lane.start(lambda: JobResult(True, ""))
    until(lane.done)
    lane.close(monotonic() + PATIENCE_S)


def test_closing_waits_no_longer_than_it_may() -> None:
    lane, go = RequestThread("one"), Event()
    lane.start(lambda: JobResult(go.wait(2 * PATIENCE_S), ""))
    began_s = monotonic()
    lane.close(monotonic() + 0.1)
    assert monotonic() - began_s < PATIENCE_S
    assert not lane.start(lambda: JobResult(True, ""))
    go.set()


def test_a_lane_never_used_closes_at_once() -> None:
    lane = RequestThread("one")
    lane.close(monotonic())
    assert not lane.start(lambda: JobResult(True, ""))
