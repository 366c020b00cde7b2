"""The streams of a vehicle: message, builder, default rate, rate on a slow line, and group."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple

from gateways.mavlink.catalogue import Source
from gateways.mavlink.dialect import CurrentMode, MavMessage, mavlink
from gateways.mavlink.streams import position, proximity, system_status
from gateways.mavlink.vehicle import Vehicle

RAW: Final = mavlink.MAV_DATA_STREAM_RAW_SENSORS
STATUS: Final = mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
POSITION: Final = mavlink.MAV_DATA_STREAM_POSITION
EXTRA1: Final = mavlink.MAV_DATA_STREAM_EXTRA1
EXTRA2: Final = mavlink.MAV_DATA_STREAM_EXTRA2
EXTRA3: Final = mavlink.MAV_DATA_STREAM_EXTRA3


class Stream(NamedTuple):
    """A source whose builder still needs the vehicle."""

    number: int
    build: Callable[[Vehicle, int], Sequence[MavMessage]]
    rate_hz: float
    slow_hz: float
    group: int | None = None
    copies: int = 1

    def source(self, vehicle: Vehicle) -> Source:
        """Return the source of a vehicle."""
        return Source(self.number, partial(self.build, vehicle), *self[2:])


STREAMS: Final = (
    Stream(mavlink.MAVLINK_MSG_ID_SYS_STATUS, system_status.sys_status, 2, 1, STATUS),
    Stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, position.global_position, 10, 4, POSITION),
    Stream(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, position.local_position, 10, 4, POSITION),
    Stream(mavlink.MAVLINK_MSG_ID_ATTITUDE, position.attitude, 10, 4, EXTRA1),
    Stream(mavlink.MAVLINK_MSG_ID_VFR_HUD, position.hud, 2, 2, EXTRA2),
    Stream(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED_COV, position.local_position_cov, 5, 0),
    Stream(mavlink.MAVLINK_MSG_ID_ODOMETRY, position.odometry_message, 5, 1),
    Stream(mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, proximity.obstacle_distance, 5, 4, RAW),
    Stream(mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR, proximity.distance_sensors, 5, 2, EXTRA3, 5),
    Stream(mavlink.MAVLINK_MSG_ID_RANGEFINDER, proximity.rangefinder, 2, 1, EXTRA3),
    Stream(mavlink.MAVLINK_MSG_ID_WHEEL_DISTANCE, proximity.wheel_distance, 0, 0),
    Stream(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, position.gps_raw, 1, 1, STATUS),
    Stream(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, position.gps_origin, 0, 0),
    Stream(mavlink.MAVLINK_MSG_ID_HOME_POSITION, position.home_position, 1, 0.5),
    Stream(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, system_status.battery_status, 1, 0.5, EXTRA3),
    Stream(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, system_status.ekf_status, 1, 1, EXTRA3),
    Stream(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, system_status.system_time, 1, 1, EXTRA3),
    Stream(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, system_status.extended_state, 1, 1),
    Stream(CurrentMode.id, system_status.current_mode, 0, 0),
    Stream(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, system_status.autopilot_version, 0, 0),
)
