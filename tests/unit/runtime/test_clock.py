"""Clocks, and the fixed grid without a pulse."""

from itertools import islice, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.clock import Clock, ManualClock, Tick, WallClock, ticks
from runtime.errors import ClockStoppedError
from runtime.lockstep import LockstepClock

MS = 1_000_000


def test_a_stall_is_counted_and_not_replayed() -> None:
    clock = ManualClock()
    grid = ticks(clock, rate_hz=50.0)
    next(grid)
    clock.advance(95 * MS)  # four deadlines pass
    late = next(grid)
    after = next(grid)
    assert (late.index, late.missed, late.late_ns) == (4, 3, 75 * MS)
    assert (after.index, after.late_ns, after.due_ns) == (5, 0, 100 * MS)


def test_the_grid_does_not_drift() -> None:
    dues = [t.due_ns for t in islice(ticks(ManualClock(), 50.0), 1_000)]
    assert dues[-1] == 999 * 20 * MS


@given(st.lists(st.integers(0, 500 * MS), max_size=30))
def test_ticks_and_misses_add_up_at_any_cost(work: list[int]) -> None:
    clock = ManualClock()
    grid = ticks(clock, 20.0)
    seen = [next(grid)]
    for cost_ns in work:
        clock.advance(cost_ns)
        seen.append(next(grid))
    assert seen[-1].index == len(work) + seen[-1].missed
    assert all(b.due_ns - a.due_ns >= 50 * MS for a, b in pairwise(seen))
    assert all(tick.due_ns == tick.index * 50 * MS for tick in seen)


def test_the_grid_begins_with_the_first_tick() -> None:
    clock = ManualClock(start_ns=7 * MS)
    assert next(ticks(clock, 20.0)) == Tick(index=0, due_ns=7 * MS, late_ns=0, missed=0)


def test_wall_clock_waits_until_the_deadline() -> None:
    clock: Clock = WallClock()
    deadline_ns = clock.now_ns() + 2 * MS
    clock.sleep_until(deadline_ns)
    assert clock.now_ns() >= deadline_ns
    clock.sleep_until(0)
    assert clock.cpu_ns() > 0


def test_the_manual_clock_never_goes_back() -> None:
    clock = ManualClock(start_ns=100)
    clock.sleep_until(50)
    assert (clock.now_ns(), clock.cpu_ns()) == (100, 100)


def test_lockstep_time_is_the_newest_stamp() -> None:
    clock = LockstepClock(start_ns=5)
    assert clock.now_ns() == 5
    clock.advance_to(100 * MS)
    clock.advance_to(100 * MS)
    assert clock.now_ns() == 100 * MS
    assert (clock.restarts, clock.offset_ns) == (0, 0)
    assert clock.cpu_ns() > 0


def test_lockstep_time_goes_on_after_a_restart_of_the_plant() -> None:
    clock = LockstepClock()
    grid = ticks(clock, 20.0)
    ticked = []
    for stamp_ns in (900 * MS, 950 * MS, 0, 50 * MS, 100 * MS):
        clock.advance_to(stamp_ns)
        ticked.append((next(grid).missed, clock.now_ns() // MS, clock.now_ns() - clock.offset_ns))
    assert [(missed, now_ms) for missed, now_ms, _ in ticked[2:]] == [
        (ticked[1][0], 1000), (ticked[1][0], 1050), (ticked[1][0], 1100)
    ]  # fmt: skip
    assert [stamp_ns for _, _, stamp_ns in ticked[2:]] == [0, 50 * MS, 100 * MS]
    assert clock.restarts == 1


def test_lockstep_clock_does_not_wait_for_a_stamp() -> None:
    clock = LockstepClock()
    with pytest.raises(ClockStoppedError, match="no stamp of 0 ns"):
        clock.sleep_until(0)
    clock.advance_to(50 * MS)
    clock.sleep_until(50 * MS)
    with pytest.raises(ClockStoppedError):
        clock.sleep_until(50 * MS + 1)


def test_a_lockstep_loop_makes_one_tick_per_stamp() -> None:
    clock = LockstepClock()
    grid = ticks(clock, 20.0)
    seen = []
    for number in range(4):
        clock.advance_to(number * 50 * MS)
        seen.append(next(grid))
    assert [(t.index, t.due_ns, t.late_ns) for t in seen] == [(n, n * 50 * MS, 0) for n in range(4)]
    assert seen[-1].missed == 0
