"""The whole stack over real sockets, with the time controlled by the test."""

import pytest

from checks.harness.in_process import InProcess
from plant.world.file import load
from protocol.wire.enums import Command, GoalState, Mode, Vehicle
from protocol.wire.reasons import Reason
from study.trial.trial import Trial, run_trial


@pytest.mark.sweep(4)
@pytest.mark.parametrize("navigator", ["bug", "vgm", "vgm_memory"])
@pytest.mark.parametrize("router", [False, True], ids=["hub", "router"])
def test_the_robot_drives_around_the_box_to_its_goal(navigator: str, router: bool) -> None:
    with InProcess("box", navigator=navigator, router=router) as stack:
        assert stack.arm() == Reason.NONE
        assert stack.goto_goal() == Reason.NONE
        stack.until(stack.reached)
        stack.forward(0.5)
        stack.assert_near(5.4, 2.0, 0.0)
        assert stack.standing()
        assert stack.status.goal == GoalState.REACHED


def trajectory(router: bool, seed: int) -> str:
    """Return the digest of the run that `sidestep trial` does without a bus."""
    with InProcess("u_trap", navigator="bug", noise="default", seed=seed, router=router) as stack:
        stack.arm()
        stack.goto_goal(Mode.AUTO)
        stack.until(lambda: stack.goal_state >= GoalState.REACHED, within_s=300.0)
        return stack.digest()


def test_the_trajectory_is_the_same_with_a_bus_a_router_or_none() -> None:
    three, four = (
        run_trial(Trial(world=load("u_trap"), navigator="bug", noise="default", seed=seed)).digest
        for seed in (3, 4)
    )
    assert trajectory(router=False, seed=3) == three
    assert trajectory(router=True, seed=4) == four != three


def test_hold_stops_and_resume_goes_on_to_the_goal() -> None:
    with InProcess("open") as stack:
        stack.arm()
        stack.goto(4.0, 2.0)
        stack.until(stack.driving)
        assert stack.command(Command.DO_PAUSE_CONTINUE, 0) == Reason.NONE
        stack.forward(1.0)
        assert stack.standing()
        assert stack.status.mode == Mode.HOLD
        assert stack.command(Command.DO_PAUSE_CONTINUE, 1) == Reason.NONE
        stack.until(stack.reached)


def test_an_emergency_stop_stays_until_it_is_cleared() -> None:
    with InProcess("open") as stack:
        stack.arm()
        stack.goto(4.0, 2.0)
        stack.until(stack.driving)
        stack.command(Command.DO_FLIGHTTERMINATION, 1)
        took_s = stack.until(stack.standing, within_s=1.0)
        assert took_s <= 0.4
        assert stack.arm() == Reason.EMERGENCY_STOPPED
        assert stack.goto(4.0, 2.0) == Reason.EMERGENCY_STOPPED
        stack.command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)
        assert stack.state == Vehicle.STANDBY
        assert stack.arm() == Reason.NONE


def test_a_new_goal_replaces_the_old_one() -> None:
    with InProcess("open") as stack:
        stack.arm()
        stack.goto(4.0, 2.0)
        stack.forward(1.0)
        stack.goto(1.5, 2.6)
        stack.until(stack.reached)
        stack.assert_near(1.5, 2.6)


def test_the_robot_returns_along_its_own_trail() -> None:
    with InProcess("u_trap", navigator="bug") as stack:
        stack.arm()
        stack.goto_goal()
        stack.until(lambda: stack.truth.x_m > 3.0)
        assert stack.command(Command.NAV_RETURN_TO_LAUNCH) == Reason.NONE
        stack.until(stack.reached, within_s=200.0)
        start = stack.world.start
        stack.assert_near(start.x_m, start.y_m, within_m=0.15)
