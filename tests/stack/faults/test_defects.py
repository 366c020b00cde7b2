"""A robot that fails or hangs: the wheels stop, and the cause is reported."""

import os
import signal
import sys
from pathlib import Path

import pytest

from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.reasons import Reason, reason_text
from tests.support.stack.processes import Crew, Witness, departs
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

def step(state, inputs, params, *mark):
    if signals and mark:  # in the loop, not in a rehearsal
        raise ZeroDivisionError("as the test wants it")
    return whole(state, inputs, params, *mark)

brain.step = step
sys.exit(sidestep.main())
"""
HANGS_ON_SIGNAL = FAILS_ON_SIGNAL.replace(
    'raise ZeroDivisionError("as the test wants it")', "import time; time.sleep(30)"
)


def spoilt_robot(crew: Crew, script: str) -> tuple[str, ...]:
    words = ("run", "robot", "--start", "0.6", "2", "0", "--listen", crew.endpoint)
    return (sys.executable, "-P", "-c", script, str(ROOT), str(os.getpid()), *words)


def test_core_exception_stops_the_wheels_and_is_reported() -> None:
    with Crew() as crew:
        robot = crew.execute(*spoilt_robot(crew, FAILS_ON_SIGNAL))
        robot.says("ready")
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
        late = crew.dialling("watch")
        code, said = crew.run("doctor")
        assert code == 1
        assert f"a process listens at {crew.endpoint} but does not answer" in said
        assert "it hangs" in said
        assert "restart the process" in said
        watch.says("it hangs")
        assert late.ends() == 1
        assert "it hangs" in late.said


def test_hanging_loop_is_distinguished_from_a_dead_process() -> None:
    with Crew() as crew:
        robot = crew.execute(*spoilt_robot(crew, HANGS_ON_SIGNAL))
        robot.says("ready")
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            watch = crew.dialling("watch")
            departs(crew, witness, "goto", "5.4", "2")
            robot.send(signal.SIGUSR1)
            until(witness.standing, what="standing")
            assert witness.status.vehicle == Vehicle.ACTIVE, f"stopped itself: {witness.texts}"
            code, said = crew.run("doctor", "--timeout", "0.3")
            assert code == 1, said
            assert "robot r1 hangs" in said
            assert "its process is alive but sends no heartbeat" in said
            watch.says("robot r1 hangs")
