"""Cycles in lockstep, and the watchdog of a loop that hangs."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest

from checks.harness.until import PATIENCE_S, until
from runtime.clock import Tick, ticks
from runtime.lockstep import LockstepClock, LockstepLoop
from runtime.units import CONTROL_HZ, PERIOD_NS
from runtime.watchdog import Watchdog
from tests.support.each import each

NEVER_S = 60.0


class Room:
    """A loop whose cycles and idle calls are noted, each with its thread."""

    def __init__(self, patience_s: float = NEVER_S, *, blocking: bool = False) -> None:
        self.clock = LockstepClock()
        self.loop = LockstepLoop(
            self.clock,
            ticks(self.clock, CONTROL_HZ),
            self._note_idle,
            patience_s,
            blocking=blocking,
        )
        self.cycles: list[tuple[Tick, int]] = []
        self.idle: list[int] = []
        self.on_cycle: Callable[[], None] = lambda: None
        self.on_idle: Callable[[], None] = lambda: None
        self.error: Exception | None = None

    def run(self) -> None:
        try:
            self.loop.run(self._note_cycle)
        except Exception as error:
            self.error = error

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the loop in another thread until the block ends."""
        runner = threading.Thread(target=self.run)
        runner.start()
        self.loop.nudge()
        until(lambda: self.idle or not runner.is_alive(), what="the loop runs")
        try:
            yield
        finally:
            self.loop.stop()
            runner.join()

    def _note_cycle(self, tick: Tick) -> None:
        self.cycles.append((tick, threading.get_ident()))
        self.on_cycle()

    def _note_idle(self) -> None:
        self.idle.append(threading.get_ident())
        self.on_idle()


def test_a_cycle_runs_in_the_thread_that_advances_the_clock() -> None:
    room = Room()
    with room.running():
        room.loop.advance_to(0)
        room.loop.advance_to(PERIOD_NS)
    assert [tick.index for tick, _ in room.cycles] == [0, 1]
    assert {thread for _, thread in room.cycles} == {threading.get_ident()}
    assert threading.get_ident() not in room.idle


def test_a_cycle_that_blocks_holds_up_neither_the_clock_nor_a_nudge() -> None:
    room, entered, may_go_on = Room(blocking=True), threading.Event(), threading.Event()

    def wait() -> None:
        entered.set()
        assert may_go_on.wait(PATIENCE_S)

    with room.running():
        room.on_cycle = wait
        room.loop.advance_to(0)
        assert entered.wait(PATIENCE_S)
        room.loop.advance_to(PERIOD_NS)
        room.loop.nudge()
        assert room.clock.now_ns() == PERIOD_NS
        assert len(room.cycles) == 1
        may_go_on.set()
        until(lambda: len(room.cycles) == 2, what="the next cycle")
    assert threading.get_ident() not in {thread for _, thread in room.cycles}


def test_the_error_of_a_cycle_that_may_block_ends_the_run() -> None:
    room = Room(blocking=True)

    def fail() -> None:
        raise ZeroDivisionError("in the core")

    room.on_cycle = fail
    with room.running():
        room.loop.advance_to(0)
        until(lambda: room.error is not None, what="the end of the run")
    assert isinstance(room.error, ZeroDivisionError)
    assert len(room.cycles) == 1


def test_a_repeated_stamp_runs_no_cycle() -> None:
    room = Room()
    with room.running():
        room.loop.advance_to(0)
        room.loop.advance_to(0)
        room.loop.advance_to(PERIOD_NS - 1)
    assert len(room.cycles) == 1


def test_skipped_periods_are_counted_as_missed() -> None:
    room = Room()
    with room.running():
        room.loop.advance_to(0)
        room.loop.advance_to(3 * PERIOD_NS)
        room.loop.advance_to(4 * PERIOD_NS)
    assert [(tick.index, tick.missed) for tick, _ in room.cycles] == [(0, 0), (3, 2), (4, 2)]


def test_a_stamp_before_the_run_is_made_up_for() -> None:
    room = Room()
    room.loop.advance_to(5 * PERIOD_NS)
    with room.running():
        assert [tick.missed for tick, _ in room.cycles] == [0]


def test_a_restarted_plant_goes_on_with_the_next_period() -> None:
    room = Room()
    with room.running():
        room.loop.advance_to(7 * PERIOD_NS)
        room.loop.advance_to(0)
    assert [tick.missed for tick, _ in room.cycles] == [0, 0]
    assert room.clock.now_ns() == 8 * PERIOD_NS


def test_idle_is_called_while_no_cycle_runs() -> None:
    room = Room(patience_s=0.001)
    with room.running():
        until(lambda: len(room.idle) > 3, what="idle calls")
    assert not room.cycles


def test_nudge_before_the_run_is_not_lost() -> None:
    room = Room()
    room.on_idle = room.loop.stop
    room.loop.nudge()
    room.run()
    assert len(room.idle) == 1


