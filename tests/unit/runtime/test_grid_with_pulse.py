"""The grid with a pulse: a frame starts the tick, or the deadline if none arrives."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from runtime.clock import ManualClock, Tick, ticks

MS = 1_000_000
PERIOD = 50 * MS
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
    grid = ticks(clock, 20.0, KnownArrivals(clock, [round(at * MS) for at in arrivals_ms]))
    seen = []
    for cost_ms in work_ms:
        seen.append(next(grid))
        clock.advance(round(cost_ms * MS))
    return seen


def starts_ms(seen: list[Tick]) -> list[float]:
    """Return the start of each tick; one of the grid starts a slack after its place."""
    return [(t.due_ns + t.late_ns + (0 if t.by_frame else SLACK)) / MS for t in seen]


def test_every_frame_starts_a_tick_as_it_arrives() -> None:
    seen = run([0, 53, 101, 149, 200], [1] * 5)
    assert [t.due_ns / MS for t in seen] == [0, 53, 101, 149, 200]
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
    assert [t.due_ns / MS for t in seen if t.by_frame] == [0, 250, 300]


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
    assert (seen[1].due_ns, seen[1].late_ns, seen[1].missed) == (50 * MS, 15 * MS, 0)
    assert seen[2].due_ns == 100 * MS


def test_stall_skips_to_the_newest_frame_and_counts_misses() -> None:
    seen = run([0, 50, 100, 150, 200], [160, 1, 1])
    assert (seen[1].due_ns / MS, seen[1].late_ns / MS) == (150, 10)
    assert (seen[1].index, seen[1].missed) == (3, 2)
    assert (seen[2].index, seen[2].due_ns / MS) == (4, 200)


def test_stall_without_a_newer_frame_counts_misses() -> None:
    seen = run([0, 50], [175, 1, 1])
    assert (seen[1].due_ns / MS, seen[1].late_ns / MS) == (50, 125)
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
