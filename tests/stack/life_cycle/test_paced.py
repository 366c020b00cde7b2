"""A paced simulation with processes that are slow or stand still: it waits, and stops at once."""

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread

import pytest

from protocol.wire.enums import Vehicle
from tests.support.stack.process_table import children_of, cmdline
from tests.support.stack.processes import Crew, Running, Witness
from tests.support.until import until

pytestmark = pytest.mark.stack

SUSPENDED_S, RUNNING_S = 0.4, 0.05
"""After each suspension, the plant makes up for a few ticks only."""
TRIAL = ("--world", "u_trap", "--timeout", "3", "--json")


def robot_of(up: Running) -> int | None:
    with suppress(FileNotFoundError, ProcessLookupError):
        found = [pid for pid in children_of(up.process.pid) if " robot --" in cmdline(pid)]
        return found[0] if found else None
    return None


@contextmanager
def slowed(pid: int) -> Iterator[None]:
    """Suspend a process again and again, as a busy computer does."""
    over = Event()

    def suspend_and_resume() -> None:
        with suppress(ProcessLookupError):
            while not over.wait(RUNNING_S):
                os.kill(pid, signal.SIGSTOP)
                over.wait(SUSPENDED_S)
                os.kill(pid, signal.SIGCONT)

    thread = Thread(target=suspend_and_resume)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def result_of(running: Running, within_s: float) -> dict[str, object]:
    running.ends(within_s)
    found: dict[str, object] = json.loads(running.said.splitlines()[-1])
    return found


def test_slow_robot_slows_the_simulation_and_changes_nothing() -> None:
    with Crew() as crew:
        up = crew.start("up", "--headless", *TRIAL)
        until(lambda: robot_of(up), what="the robot")
        robot = robot_of(up)
        assert robot is not None
        up.says("u_trap: to")
        with slowed(robot):
            slow = result_of(up, 120.0)
        alone, said = result_of(crew.start("trial", *TRIAL), 120.0), up.said
    assert slow["outcome"] == alone["outcome"] == "timeout", said
    assert slow["digest"] == alone["digest"]
    assert float(str(slow["wall_s"])) > 3.5
    assert "x, computer busy" in said


def test_stop_does_not_wait_for_simulated_time() -> None:
    """Suspend the plant: no tick comes, and the stop is acknowledged between two ticks."""
    with Crew(lockstep=True) as crew:
        robot, plant = crew.robot(), crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            crew.dialling("goto", "5.4", "2")
            witness.driving()
            plant.send(signal.SIGSTOP)
            stopped = crew.dialling("estop", "--json")
            assert stopped.ends() == 0, stopped.said
            plant.send(signal.SIGCONT)
            until(lambda: witness.status.vehicle == Vehicle.EMERGENCY_STOP, what="E-STOP")
            until(witness.standing, what="standing")
        assert robot.process.poll() is None
