"""Processes killed or suspended while the robot drives: it stops, stays still and gives the cause.

How soon it stops is in the fault matrix: each of these faults is a row of it.
"""

import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import pytest

from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.reasons import Reason, reason_text
from tests.support.stack.processes import LATE, Crew, Running, Witness, departs, moved_not
from tests.support.until import until

pytestmark = pytest.mark.stack

GOAL = ("5.4", "2")


@dataclass
class Stage:
    """A stack whose robot drives, and an observer."""

    crew: Crew
    robot: Running
    plant: Running
    goto: Running
    witness: Witness

    def in_failsafe(self) -> bool:
        return self.witness.status.vehicle == Vehicle.FAILSAFE

    def stays_still(self) -> None:
        """Require that every truth from now on shows a robot at rest."""
        seen = len(self.witness.truths)
        until(lambda: len(self.witness.truths) > seen + 10, what="half a second of truth")
        assert all(moved_not(truth) for truth, _ in tuple(self.witness.truths)[seen:])


@contextmanager
def driving(*, router: bool = False, lockstep: bool) -> Iterator[Stage]:
    with ExitStack() as scope:
        crew = scope.enter_context(Crew(router=router, lockstep=lockstep))
        plant, robot = crew.plant(waits=False), crew.robot()
        witness = scope.enter_context(Witness(crew.endpoint))
        witness.ready()
        goto = departs(crew, witness, "goto", *GOAL)
        yield Stage(crew, robot, plant, goto, witness)


def test_suspended_robot_does_not_drive_on_after_sigcont() -> None:
    """Use a router, so that the truth arrives without the robot."""
    with driving(router=True, lockstep=False) as stage:
        stage.robot.send(signal.SIGSTOP)
        until(stage.witness.standing, what="standing")
        stage.robot.send(signal.SIGCONT)
        until(stage.in_failsafe, what="FAILSAFE")
        assert stage.witness.status.vehicle_reason in LATE
        stage.stays_still()
        assert stage.witness.status.goal == GoalState.ABORTED
        assert stage.goto.ends() == 1


def test_robot_without_plant_names_what_it_lacks() -> None:
    with driving(lockstep=False) as stage:
        stage.plant.send(signal.SIGKILL)
        until(stage.in_failsafe, what="FAILSAFE")
        reason = stage.witness.status.vehicle_reason
        assert reason in LATE
        assert stage.goto.ends() == 1
        code, said = stage.crew.run("doctor")
        assert code == 1
        assert f"failsafe: {reason_text(reason)}" in said
        assert "no plant is running" in said


def test_when_goto_is_killed_guided_stops_for_want_of_an_operator() -> None:
    with driving(lockstep=True) as stage:
        stage.goto.send(signal.SIGKILL)
        until(stage.in_failsafe, what="FAILSAFE")
        assert stage.witness.status.vehicle_reason == Reason.OPERATOR_LOST
        until(stage.witness.standing, what="standing")
        stage.stays_still()


def test_ctrl_c_in_goto_aborts_the_goal() -> None:
    with driving(lockstep=True) as stage:
        stage.goto.send(signal.SIGINT)
        assert stage.goto.ends() == 130
        assert "goal aborted" in stage.goto.said
        until(lambda: stage.witness.status.goal == GoalState.ABORTED, what="ABORTED")
        assert stage.witness.status.goal_reason == Reason.BY_OPERATOR
        until(stage.witness.standing, what="standing")
