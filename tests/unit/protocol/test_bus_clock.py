"""Estimate of a robot's clock in a ground process: never later than the robot's own time."""

import threading
from collections import deque
from collections.abc import Mapping
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.until import PATIENCE_S
from protocol.bus.network import Network
from protocol.bus.robot_clock import (
    AGAIN,
    SAMPLES,
    RobotClock,
    RobotClocks,
    is_again,
    marked_again,
    time_bytes,
    time_in,
)
from protocol.bus.services import Requester
from protocol.bus.session import LastingSession
from protocol.topics import COMMAND, PARAMETERS, Role
from protocol.wire.codec import decode
from protocol.wire.enums import AckResult, Command
from protocol.wire.messages import CommandAck, CommandRequest, Timesync
from protocol.wire.reasons import Reason
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_MS as MS
from tests.support.each import each

ARM = CommandRequest(request_id=1, command=Command.COMPONENT_ARM_DISARM, param1=1.0, param2=0.0)

LIMIT_S = PATIENCE_S


@each("time_ns", [0, 1, -1, 2**63 - 1, -(2**63)])
def test_time_is_encoded_as_eight_bytes(time_ns: int) -> None:
    assert len(time_bytes(time_ns)) == 8
    assert time_in(time_bytes(time_ns)) == time_ns


def test_a_time_is_little_endian_on_every_machine() -> None:
    assert time_bytes(258) == b"\x02\x01\0\0\0\0\0\0"


@each("size", [0, 7, 9, 1000])
def test_an_attachment_of_another_size_carries_no_time(size: int) -> None:
    assert time_in(b"\0" * size) is None


def test_event_that_is_put_again_keeps_its_time() -> None:
    assert time_in(marked_again(time_bytes(5))) == 5
    assert time_in(marked_again(None)) is None
    assert all(map(is_again, (marked_again(None), marked_again(time_bytes(5)))))
    by_chance = b"\0\0\0" + AGAIN
    assert time_in(by_chance) is not None
    assert not is_again(by_chance)


def test_an_unknown_clock_has_no_time() -> None:
    assert RobotClock().time_ns(5) is None


def test_one_measurement_is_exact_up_to_the_return_delay() -> None:
    clock = RobotClock()
    clock.observe(asked_ns=100, robot_ns=5_000, answered_ns=140)
    assert clock.time_ns(140) == 5_000
    assert clock.time_ns(1_140) == 6_000


ways = st.tuples(st.integers(0, 500 * MS), st.integers(0, 500 * MS))


@given(st.integers(-(10**15), 10**15), st.lists(ways, min_size=1, max_size=30))
def test_estimate_is_never_late_and_as_good_as_the_best_reply(
    ahead_ns: int, measured: list[tuple[int, int]]
) -> None:
    clock, now_ns = RobotClock(), 0
    for there_ns, back_ns in measured:
        asked_ns, now_ns = now_ns, now_ns + there_ns + back_ns
        clock.observe(asked_ns, asked_ns + there_ns + ahead_ns, now_ns)
    best_ns = min(back_ns for _, back_ns in measured[-SAMPLES:])
    assert clock.time_ns(now_ns) == now_ns + ahead_ns - best_ns


@each("robot_ns", [2**62, 2**63 - 1, -(2**63)])
def test_answer_without_a_time_is_ignored(robot_ns: int) -> None:
    clock = RobotClock()
    clock.observe(asked_ns=100, robot_ns=5_000, answered_ns=140)
    clock.observe(asked_ns=200, robot_ns=robot_ns, answered_ns=240)
    assert clock.time_ns(140) == 5_000


def test_the_newest_eight_measurements_count() -> None:
    clock = RobotClock()
    clock.observe(0, 1_000, 1)
    for _ in range(7):
        clock.observe(0, 1_000, 50)
    assert clock.time_ns(0) == 999
    clock.observe(0, 1_000, 50)
    assert clock.time_ns(0) == 950


def test_clock_that_went_back_is_measured_again() -> None:
    clock = RobotClock()
    clock.observe(asked_ns=0, robot_ns=10**12, answered_ns=10)
    clock.observe(asked_ns=20, robot_ns=500, answered_ns=30)
    assert clock.time_ns(30) == 500


def test_a_measurement_that_fits_the_earlier_ones_keeps_them() -> None:
    clock = RobotClock()
    clock.observe(asked_ns=0, robot_ns=1_010, answered_ns=10)
    clock.observe(asked_ns=100, robot_ns=1_100, answered_ns=900)
    assert clock.time_ns(0) == 1_000, "the robot's clock may be just that far ahead"
    clock.observe(asked_ns=100, robot_ns=1_099, answered_ns=900)
    assert clock.time_ns(0) == 199, "it cannot: it was read 999 after the question at most"


def test_contradicted_measurements_are_discarded() -> None:
    clock = RobotClock()
    clock.observe(0, 1_000, 1)
    clock.forget()
    assert clock.time_ns(5) is None


class Forgotten(deque[int]):
    """A clock whose measurements another thread removes just after this thread found some."""

    def __bool__(self) -> bool:
        found = len(self) > 0
        self.clear()
        return found


def test_measurement_survives_concurrent_removal_of_earlier_ones() -> None:
    """Raise no exception: one ended the measuring thread for good."""
    clock = RobotClock()
    clock._ahead_ns = Forgotten([1_000], maxlen=SAMPLES)
    clock.observe(asked_ns=0, robot_ns=1_010, answered_ns=10)
    clock.forget()
    clock.observe(asked_ns=0, robot_ns=1_010, answered_ns=10)
    assert clock.time_ns(10) == 1_010


