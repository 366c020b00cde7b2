"""Killed processes: the others detect it, stop, report it, and continue after a restart."""

from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.harness import Stack


def driving_stack(stack: Stack, mode: Mode = Mode.GUIDED) -> None:
    stack.arm()
    stack.goto_goal(mode)
    stack.until(stack.driving)


def test_wheels_stop_within_200_ms_of_the_robots_death() -> None:
    with Stack("open") as stack:
        driving_stack(stack)
        stack.kill("robot")
        took_s = stack.until(stack.standing, within_s=1.0)
        assert took_s <= 0.2 + 1e-9


def test_restarted_robot_is_disarmed_with_a_text() -> None:
    with Stack("open") as stack:
        driving_stack(stack)
        stack.kill("robot")
        stack.forward(1.0)
        stack.start("robot")
        stack.reconnect()
        stack.forward(1.0)
        assert stack.standing()
        assert stack.state == Vehicle.STANDBY
        assert stack.goal_state == GoalState.NONE
        assert "started: disarmed, standing still" in stack.texts


def test_without_a_plant_the_robot_stops_with_its_reason() -> None:
    with Stack("open") as stack:
        driving_stack(stack)
        stack.kill("plant")
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=1.0)
        assert noticed_s <= 0.25 + 1e-9
        assert stack.why == Reason.TICKS_LOST
        stack.forward(0.1)
        assert stack.status.vehicle_reason == Reason.TICKS_LOST


def test_without_the_ground_station_guided_stops() -> None:
    with Stack("open") as stack:
        driving_stack(stack, Mode.GUIDED)
        stack.kill("ground")
        stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=2.0)
        assert stack.why == Reason.OPERATOR_LOST
        stack.until(stack.standing, within_s=1.0)


def test_without_the_ground_station_auto_reaches_its_goal() -> None:
    with Stack("open") as stack:
        driving_stack(stack, Mode.AUTO)
        stack.kill("ground")
        stack.until(stack.reached)
