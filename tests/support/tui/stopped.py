"""Define a robot that has stopped on the way to (6.4, 6.4) at 45 degrees."""

from math import radians

from msgspec.structs import replace

from ground.client.telemetry import Age, AgedMessage
from ground.station.fleet import Attention, RosterEntry
from ground.station.robot.robot_stop import StopRecord
from protocol.topics import ODOMETRY, STATUS
from protocol.wire.enums import GoalState, Vehicle
from protocol.wire.messages import NavigatorStatus, PlanarOdometry
from protocol.wire.reasons import Reason
from tests.support.tui.fakes import MS, FakeStation, S
from tests.support.tui.underway import drive_messages, driving, status

STOP_ID = 5
REASONS = {
    Vehicle.EMERGENCY_STOP: (Reason.BY_OPERATOR, Reason.BY_EMERGENCY_STOP),
    Vehicle.FAILSAFE: (Reason.BUDGET, Reason.BUDGET),
    Vehicle.STANDBY: (Reason.NONE, Reason.BY_EMERGENCY_STOP),
    Vehicle.ACTIVE: (Reason.NONE, Reason.BUDGET),
}


def stopped(vehicle: Vehicle, station: FakeStation | None = None) -> FakeStation:
    """Fill a station with a robot that we stopped 12 s ago, or that has stopped itself."""
    station = station or driving(FakeStation())
    show(station, stopped_status(vehicle, station.clock.now_ns()))
    station.last_stop_now = StopRecord(STOP_ID, station.clock.now_ns() - 12 * S, 36 * MS)
    return station


def show(station: FakeStation, shown: NavigatorStatus) -> None:
    """Put a status of r1 on the air, with wheels that stand."""
    now_ns = station.clock.now_ns()
    odometry = drive_messages(now_ns)[ODOMETRY]
    assert isinstance(odometry, PlanarOdometry)
    station.air.put(STATUS, shown, now_ns)
    station.air.put(ODOMETRY, replace(odometry, speed_m_s=0.0, yaw_rate_rad_s=0.0), now_ns)
    station.roster_now = [*(one for one in station.roster_now if one.robot != "r1")]
    station.roster_now.append(entry("r1", shown))


def stopped_status(vehicle: Vehicle, now_ns: int) -> NavigatorStatus:
    """Return the status of a stopped robot, or of one that is armed or disarmed after a stop."""
    vehicle_reason, goal_reason = REASONS[vehicle]
    return replace(
        status(now_ns, GoalState.ABORTED, vehicle),
        vehicle_reason=vehicle_reason,
        goal_reason=goal_reason,
        stop_id=STOP_ID,
        goal_x_m=6.4,
        goal_y_m=6.4,
        goal_heading_rad=radians(45),
    )


def entry(robot: str, shown: NavigatorStatus, age: Age = Age.LIVE) -> RosterEntry:
    """Return a robot of the roster with this status."""
    return RosterEntry(robot, False, Attention.NONE, "", AgedMessage(shown, 0, age))
