"""Processes killed while the robot drives in wall time: it stops in time and gives the cause.

Times on the plant's clock have the resolution of the truth, one period of 50 ms; which of them was
the last before a kill is only known by its arrival.
"""

import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import pytest

from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.reasons import Reason, reason_text
from tests.support.stack.processes import (
    Crew,
    Running,
    Witness,
    departs,
    moved_not,
)
from tests.support.until import until

pytestmark = pytest.mark.stack

MS = 1_000_000
PERIOD_MS = 50
GOAL = ("5.4", "2")


@dataclass
class Stage:
    """A stack whose robot drives, and an observer."""

    crew: Crew
    robot: Running
    plant: Running
    goto: Running
    witness: Witness

    def seen(self, reason: Reason, since_ns: int) -> float:
        """Milliseconds from a moment to the arrival of a FAILSAFE with this reason."""
        found: list[int] = []

        def failed() -> bool:
            found[:] = [
                at_ns
                for status, at_ns in tuple(self.witness.statuses)
                if (status.vehicle, status.vehicle_reason) == (Vehicle.FAILSAFE, reason)
            ]
            return bool(found)

        until(failed, what=reason.name)
        return (found[0] - since_ns) / MS


@contextmanager
def driving(*, router: bool) -> Iterator[Stage]:
    with ExitStack() as scope:
        crew = scope.enter_context(Crew(router=router))
        plant, robot = crew.plant(waits=False), crew.robot()
        witness = scope.enter_context(Witness(crew.endpoint))
        witness.ready()
        goto = departs(crew, witness, "goto", *GOAL)
        yield Stage(crew, robot, plant, goto, witness)


@pytest.fixture
def stage() -> Iterator[Stage]:
    """Start a stack whose robot is the hub."""
    with driving(router=False) as found:
        yield found


@pytest.fixture
def routed() -> Iterator[Stage]:
    """Start a stack with a router, so that the truth arrives without the robot."""
    with driving(router=True) as found:
        yield found


def kill(victim: Running, number: signal.Signals = signal.SIGKILL) -> int:
    """Send the signal; return the time in ns."""
    victim.send(number)
    return time.monotonic_ns()


def stops_in_time(stage: Stage) -> None:
    assert stage.witness.rolled_on_ms() <= 200 + PERIOD_MS


def test_wheels_stop_within_200_ms_of_the_robots_death(routed: Stage) -> None:
    kill(routed.robot)
    stops_in_time(routed)


def test_suspended_robot_does_not_drive_on_after_sigcont(routed: Stage) -> None:
    kill(routed.robot, signal.SIGSTOP)
    stops_in_time(routed)
    let_go_ns = kill(routed.robot, signal.SIGCONT)
    assert routed.seen(Reason.BUDGET, let_go_ns) < 250
    seen = len(routed.witness.truths)
    until(lambda: len(routed.witness.truths) > seen + 10, what="half a second of truth")
    assert all(moved_not(truth) for truth, _ in tuple(routed.witness.truths)[seen:])
    assert routed.witness.status.goal == GoalState.ABORTED
    assert routed.goto.ends() == 1


def test_restarted_robot_stays_still_and_disarmed(stage: Stage) -> None:
    stage.robot.send(signal.SIGKILL)
    stage.robot.ends()
    told, heard = len(stage.witness.statuses), len(stage.witness.truths)
    stage.witness.texts.clear()
    stage.crew.robot()
    until(lambda: "started: disarmed, standing still" in stage.witness.texts, what="its words")
    until(lambda: len(stage.witness.statuses) > told + 5, what="its status")
    until(lambda: stage.witness.status.vehicle == Vehicle.STANDBY, what="STANDBY")
    assert stage.witness.status.goal == GoalState.NONE
    assert stage.goto.ends() == 1
    # It may be back before the wheels have stopped: then they run out under its command.
    until(lambda: len(stage.witness.truths) > heard and stage.witness.standing(), 1.0, "standing")
    seen = len(stage.witness.truths)
    until(lambda: len(stage.witness.truths) > seen + 10, what="half a second of truth")
    assert all(moved_not(truth) for truth, _ in tuple(stage.witness.truths)[seen:])


def test_robot_without_plant_stops_within_250_ms(stage: Stage) -> None:
    took_ms = stage.seen(Reason.TICKS_LOST, kill(stage.plant))
    assert took_ms <= 250
    assert stage.goto.ends() == 1
    code, said = stage.crew.run("doctor", "--timeout", "0.3")
    assert code == 1
    assert f"failsafe: {reason_text(Reason.TICKS_LOST)}" in said
    assert "no plant is running" in said


def test_when_goto_is_killed_guided_stops_for_want_of_an_operator(stage: Stage) -> None:
    took_ms = stage.seen(Reason.OPERATOR_LOST, kill(stage.goto))
    assert 1300 <= took_ms <= 1700
    until(stage.witness.standing, 1.0, "standing")


def test_ctrl_c_in_goto_aborts_the_goal(stage: Stage) -> None:
    stage.goto.send(signal.SIGINT)
    assert stage.goto.ends(2.0) == 130
    assert "goal aborted" in stage.goto.said
    until(lambda: stage.witness.status.goal == GoalState.ABORTED, 1.0, "ABORTED")
    assert stage.witness.status.goal_reason == Reason.BY_OPERATOR
    until(stage.witness.standing, 1.0, "standing")