# All robots of a process, measured in a thread.


class Pauses(threading.Event):
    """An event that waits until it is set, however short the requested pause is.

    `asked` holds the requested length of each, and the robots measured before it.
    """

    def __init__(self, measured: Mapping[str, int]) -> None:
        super().__init__()
        self.asked: list[tuple[float | None, tuple[str, ...]]] = []
        self._measured = measured
        self._changed = threading.Condition()

    def wait(self, timeout: float | None = None) -> bool:
        with self._changed:
            self.asked.append((timeout, tuple(self._measured)))
            self._changed.notify_all()
        return super().wait(10 * LIMIT_S)

    def wait_for(self, robot: str) -> float | None:
        """Return the first pause requested after this robot was measured."""

        def after() -> list[float | None]:
            return [pause_s for pause_s, measured in self.asked if robot in measured]

        with self._changed:
            assert self._changed.wait_for(after, LIMIT_S)
            return after()[0]


class Measured:
    """Clocks measured without a network: each robot is 1 s ahead, unless it is silent."""

    def __init__(self, *silent: str) -> None:
        self.times: dict[str, int] = {}
        self.clocks = RobotClocks(lambda: 7, self._measure)
        self._pauses = self.clocks._wake = Pauses(self.times)
        self._silent = silent
        self._before = set(threading.enumerate())

    @property
    def threads(self) -> list[threading.Thread]:
        return list(set(threading.enumerate()) - self._before)

    def _measure(self, robot: str) -> bool:
        self.times[robot] = self.times.get(robot, 0) + 1
        if robot in self._silent:
            return False
        self.clocks.of(robot).observe(0, 1_000_000_000, 0)
        return True

    def follow(self, robot: str) -> float | None:
        """Follow a robot until it was measured; return the next pause."""
        self.clocks.follow(robot)
        return self._pauses.wait_for(robot)


def test_robot_without_a_follower_has_no_time() -> None:
    measured = Measured()
    assert measured.clocks.time_ns("r1") is None
    assert measured.threads == []


def test_after_the_end_no_robot_is_measured() -> None:
    measured = Measured()
    measured.clocks.close()
    measured.clocks.follow("r1")
    assert (measured.times, measured.threads) == ({}, [])


def test_a_robot_is_measured_as_soon_as_it_is_followed() -> None:
    measured = Measured()
    measured.follow("r1")
    assert measured.clocks.time_ns("r1") == 1_000_000_007
    measured.follow("r2")
    assert measured.clocks.time_ns("r2") == 1_000_000_007
    assert measured.clocks.time_ns("r3") is None
    assert measured.clocks.of("r1") is measured.clocks.of("r1")
    assert [(thread.name, thread.daemon) for thread in measured.threads] == [("robot clocks", True)]
    measured.clocks.close()
    assert measured.threads == []


def test_robots_are_measured_every_other_second() -> None:
    measured = Measured()
    assert measured.follow("r1") == 2.0
    measured.clocks.close()


def test_a_robot_that_does_not_answer_is_asked_again_soon() -> None:
    measured = Measured("r2")
    measured.follow("r1")
    assert measured.follow("r2") == 0.1
    measured.clocks.close()
    assert measured.clocks.time_ns("r2") is None


def test_the_end_does_not_wait_for_the_end_of_a_pause() -> None:
    before, measured = set(threading.enumerate()), threading.Event()

    def measure(_: str) -> bool:
        measured.set()
        return True

    clocks = RobotClocks(lambda: 7, measure)
    clocks.follow("r1")
    assert measured.wait(LIMIT_S)
    clocks.close()
    assert set(threading.enumerate()) <= before


# The queries of a request that expires.


def requester(now_ns: int) -> Requester:
    """Return a requester without a network: the test answers its queries."""
    return Requester(
        cast("LastingSession", None), Network(), Role.GROUND, "ada/1", None, lambda: now_ns
    )


def test_request_measures_the_clock_first_and_again_if_it_is_late() -> None:
    steps = requester(5 * MS).steps(COMMAND, ARM, 1.0, "r1")
    question = next(steps)
    assert question.frame is not None
    assert decode(question.frame).message == Timesync(tc1=0, ts1=5 * MS)
    request = steps.send(Timesync(tc1=70 * MS, ts1=5 * MS))
    assert request.frame is not None
    assert decode(request.frame).message == ARM
    assert request.deadline == time_bytes(1_070 * MS)
    late = CommandAck(command=ARM.command, result=AckResult.DENIED, result_param2=Reason.TOO_LATE)
    again = steps.send(late)
    assert again.service is question.service
    unstamped = steps.throw(NoAnswerError("the clock is not served"))
    assert (unstamped.frame, unstamped.deadline) == (request.frame, None)
    with pytest.raises(StopIteration) as end:
        steps.send(late)
    assert end.value.value == late


@each("known", [True, False])
def test_request_with_a_known_clock_is_one_query(known: bool) -> None:
    asking = requester(5 * MS)
    if known:
        asking.clocks.of("r1").observe(0, 70 * MS, 0)
    steps = asking.steps(COMMAND if known else PARAMETERS, ARM if known else None, 0.5, "r1")
    query = next(steps)
    assert query.deadline == (time_bytes(575 * MS) if known else None)
    with pytest.raises(StopIteration) as end:
        steps.send(b"[]")
    assert end.value.value == b"[]"


def test_error_of_a_query_ends_the_request() -> None:
    steps = requester(0).steps(PARAMETERS, None, 0.5, "r1")
    next(steps)
    with pytest.raises(NoAnswerError, match="silence"):
        steps.throw(NoAnswerError("silence"))
