"""A robot that fails or hangs: the wheels stop, and the cause is reported."""

import os
import signal
import sys
from pathlib import Path

import pytest

from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.reasons import Reason, reason_text
from tests.support.stack.processes import Crew, Running, Witness, departs
from tests.support.until import until

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[3]
FAILS_ON_SIGNAL = """
import os, signal, sys
sys.path.insert(0, sys.argv.pop(1))
import sidestep
from ground.launch.child_command import die_with_parent
from robot.core import brain
die_with_parent(int(sys.argv.pop(1)))
whole, signals = brain.step, []
signal.signal(signal.SIGUSR1, lambda number, _: signals.append(number))

def step(*given):
    if signals:
        raise ZeroDivisionError("as the test wants it")
    return whole(*given)

brain.step = step
sys.exit(sidestep.main())
"""
HANGS_ON_SIGNAL = FAILS_ON_SIGNAL.replace(
    'raise ZeroDivisionError("as the test wants it")', "import time; time.sleep(600)"
).replace(
    "whole, signals",
    "from runtime.watchdog import Watchdog; Watchdog.reset = lambda self: None\nwhole, signals",
)
"""Its watchdog would end it after a few seconds, before a busy machine has started a doctor."""


def spoilt_robot(crew: Crew, script: str, *more: str) -> Running:
    """Start a robot, the hub, that does as its script says when it receives SIGUSR1."""
    words = ("run", "robot", "--start", "0.6", "2", "0", "--listen", crew.endpoint, *more)
    start = (sys.executable, "-P", "-c", script, str(ROOT), str(os.getpid()), *words)
    robot = crew.execute(*start)
    robot.says("ready")
    return robot


def test_core_exception_stops_the_wheels_and_is_reported() -> None:
    with Crew(lockstep=True) as crew:
        robot = spoilt_robot(crew, FAILS_ON_SIGNAL, "--lockstep")
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            goto = departs(crew, witness, "goto", "5.4", "2")
            robot.send(signal.SIGUSR1)
            assert robot.ends() == 1
            until(lambda: witness.status.vehicle_reason == Reason.CORE_EXCEPTION)
            assert witness.status.vehicle == Vehicle.FAILSAFE
            assert witness.status.goal == GoalState.ABORTED
            assert witness.status.goal_reason == Reason.CORE_EXCEPTION
            assert any("vehicle FAILSAFE" in text for text in witness.texts)
            assert witness.speeds == (0, 0)
        assert "ZeroDivisionError: as the test wants it" in robot.said
        assert goto.ends() == 1
        assert reason_text(Reason.CORE_EXCEPTION) in goto.said


def test_doctor_distinguishes_suspended_from_absent_robot() -> None:
    with Crew() as crew:
        crew.plant(waits=False)
        robot = crew.robot()
        with Witness(crew.endpoint) as witness:
            witness.ready()
        watch = crew.dialling("watch")
        watch.says("STANDBY")
        robot.send(signal.SIGSTOP)
        late, doctor = crew.dialling("watch"), crew.dialling("doctor")
        assert doctor.ends() == 1
        assert f"a process listens at {crew.endpoint} but does not answer" in doctor.said
        assert "hangs" in doctor.said
        assert "restart the process" in doctor.said
        watch.says("hangs")
        assert late.ends() == 1
        assert "hangs" in late.said


def test_hanging_loop_is_distinguished_from_a_dead_process() -> None:
    """Use wall time: in lockstep the thread that hangs is one of the bus, which loses its link."""
    with Crew() as crew:
        robot = spoilt_robot(crew, HANGS_ON_SIGNAL)
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            watch = crew.dialling("watch")
            departs(crew, witness, "goto", "5.4", "2")
            told = len(witness.statuses)
            robot.send(signal.SIGUSR1)
            until(witness.standing, what="standing")
            is_active = witness.status.vehicle == Vehicle.ACTIVE
            assert is_active or witness.was_late(told), f"stopped itself: {witness.texts}"
            code, said = crew.run("doctor")
            assert code == 1, said
            assert "hangs, its process is alive but sends no heartbeat" in said
            watch.says("hangs")
