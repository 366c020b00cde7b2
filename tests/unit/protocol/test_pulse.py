"""The pulse: wakes the loop when a frame arrives, and keeps only the newest arrival."""

import threading
from collections.abc import Iterator
from itertools import count
from queue import SimpleQueue

from protocol.clock import Pulse
from protocol.pulse import MAX_BEATS


def stepping(step_ns: int) -> Iterator[int]:
    return count(0, step_ns)


def test_a_beat_that_came_before_is_taken_once() -> None:
    pulse = Pulse(now_ns=lambda: 0)
    pulse.beat(7)
    assert pulse.wait_until(0) == 7
    assert pulse.wait_until(0) is None


def test_of_several_beats_the_newest_counts() -> None:
    pulse = Pulse(now_ns=lambda: 0)
    for arrived_ns in (1, 2, 3):
        pulse.beat(arrived_ns)
    assert pulse.wait_until(0) == 3
    assert pulse.wait_until(0) is None


def test_a_deadline_in_the_past_does_not_wait() -> None:
    assert Pulse(now_ns=lambda: 100).wait_until(50) is None


def test_the_deadline_ends_the_wait() -> None:
    times = stepping(400_000)
    assert Pulse(now_ns=lambda: next(times)).wait_until(1_000_000) is None


def test_a_beat_from_another_thread_ends_the_wait() -> None:
    pulse = Pulse(now_ns=lambda: 0)
    beater = threading.Thread(target=pulse.beat, args=(9,))
    beater.start()
    assert pulse.wait_until(60_000_000_000) == 9
    beater.join()


def test_beats_that_nobody_takes_cost_bounded_memory() -> None:
    pulse = Pulse()
    for arrived_ns in range(50_000):
        pulse.beat(arrived_ns)
    assert pulse._beats.qsize() <= MAX_BEATS
    assert pulse.wait_until(0) == 49_999


class Dropping(SimpleQueue[int]):
    """The bus's thread drops the oldest beat just after the loop has seen that there is one."""

    def empty(self) -> bool:
        is_empty = super().empty()
        if not is_empty:
            self.get_nowait()
        return is_empty


def test_a_beat_that_is_dropped_while_the_loop_looks_does_not_end_the_loop() -> None:
    pulse = Pulse(now_ns=lambda: 0)
    pulse._beats = Dropping()
    pulse.beat(7)
    assert pulse.wait_until(0) is None