def test_nudges_before_one_idle_call_count_as_one() -> None:
    room, left = Room(), count(1)

    def nudge_twice() -> None:
        room.loop.nudge()
        room.loop.nudge()
        if next(left) == 1000:
            room.loop.stop()

    room.on_idle = nudge_twice
    room.loop.nudge()
    room.run()
    assert len(room.idle) == 1000


def test_no_cycle_and_no_idle_call_after_stop() -> None:
    room = Room()
    room.loop.stop()
    room.loop.nudge()
    room.run()
    room.loop.advance_to(0)
    assert (room.cycles, room.idle) == ([], [])


def test_an_error_in_a_cycle_ends_the_run_and_is_raised_there() -> None:
    room = Room()

    def fail() -> None:
        raise ZeroDivisionError("in the core")

    room.on_cycle = fail
    with room.running():
        room.loop.advance_to(0)
        room.loop.advance_to(PERIOD_NS)
    assert isinstance(room.error, ZeroDivisionError)
    assert len(room.cycles) == 1


def test_an_idle_call_waits_for_the_cycle_under_way() -> None:
    room, entered, may_go_on = Room(), threading.Event(), threading.Event()

    def wait() -> None:
        entered.set()
        assert may_go_on.wait(PATIENCE_S)

    with room.running():
        room.on_cycle = wait
        before = len(room.idle)
        advancing = threading.Thread(target=room.loop.advance_to, args=(0,))
        advancing.start()
        assert entered.wait(PATIENCE_S)
        room.loop.nudge()
        assert len(room.idle) == before
        may_go_on.set()
        advancing.join()
        until(lambda: len(room.idle) > before, what="the idle call")


def test_grid_ends_instead_of_waiting_for_a_stamp() -> None:
    with pytest.raises(StopIteration):
        next(ticks(LockstepClock(), CONTROL_HZ))


ROOT = Path(__file__).parents[3]
LOOP = """
import ctypes, signal, sys, time
from pathlib import Path
from runtime.watchdog import Watchdog
from checks.harness.until import PATIENCE_S
trace = Path(sys.argv[2]) if len(sys.argv) > 2 else None
left_s = lambda: signal.getitimer(signal.ITIMER_REAL)[0]
with Watchdog(600.0, trace) as watchdog:
    before_s = 600.0
    for _ in watchdog.reset_by(range(3)):
        assert left_s() > before_s or before_s == 600.0
        while (before_s := left_s()) > 599.74: pass
    print("driven", flush=True)
    {hang}
print("ended")
"""
LAST_MOMENT = "signal.setitimer(signal.ITIMER_REAL, 0.1); "
HANGS = {
    "asleep": LAST_MOMENT + "time.sleep(600)",
    "holding Python's lock": LAST_MOMENT + "ctypes.PyDLL(None).sleep(600)",
    "busy": LAST_MOMENT + "[0 for _ in iter(int, 1)]",
}


def run(hang: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a loop, then `hang` in the last moment before the time is up."""
    return subprocess.run(
        [sys.executable, "-c", LOOP.format(hang=hang), "x", *words],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip


@each("hang", HANGS.values())
def test_hung_loop_ends_the_process_without_a_traceback(hang: str) -> None:
    done = run(hang)
    assert done.returncode == -signal.SIGALRM
    assert (done.stdout, done.stderr) == ("driven\n", "")


def test_stack_traces_of_a_hang_are_in_a_file(tmp_path: Path) -> None:
    trace = tmp_path / "hung.txt"
    done = run(HANGS["holding Python's lock"], str(trace))
    assert done.returncode == -signal.SIGALRM
    assert done.stderr == ""
    assert "most recent call first" in trace.read_text()


def test_after_the_block_the_timer_is_off(tmp_path: Path) -> None:
    done = run("pass")
    assert (done.returncode, done.stdout) == (0, "driven\nended\n")
    with Watchdog(60.0, tmp_path / "hung.txt") as watchdog:
        watchdog.reset()
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 50.0
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert (tmp_path / "hung.txt").read_text() == ""


def test_pipe_in_the_place_of_the_trace_holds_up_no_start(tmp_path: Path) -> None:
    trace = tmp_path / "hung.txt"
    os.mkfifo(trace)
    with Watchdog(600.0, trace):
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0


def test_divided_watchdog_is_reset_when_every_loop_has_given_a_sign() -> None:
    """Otherwise the loops that run would hide one that hangs."""

    class Counting(Watchdog):
        resets = 0

        def reset(self) -> None:
            self.resets += 1

    watchdog = Counting()
    first, second, third = watchdog.divided(3)
    for part in (first, second, first, second):
        part.reset()
    assert watchdog.resets == 0
    assert list(third.reset_by(range(2))) == [0, 1]
    assert watchdog.resets == 1
    assert watchdog.divided(1) == [watchdog]
