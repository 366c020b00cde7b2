"""Waiting in lockstep: the waiting thread can do other work while the time pauses."""

import threading
from itertools import count

import pytest

from runtime.errors import ClockStoppedError
from runtime.lockstep import LockstepClock

MS = 1_000_000


def test_idle_is_called_after_the_patience() -> None:
    clock = LockstepClock(patience_s=0.001, idle=lambda: clock.advance_to(50 * MS))
    clock.sleep_until(50 * MS)
    assert clock.now_ns() == 50 * MS


def test_nudge_calls_idle_without_advancing_time() -> None:
    stamps: list[int] = []

    def idle() -> None:
        stamps.append(clock.now_ns())
        clock.advance_to(50 * MS)

    clock = LockstepClock(idle=idle)
    nudger = threading.Thread(target=clock.nudge)
    nudger.start()
    clock.sleep_until(50 * MS)
    nudger.join()
    assert stamps == [0]


def test_a_nudge_before_the_wait_is_not_lost() -> None:
    called: list[str] = []

    def idle() -> None:
        called.append("idle")
        clock.stop()

    clock = LockstepClock(idle=idle)
    clock.nudge()
    with pytest.raises(ClockStoppedError):
        clock.sleep_until(50 * MS)
    assert called == ["idle"]


def test_reached_stamp_has_priority_over_nudge_and_stop() -> None:
    clock = LockstepClock(idle=lambda: pytest.fail("nothing to wait for"))
    clock.advance_to(50 * MS)
    clock.nudge()
    clock.stop()
    clock.sleep_until(50 * MS)


def test_nudge_without_idle_has_no_effect() -> None:
    clock = LockstepClock()
    clock.nudge()
    threading.Thread(target=clock.advance_to, args=(0,)).start()
    clock.sleep_until(0)
    assert clock.now_ns() == 0


def test_nudges_before_one_wait_count_as_one() -> None:
    nudges = count(1)

    def idle() -> None:
        clock.nudge()
        clock.nudge()
        if next(nudges) == 1000:
            clock.advance_to(50 * MS)

    clock = LockstepClock(idle=idle)
    clock.nudge()
    clock.sleep_until(50 * MS)
    assert next(nudges) == 1001
