"""The side panel and the status line never show a stopped robot as a healthy one."""

from msgspec.structs import replace

from ground.app.panels.robot_state import SidePanel
from ground.app.panels.status import SessionInfo, status_row
from ground.app.screens.links import process_rows
from ground.app.widgets.rows import Row, Span, words_of
from protocol.topics import STATUS
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason, reason_text
from tests.support.each import each
from tests.support.tui.fakes import FakeStation
from tests.support.tui.underway import driving, status


def shown(**changes: int) -> FakeStation:
    station = driving(FakeStation())
    now_ns = station.clock.now_ns()
    message: NavigatorStatus = replace(status(now_ns), **changes)
    station.air.put(STATUS, message, now_ns)
    return station


def side_rows(station: FakeStation) -> list[Row]:
    return SidePanel().rows(station, 16, 60)


def role_of(rows: list[Row], words: str) -> str:
    return next(span.role for one in rows for span in one if span.text.strip() == words)


@each(
    ("vehicle", "name", "short", "role"),
    [
        (Vehicle.EMERGENCY_STOP, "EMERGENCY STOP", "E-STOP", "danger"),
        (Vehicle.FAILSAFE, "FAILSAFE", "FAILSAFE", "caution"),
    ],
)
@each("goal", [GoalState.NONE, GoalState.REACHED, GoalState.ABORTED])
def test_stopped_robot_has_the_colour_of_its_vehicle_state(
    vehicle: Vehicle, name: str, short: str, role: str, goal: GoalState
) -> None:
    station = shown(vehicle=vehicle, goal=goal)
    assert role_of(side_rows(station), name) == role
    status_line = [status_row(station, SessionInfo(), 120)]
    assert role_of(status_line, short) == role
    assert role_of(status_line, "▲") == role


@each(
    ("vehicle", "mark", "role"),
    [
        (Vehicle.EMERGENCY_STOP, "▲", "danger"),
        (Vehicle.FAILSAFE, "▲", "caution"),
        (Vehicle.ACTIVE, "●", "ok"),
        (Vehicle.STANDBY, "●", "ok"),
    ],
)
def test_mark_of_a_stopped_robot_is_no_mark_of_health(
    vehicle: Vehicle, mark: str, role: str
) -> None:
    station = shown(vehicle=vehicle)
    assert status_row(station, SessionInfo(), 120)[0] == Span(mark, role)
    assert role_of(process_rows(station), "● present") == role
    station.stopping_now = "E-STOP not acknowledged"
    assert status_row(station, SessionInfo(), 120)[0] == Span("▲", "danger")


@each("mode", [Mode.AUTO, Mode.HOLD, Mode.MANUAL])
def test_reason_of_the_last_stop_disappears_when_armed_again(mode: Mode) -> None:
    station = shown(
        vehicle=Vehicle.ACTIVE, mode=mode, goal=GoalState.ABORTED, goal_reason=Reason.BUDGET
    )
    assert reason_text(Reason.BUDGET) not in " ".join(map(words_of, side_rows(station)))


def test_reason_is_shown_while_the_robot_is_stopped() -> None:
    station = shown(vehicle=Vehicle.FAILSAFE, vehicle_reason=Reason.BUDGET)
    text = " ".join(map(words_of, side_rows(station)))
    assert "control loop too slow (computer busy)" in text
