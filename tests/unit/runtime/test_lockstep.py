"""Waiting in lockstep: whoever waits can do other things meanwhile, and time still stands still."""

import threading
from itertools import count

import pytest

from runtime.clock import LockstepClock, Stopped

MS = 1_000_000


def test_out_of_patience_the_waiter_looks_after_other_things() -> None:
    clock = LockstepClock(patience_s=0.001, idle=lambda: clock.advance_to(50 * MS))
    clock.sleep_until(50 * MS)
    assert clock.now_ns() == 50 * MS


def test_a_nudge_wakes_the_waiter_without_moving_time() -> None:
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
    with pytest.raises(Stopped):
        clock.sleep_until(50 * MS)
    assert called == ["idle"]


def test_a_stamp_that_is_there_wins_over_a_nudge_and_a_stop() -> None:
    clock = LockstepClock(idle=lambda: pytest.fail("nothing to wait for"))
    clock.advance_to(50 * MS)
    clock.nudge()
    clock.stop()
    clock.sleep_until(50 * MS)


def test_a_nudge_means_nothing_to_who_has_nothing_else_to_do() -> None:
    clock = LockstepClock()
    clock.nudge()
    threading.Thread(target=clock.advance_to, args=(0,)).start()
    clock.sleep_until(0)
    assert clock.now_ns() == 0


def test_nudges_that_come_faster_than_they_are_taken_count_as_one() -> None:
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
