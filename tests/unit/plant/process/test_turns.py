"""The plant reports each turn of its loop, also while time is paused; else it would be killed."""

import threading
from collections.abc import Callable
from math import inf

from plant.model.configuration import LEVELS
from plant.process.loop import Process, RequestQueue, Wake
from plant.sim.simulation import Plant
from plant.world.file import load
from runtime.clock import WallClock
from tests.support.each import each
from tests.support.until import PATIENCE_S

SILENT_S = 0.02
TURNS = 3
SLOW = 0.0005
"""Times real time: a hundred seconds from one tick to the next."""


class Turns:
    """Ends the loop after a number of turns."""

    def __init__(self, wake: Wake) -> None:
        self.count = 0
        self._wake = wake

    def __call__(self) -> None:
        self.count += 1
        if self.count >= TURNS:
            self._wake.stop()


def ended(*, running: bool, drive: Callable[[Process], None]) -> int:
    """Return the number of turns before the loop ended; fail if it does not end."""
    wake = Wake()
    turns = Turns(wake)
    desk = RequestQueue(running=running, world={}, nudge=wake)
    plant = Plant(load("open"), 0, LEVELS["none"])
    process = Process(plant, [], desk, wake, SILENT_S, turn=turns)
    loop = threading.Thread(target=drive, args=(process,))
    loop.start()
    loop.join(PATIENCE_S)
    stuck = loop.is_alive()
    wake.stop()
    loop.join()
    assert not stuck
    return turns.count


@each("running", [True, False])
@each("speed", [inf, SLOW])
def test_loop_reports_progress_in_lockstep_paused_or_slow(running: bool, speed: float) -> None:
    assert ended(running=running, drive=lambda process: process.run_lockstep(speed)) >= TURNS


@each("running", [True, False])
def test_loop_reports_progress_in_wall_time(running: bool) -> None:
    assert ended(running=running, drive=lambda process: process.run_wall(WallClock())) >= TURNS


def test_wake_ups_without_a_waiter_do_not_accumulate() -> None:
    """Send a wake-up per command and request in wall time, where the loop never waits."""
    wake = Wake()
    for _ in range(10_000):
        wake()
    assert wake.wait(0.0)
    assert not wake.wait(0.0)
    wake()
    assert wake.wait(0.0), "and it is not deaf afterwards"


@each("called", [True, False])
def test_stop_wakes_the_loop(called: bool) -> None:
    wake = Wake()
    if called:
        wake()
    wake.stop()
    assert wake.wait(0.0)
    assert wake.stopping
