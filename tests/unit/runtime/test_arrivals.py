"""The pulse wakes the loop when a frame arrives, and keeps only the newest arrival."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from time import monotonic, monotonic_ns

from plant.process.loop import Wake
from runtime.clock import Pulse, WakeUp, ticks
from runtime.lockstep import LockstepClock, LockstepLoop
from runtime.units import CONTROL_HZ, NS_PER_S
from tests.support.each import each
from tests.support.until import PATIENCE_S

WAIT_S = 0.02
RESCUED_S = PATIENCE_S


def stepping(step_ns: int) -> Iterator[int]:
    return count(0, step_ns)


def test_earlier_beat_is_returned_once() -> None:
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


def test_a_beat_taken_without_a_wait_does_not_end_the_next_wait() -> None:
    times = iter([0, 1_000_000])
    pulse = Pulse(now_ns=lambda: next(times))
    pulse.beat(7)
    assert pulse.wait_until(0) == 7
    assert pulse.wait_until(1_000_000) is None


def test_several_wake_ups_end_one_wait() -> None:
    wake_up = WakeUp()
    for _ in range(3):
        wake_up.wake()
    assert wake_up.wait()
    assert not wake_up.wait(0.0)
    assert not wake_up.wait(-1.0)


class ReleasedMeanwhile:
    """Imitates a lock that another thread releases between the check and the release."""

    locked = staticmethod(lambda: True)

    @staticmethod
    def release() -> None:
        raise RuntimeError("release unlocked lock")


def test_two_threads_may_wake_at_once() -> None:
    wake_up = WakeUp()
    vars(wake_up)["_held"] = ReleasedMeanwhile()
    wake_up.wake()


def waits_of_pulse() -> tuple[Callable[[], object], Callable[[], None]]:
    pulse = Pulse()
    deadline_ns = monotonic_ns() + round(WAIT_S * NS_PER_S)
    return lambda: pulse.wait_until(deadline_ns), lambda: pulse.beat(0)


def waits_of_lockstep() -> tuple[Callable[[], object], Callable[[], None]]:
    clock = LockstepClock()
    loop = LockstepLoop(clock, ticks(clock, CONTROL_HZ), lambda: loop.stop(), WAIT_S)
    return lambda: loop.run(lambda _tick: None), loop.stop


def waits_of_plant() -> tuple[Callable[[], object], Callable[[], None]]:
    wake = Wake()
    return lambda: wake.wait(WAIT_S) or None, wake


@contextmanager
def interrupted(handler: Callable[[], object], after_s: float) -> Iterator[None]:
    before = signal.signal(signal.SIGALRM, lambda *_: handler())
    signal.setitimer(signal.ITIMER_REAL, after_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@each("made", [waits_of_pulse, waits_of_lockstep, waits_of_plant])
def test_a_signal_handler_slower_than_the_deadline_ends_the_wait(
    made: Callable[[], tuple[Callable[[], object], Callable[[], None]]],
) -> None:
    """Cover CPython before 3.13, in which a timed SimpleQueue.get never returns then."""
    began_s = monotonic()
    wait, rescue = made()
    timer = threading.Timer(RESCUED_S, rescue)
    timer.start()

    def outlast_the_deadline() -> None:
        while monotonic() - began_s < 2 * WAIT_S:
            pass

    with interrupted(outlast_the_deadline, after_s=WAIT_S / 4):
        assert wait() is None
    assert timer.is_alive()  # nothing else has ended the wait
    timer.cancel()
    timer.join()
