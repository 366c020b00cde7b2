"""Messages about the health of the robot, its battery, estimator, clock and mode."""

from collections.abc import Sequence
from typing import Final

from gateways.mavlink import ardupilot, prearm
from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.frames import ned
from gateways.mavlink.port import Snapshot
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.messages import CycleReport
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_US

MOTION: Final = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_AHRS
)
"""Bits that MAVSDK requires of a healthy vehicle; here they show the health of the odometry."""
PLACE: Final = mavlink.MAV_SYS_STATUS_SENSOR_GPS | mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
MOTORS: Final = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
FENCE: Final = mavlink.MAV_SYS_STATUS_GEOFENCE
SONARS: Final = mavlink.MAV_SYS_STATUS_SENSOR_PROXIMITY | mavlink.MAV_SYS_STATUS_OBSTACLE_AVOIDANCE
PREARM: Final = mavlink.MAV_SYS_STATUS_PREARM_CHECK
EVERY: Final = MOTION | PLACE | MOTORS | FENCE | SONARS | PREARM
ALL_SONARS: Final = 0xFF
FENCE_TROUBLE: Final = (Reason.FENCE_BREACHED, Reason.FENCE_UNREADABLE, Reason.FENCE_UNCHECKED)
FULL_LOAD: Final = 1000

MOVING: Final = mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_VELOCITY_VERT
RELATIVE: Final = mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_PRED_POS_HORIZ_REL
ABSOLUTE: Final = (
    mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_PRED_POS_HORIZ_ABS | mavlink.EKF_POS_VERT_ABS
)

UNKNOWN_16: Final = 0xFFFF
UNKNOWN_TEMPERATURE: Final = 0x7FFF


def sys_status(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return SYS_STATUS; there is no battery to measure."""
    snapshot = vehicle.snapshot
    enabled = EVERY if vehicle.has_fence else EVERY & ~FENCE
    fields = (EVERY, enabled, health(snapshot), load(snapshot.cycle), UNKNOWN_16, -1, -1)
    return (mavlink.MAVLink_sys_status_message(*fields, 0, 0, 0, 0, 0, 0),)


def health(snapshot: Snapshot) -> int:
    """Return the bits of healthy subsystems."""
    status, odometry, scan = snapshot.status, snapshot.odometry, snapshot.scan
    found = 0
    if odometry is not None and ned.is_usable(odometry):
        found |= MOTION | (PLACE if ned.knows_place(odometry) else 0)
    if scan is not None and scan.valid == ALL_SONARS:
        found |= SONARS
    if status is not None:
        found |= 0 if status.vehicle_reason == Reason.WHEEL_STUCK else MOTORS
        found |= 0 if status.vehicle_reason in FENCE_TROUBLE else FENCE
    return found if prearm.faults(snapshot) else found | PREARM


def load(cycle: CycleReport | None) -> int:
    """Return the part of the time budget that the control loop uses, in thousandths."""
    if cycle is None or not cycle.budget_us:
        return 0
    return min(FULL_LOAD, round(FULL_LOAD * sum(cycle.stage_us) / cycle.budget_us))


def battery_status(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return BATTERY_STATUS, all unknown; without it QGroundControl requests all streams again."""
    kind = (mavlink.MAV_BATTERY_FUNCTION_UNKNOWN, mavlink.MAV_BATTERY_TYPE_UNKNOWN)
    fields = (UNKNOWN_TEMPERATURE, [UNKNOWN_16] * 10, -1, -1, -1, -1)
    return (mavlink.MAVLink_battery_status_message(0, *kind, *fields),)


def ekf_status(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return EKF_STATUS_REPORT; variances above 0.8 are shown as errors."""
    odometry = vehicle.snapshot.odometry
    flags, place_m2, yaw_rad2 = mavlink.EKF_UNINITIALIZED, 0.0, 0.0
    if odometry is not None and ned.is_usable(odometry):
        flags = MOVING | RELATIVE
        if ned.knows_place(odometry):
            flags |= ABSOLUTE
            place_m2, yaw_rad2 = ned.deviation_m(odometry) ** 2, max(0.0, odometry.cov_hh_rad2)
    return (mavlink.MAVLink_ekf_status_report_message(flags, 0.0, place_m2, 0.0, yaw_rad2, 0.0),)


def system_time(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return SYSTEM_TIME."""
    offset_ns = vehicle.unix_offset_ns
    unix_us = 0 if offset_ns is None else (now_ns + offset_ns) // NS_PER_US
    return (mavlink.MAVLink_system_time_message(unix_us, vehicle.boot_ms(now_ns)),)


def extended_state(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return EXTENDED_SYS_STATE: on the ground."""
    ground = mavlink.MAV_LANDED_STATE_ON_GROUND
    return (mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, ground),)


def current_mode(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return CURRENT_MODE."""
    state = ardupilot.state_of(vehicle.snapshot, vehicle.modes.number)
    return (ardupilot.current_mode(state.mode),)


def autopilot_version(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return AUTOPILOT_VERSION."""
    return (ardupilot.autopilot_version(vehicle.port.name, vehicle.commit),)
