"""The colour of a state is never that of health after a stop, and old reasons are not shown."""

from ground.text.status_parts import present_reason, state_role, vehicle_role
from protocol.wire.enums import GoalState, Mode, Navigator, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason
from tests.support.each import each


def status(
    vehicle: int,
    mode: int = Mode.AUTO,
    goal: int = GoalState.ABORTED,
    reasons: tuple[int, int] = (0, Reason.BUDGET),
) -> NavigatorStatus:
    return NavigatorStatus(
        time_ns=0, goal_started_ns=0, goal_ended_ns=0, goal_id=7, goal_x_m=1.0, goal_y_m=2.0,
        goal_heading_rad=0.0, goal_distance_m=3.0, vehicle=vehicle, mode=mode, goal=goal,
        vehicle_reason=reasons[0], goal_reason=reasons[1], navigator=Navigator.VGM, side=1,
    )  # fmt: skip


@each("goal", list(GoalState))
@each("mode", list(Mode))
@each("vehicle", [Vehicle.EMERGENCY_STOP, Vehicle.FAILSAFE])
def test_stopped_robot_is_never_in_the_colour_of_health(
    vehicle: Vehicle, mode: Mode, goal: GoalState
) -> None:
    role = state_role(status(vehicle, mode, goal))
    assert role == {Vehicle.EMERGENCY_STOP: "danger", Vehicle.FAILSAFE: "caution"}[vehicle]
    assert role == vehicle_role(vehicle)


@each(
    ("goal", "role"),
    [
        (GoalState.DRIVING, "ok"),
        (GoalState.AVOIDING, "caution"),
        (GoalState.STUCK, "danger"),
        (GoalState.ABORTED, "danger"),
        (GoalState.REFUSED, "danger"),
    ],
)
def test_goal_gives_the_colour_of_an_armed_robot(goal: GoalState, role: str) -> None:
    assert state_role(status(Vehicle.ACTIVE, goal=goal)) == role
    assert state_role(status(Vehicle.ACTIVE, Mode.MANUAL, goal)) == "ok"


def test_unknown_vehicle_state_is_a_danger() -> None:
    assert vehicle_role(99) == "danger"
    assert vehicle_role(Vehicle.STANDBY) == "text"


def test_reason_of_a_stop_ends_with_the_stop() -> None:
    failed = (Reason.BUDGET, Reason.BUDGET)
    assert present_reason(status(Vehicle.FAILSAFE, reasons=failed)) == Reason.BUDGET
    assert present_reason(status(Vehicle.ACTIVE)) == 0
    assert present_reason(status(Vehicle.STANDBY, reasons=(0, Reason.BY_EMERGENCY_STOP))) == 0
    assert present_reason(status(Vehicle.ACTIVE, reasons=(0, Reason.EMERGENCY_STOPPED))) == 0


@each("mode", [Mode.HOLD, Mode.MANUAL])
def test_reason_of_an_old_goal_is_not_that_of_another_mode(mode: Mode) -> None:
    assert present_reason(status(Vehicle.ACTIVE, mode, reasons=(0, Reason.NO_PROGRESS))) == 0


def test_reason_of_the_goal_is_shown_until_the_next() -> None:
    stuck = status(Vehicle.ACTIVE, goal=GoalState.STUCK, reasons=(0, Reason.NO_PROGRESS))
    assert present_reason(stuck) == Reason.NO_PROGRESS
