"""A busy machine uses up less of a limit for another process, but not for ever."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from runtime import watchdog
from runtime.clock import ManualClock, WallClock
from runtime.units import NS_PER_MS, NS_PER_S
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
from tests.support.until import until

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
