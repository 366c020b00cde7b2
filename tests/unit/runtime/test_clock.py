"""Clocks, the fixed grid and its pulse, sequences of frames, and a busy machine."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count, islice, pairwise
from pathlib import Path
from time import monotonic, monotonic_ns

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.until import PATIENCE_S, until
from plant.process import Wake
from runtime import watchdog
from runtime.clock import Clock, ManualClock, Pulse, Tick, WakeUp, WallClock, ticks
from runtime.errors import ClockStoppedError
from runtime.lockstep import LockstepClock, LockstepLoop
from runtime.sequence import MAX_LATE_NS, MAX_LATE_TICKS, Order, SequenceTracker, order_of
from runtime.units import CONTROL_HZ, NS_PER_MS, NS_PER_S
from runtime.units import PERIOD_NS as PERIOD
from runtime.watchdog import (
    MAX_SLOWDOWN,
    Patience,
    load_words,
    queued_ns,
    slowdown,
    slowdown_in,
    starved_ns,
)
from tests.support.each import each

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


LIMIT_NS = 300 * NS_PER_MS


def waited_ns(factors: Iterator[float] | float, late_ns: int = 0) -> int:
    """Return how long a wait lasts that is never answered; it wakes `late_ns` too late."""
    clock = ManualClock()

    def measured() -> float:
        return factors if isinstance(factors, float) else next(factors)

    patience, asked_ns = Patience(LIMIT_NS, clock.now_ns, measured), 0
    while left_ns := patience.left_ns():
        asked_ns += left_ns
        clock.advance(left_ns + late_ns)
    return asked_ns


def test_idle_machine_uses_up_a_limit_exactly() -> None:
    assert waited_ns(1.0) == LIMIT_NS


@each("factor", [2.0, MAX_SLOWDOWN])
def test_busy_machine_stretches_a_limit_by_its_slowdown(factor: float) -> None:
    assert waited_ns(factor) == pytest.approx(factor * LIMIT_NS, rel=0.06)


def test_load_that_ends_stretches_only_what_was_busy() -> None:
    assert waited_ns(iter([2.0, 1.0, 1.0])) == pytest.approx(1.5 * LIMIT_NS, rel=0.06)


def test_delay_of_the_waiting_process_does_not_count() -> None:
    assert waited_ns(2.0, late_ns=NS_PER_S) == waited_ns(2.0)


@pytest.mark.parametrize("limit_ns", [0, 1, 19])
def test_limit_without_length_ends_on_a_busy_machine(limit_ns: int) -> None:
    clock = ManualClock()
    patience = Patience(limit_ns, clock.now_ns, lambda: MAX_SLOWDOWN)
    for _ in range(20):
        clock.advance(NS_PER_S)
        patience.left_ns()
    assert patience.left_ns() == 0


def test_largest_slowdown_of_a_wait_is_kept_for_its_message() -> None:
    clock, factors = ManualClock(), iter([1.0, 4.0, 1.0])
    patience = Patience(LIMIT_NS, clock.now_ns, lambda: next(factors))
    for _ in range(3):
        clock.advance(LIMIT_NS // 3)
        patience.left_ns()
    assert "4 times slower" in load_words(patience.factor)
    assert load_words(1.9) == ""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.50 0.40 0.30 1/200 77", 1.0),
        ("0.50 0.40 0.30 8/200 77", 4.0),
        ("9.00 9.00 9.00 900/999 77", MAX_SLOWDOWN),
        ("no numbers", 3.0),
        ("", 3.0),
    ],
)
def test_slowdown_is_threads_ready_to_run_per_processor(
    text: str, expected: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "loadavg").write_text(text)
    monkeypatch.setattr(watchdog, "LOAD", tmp_path / "loadavg")
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(os, "getloadavg", lambda: (6.0, 0.0, 0.0), raising=False)
    assert slowdown() == expected


def test_system_without_any_measure_counts_as_idle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "LOAD", tmp_path / "missing")
    monkeypatch.delattr(os, "getloadavg", raising=False)
    assert slowdown() == 1.0


def test_only_wall_time_depends_on_the_load() -> None:
    assert slowdown_in(ManualClock())() == 1.0
    assert slowdown_in(WallClock()) is slowdown


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="needs Linux")
def test_process_that_sleeps_does_not_wait_for_a_processor() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", "import sys; print(1, flush=True); sys.stdin.read()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdout.readline()
        stat = Path(f"/proc/{process.pid}/stat")
        until(lambda: stat.read_text().rpartition(") ")[2].startswith("S"))
        before = queued_ns(process.pid)
        assert before
        assert starved_ns(before, queued_ns(process.pid)) == 0
        process.stdin.close()
    assert queued_ns(process.pid) == {}


def test_longest_wait_of_a_thread_counts() -> None:
    assert starved_ns({"1": 90, "2": 5}, {"1": 95, "2": 25, "3": 7}) == 20
    assert starved_ns({}, {}) == 0


WRAP = 1 << 32


@each(
    ("number", "order"),
    [
        (101, Order.NEWER),
        (1000, Order.NEWER),
        (100, Order.REPEATED),
        (99, Order.LATE),
        (80, Order.LATE),
        (79, Order.RESTARTED),
        (0, Order.RESTARTED),
    ],
)
def test_order_follows_from_the_distance_to_the_newest(number: int, order: Order) -> None:
    assert order_of(number, 100, 20) is order


@each(
    ("number", "newest", "order"),
    [
        (0, WRAP - 1, Order.NEWER),
        (WRAP - 1, 0, Order.LATE),
        (WRAP - 20, 0, Order.LATE),
        (WRAP - 21, 0, Order.RESTARTED),
        (5, 5, Order.REPEATED),
        (WRAP // 2 + 1, 0, Order.NEWER),
        (WRAP // 2 + 2, 0, Order.RESTARTED),
    ],
)
def test_order_continues_over_the_wrap_of_a_count(number: int, newest: int, order: Order) -> None:
    assert order_of(number, newest, 20, modulus=WRAP) is order


@each(
    ("behind", "order"),
    [(1, Order.LATE), (2, Order.RESTARTED), (3, Order.RESTARTED), (4, Order.NEWER)],
)
def test_half_of_all_counts_is_ahead(behind: int, order: Order) -> None:
    assert order_of(8 - behind, 8, 1, modulus=9) is order


@given(st.integers(0, WRAP - 1), st.integers(-(WRAP // 4), WRAP // 4))
def test_a_wrapping_count_is_ordered_like_one_that_does_not_wrap(newest: int, step: int) -> None:
    wrapped = order_of((newest + step) % WRAP, newest, 20, modulus=WRAP)
    assert wrapped is order_of(newest + step, newest, 20)


def test_stamps_may_be_as_late_as_counts() -> None:
    assert (MAX_LATE_TICKS, MAX_LATE_NS) == (20, 1_000_000_000)


def test_tracker_follows_every_frame_that_is_not_late() -> None:
    tracker = SequenceTracker(3)
    found = [tracker.take(number) for number in (10, 12, 11, 12, 9, 2, 3, 0, 13)]
    assert found == [
        *(Order.NEWER, Order.NEWER, Order.LATE, Order.REPEATED, Order.LATE),
        *(Order.RESTARTED, Order.NEWER, Order.LATE, Order.NEWER),
    ]


def test_tracker_takes_any_first_frame() -> None:
    assert SequenceTracker(3).take(-5) is Order.NEWER


ROOT = Path(__file__).resolve().parents[3]
PACKAGES = [
    "runtime",
    "protocol",
    "robot",
    "firmware",
    "plant",
    "ground",
    "gateways",
    "vehicle_check",
    "study",
    "checks",
]
WRITTEN_DOWN = re.compile(
    r"^(NS_PER_\w+|NS_PER_MS|SECOND)\b.*= *[\d(]|\b[a-z]\w* [*/] 1e9\b", re.MULTILINE
)
PORTABLE = "robot/core/"
"""Modules that run alone on a microcontroller."""


def test_only_one_module_defines_the_units_of_time() -> None:
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    paths = {
        file.relative_to(ROOT).as_posix()
        for file in files
        if WRITTEN_DOWN.search(file.read_text(encoding="utf-8"))
    }
    assert {path for path in paths if not path.startswith(PORTABLE)} == {"runtime/units.py"}


def test_a_stall_is_counted_and_not_replayed() -> None:
    clock = ManualClock()
    grid = ticks(clock, rate_hz=50.0)
    next(grid)
    clock.advance(95 * NS_PER_MS)  # four deadlines pass
    late = next(grid)
    after = next(grid)
    assert (late.index, late.missed, late.late_ns) == (4, 3, 75 * NS_PER_MS)
    assert (after.index, after.late_ns, after.due_ns) == (5, 0, 100 * NS_PER_MS)


def test_the_grid_does_not_drift() -> None:
    dues = [t.due_ns for t in islice(ticks(ManualClock(), 50.0), 1_000)]
    assert dues[-1] == 999 * 20 * NS_PER_MS


@given(st.lists(st.integers(0, 500 * NS_PER_MS), max_size=30))
def test_ticks_and_misses_add_up_at_any_cost(work: list[int]) -> None:
    clock = ManualClock()
    grid = ticks(clock, 20.0)
    seen = [next(grid)]
    for cost_ns in work:
        clock.advance(cost_ns)
        seen.append(next(grid))
    assert seen[-1].index == len(work) + seen[-1].missed
    assert all(b.due_ns - a.due_ns >= 50 * NS_PER_MS for a, b in pairwise(seen))
    assert all(tick.due_ns == tick.index * 50 * NS_PER_MS for tick in seen)


def test_the_grid_begins_with_the_first_tick() -> None:
    clock = ManualClock(start_ns=7 * NS_PER_MS)
    assert next(ticks(clock, 20.0)) == Tick(index=0, due_ns=7 * NS_PER_MS, late_ns=0, missed=0)


def test_wall_clock_waits_until_the_deadline() -> None:
    clock: Clock = WallClock()
    deadline_ns = clock.now_ns() + 2 * NS_PER_MS
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
    clock.advance_to(100 * NS_PER_MS)
    clock.advance_to(100 * NS_PER_MS)
    assert clock.now_ns() == 100 * NS_PER_MS
    assert (clock.restarts, clock.offset_ns) == (0, 0)
    assert clock.cpu_ns() > 0


def test_lockstep_time_goes_on_after_a_restart_of_the_plant() -> None:
    clock = LockstepClock()
    grid = ticks(clock, 20.0)
    ticked = []
    for stamp_ns in (900 * NS_PER_MS, 950 * NS_PER_MS, 0, 50 * NS_PER_MS, 100 * NS_PER_MS):
        clock.advance_to(stamp_ns)
        ticked.append(
            (next(grid).missed, clock.now_ns() // NS_PER_MS, clock.now_ns() - clock.offset_ns)
        )
    assert [(missed, now_ms) for missed, now_ms, _ in ticked[2:]] == [
        (ticked[1][0], 1000), (ticked[1][0], 1050), (ticked[1][0], 1100)
    ]  # fmt: skip
    assert [stamp_ns for _, _, stamp_ns in ticked[2:]] == [0, 50 * NS_PER_MS, 100 * NS_PER_MS]
    assert clock.restarts == 1


def test_lockstep_clock_does_not_wait_for_a_stamp() -> None:
    clock = LockstepClock()
    with pytest.raises(ClockStoppedError, match="no stamp of 0 ns"):
        clock.sleep_until(0)
    clock.advance_to(50 * NS_PER_MS)
    clock.sleep_until(50 * NS_PER_MS)
    with pytest.raises(ClockStoppedError):
        clock.sleep_until(50 * NS_PER_MS + 1)


def test_a_lockstep_loop_makes_one_tick_per_stamp() -> None:
    clock = LockstepClock()
    grid = ticks(clock, 20.0)
    seen = []
    for number in range(4):
        clock.advance_to(number * 50 * NS_PER_MS)
        seen.append(next(grid))
    assert [(t.index, t.due_ns, t.late_ns) for t in seen] == [
        (n, n * 50 * NS_PER_MS, 0) for n in range(4)
    ]
    assert seen[-1].missed == 0


SLACK = PERIOD // 4


class KnownArrivals:
    """Known arrivals on a clock that jumps to them."""

    def __init__(self, clock: ManualClock, arrivals_ns: list[int]) -> None:
        self._clock = clock
        self._arrivals_ns = sorted(arrivals_ns)

    def wait_until(self, deadline_ns: int) -> int | None:
        here = [at for at in self._arrivals_ns if at <= self._clock.now_ns()]
        coming = [at for at in self._arrivals_ns if self._clock.now_ns() < at <= deadline_ns]
        if not here and not coming:
            self._clock.sleep_until(deadline_ns)
            return None
        taken = here[-1] if here else coming[0]  # only the newest arrival is kept
        self._arrivals_ns = [at for at in self._arrivals_ns if at > taken]
        self._clock.sleep_until(taken)
        return taken


def run(arrivals_ms: list[float], work_ms: list[float]) -> list[Tick]:
    """Run one tick per piece of work, which takes this long."""
    clock = ManualClock()
    grid = ticks(clock, 20.0, KnownArrivals(clock, [round(at * NS_PER_MS) for at in arrivals_ms]))
    seen = []
    for cost_ms in work_ms:
        seen.append(next(grid))
        clock.advance(round(cost_ms * NS_PER_MS))
    return seen


def starts_ms(seen: list[Tick]) -> list[float]:
    """Return the start of each tick; one of the grid starts a slack after its place."""
    return [(t.due_ns + t.late_ns + (0 if t.by_frame else SLACK)) / NS_PER_MS for t in seen]


def test_every_frame_starts_a_tick_as_it_arrives() -> None:
    seen = run([0, 53, 101, 149, 200], [1] * 5)
    assert [t.due_ns / NS_PER_MS for t in seen] == [0, 53, 101, 149, 200]
    assert all(t.by_frame and t.late_ns == 0 and t.missed == 0 for t in seen)
    assert [t.index for t in seen] == [0, 1, 2, 3, 4]


def test_the_deadline_starts_the_tick_when_no_frame_comes() -> None:
    seen = run([0, 50], [1] * 5)
    assert [t.by_frame for t in seen] == [True, True, False, False, False]
    assert starts_ms(seen) == [0, 50, 112.5, 162.5, 212.5]
    assert all(t.late_ns == 0 and t.missed == 0 for t in seen)


def test_without_any_frame_the_grid_goes_by_itself() -> None:
    seen = run([], [1] * 4)
    assert [b - a for a, b in zip(starts_ms(seen), starts_ms(seen)[1:], strict=False)] == [50] * 3
    assert not any(t.by_frame or t.missed for t in seen)


def test_late_frame_sets_the_phase_of_the_next_tick() -> None:
    # From the third on the frames are 20 ms later than they were.
    seen = run([0, 50, 120, 170, 220], [1] * 5)
    assert starts_ms(seen) == [0, 50, 112.5, 170, 220]
    assert [t.by_frame for t in seen] == [True, True, False, True, True]


def test_frame_up_to_half_a_period_early_starts_the_tick() -> None:
    seen = run([0, 50, 130, 180], [1] * 5)
    assert starts_ms(seen) == [0, 50, 112.5, 130, 180]
    assert seen[-1].missed == 0


def test_a_burst_makes_no_extra_ticks() -> None:
    seen = run([0, 50, 51, 52, 53, 54, 100], [0] * 3)
    assert starts_ms(seen) == [0, 50, 100]


def test_a_backlog_delivered_at_once_makes_one_tick() -> None:
    # The link was cut for 200 ms; then all frames come together.
    seen = run([0, 250, 250.1, 250.2, 250.3, 300], [0.2] * 7)
    assert [t.due_ns / NS_PER_MS for t in seen if t.by_frame] == [0, 250, 300]


def test_continuous_frames_do_not_speed_up_the_loop() -> None:
    seen = run([n / 2 for n in range(2_400)], [0.2] * 20)
    began = starts_ms(seen)
    assert began[1] - began[0] >= 24, "once half a period early"
    assert all(b - a >= 48.5 for a, b in pairwise(began[1:]))
    assert seen[-1].missed == 0


def test_frames_of_another_phase_draw_the_grid_to_theirs() -> None:
    # From the third on the frames are 20 ms earlier than they were: each still starts its tick.
    arrivals = [0, 50, *(80 + 50 * n for n in range(40))]
    seen = run([float(at) for at in arrivals], [1] * 42)
    assert starts_ms(seen) == arrivals
    assert all(tick.by_frame and not tick.missed for tick in seen)


def test_late_tick_reports_the_delay_after_its_frame() -> None:
    seen = run([0, 50, 100], [65, 1, 1])
    assert (seen[1].due_ns, seen[1].late_ns, seen[1].missed) == (50 * NS_PER_MS, 15 * NS_PER_MS, 0)
    assert seen[2].due_ns == 100 * NS_PER_MS


def test_stall_skips_to_the_newest_frame_and_counts_misses() -> None:
    seen = run([0, 50, 100, 150, 200], [160, 1, 1])
    assert (seen[1].due_ns / NS_PER_MS, seen[1].late_ns / NS_PER_MS) == (150, 10)
    assert (seen[1].index, seen[1].missed) == (3, 2)
    assert (seen[2].index, seen[2].due_ns / NS_PER_MS) == (4, 200)


def test_stall_without_a_newer_frame_counts_misses() -> None:
    seen = run([0, 50], [175, 1, 1])
    assert (seen[1].due_ns / NS_PER_MS, seen[1].late_ns / NS_PER_MS) == (50, 125)
    assert (seen[1].index, seen[1].missed) == (3, 2)
    assert starts_ms(seen)[2] == 212.5


def test_a_stall_on_the_grid_alone_counts_whole_periods() -> None:
    seen = run([], [120, 1, 1])
    assert (seen[1].index, seen[1].missed) == (2, 1)
    assert seen[2].missed == 1


arrivals = st.lists(st.integers(0, 1_000).map(lambda tenth: tenth / 2), max_size=60)
work = st.lists(st.floats(0.0, 300.0, allow_nan=False), min_size=2, max_size=12)


@given(arrivals, work)
def test_ticks_are_at_least_half_a_period_apart(
    arrivals_ms: list[float], work_ms: list[float]
) -> None:
    seen = run(arrivals_ms, work_ms)
    assert [t.index - t.missed for t in seen] == list(range(len(seen)))
    began = starts_ms(seen)
    for before, after, cost_ms in zip(began, began[1:], work_ms, strict=False):
        if cost_ms < 50:
            assert after - before <= 50 + 50 + 12.6, "the loop never waits for two frames"
    for first, second in pairwise(seen):
        assert second.due_ns - first.due_ns >= PERIOD // 2 - SLACK - 1, "never a burst"
