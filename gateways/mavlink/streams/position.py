"""Messages about the position and the motion of the robot.

Position messages need a fresh pose; global positions also need a known position of the robot.
"""

from collections.abc import Sequence
from math import cos, hypot, inf, nan, sin
from typing import Final

from gateways.mavlink import ardupilot
from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.frames import ned
from gateways.mavlink.frames.globe import place_at, place_of
from gateways.mavlink.motion.velocity import SPEED
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.messages import PlanarOdometry

UNKNOWN_16: Final = 0xFFFF
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)
ESTIMATOR: Final = mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT


def pose_of(vehicle: Vehicle) -> tuple[PlanarOdometry, ned.NedPose] | None:
    """Return the fresh pose of the robot, if there is one."""
    odometry = vehicle.snapshot.odometry
    if odometry is None or not ned.is_usable(odometry):
        return None
    return odometry, ned.pose_of(odometry)


def altitude_mm(vehicle: Vehicle) -> int:
    """Return the altitude of the robot's plane above sea level."""
    return round(vehicle.origin_altitude_m * ned.MM_PER_M)


def global_position(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return GLOBAL_POSITION_INT."""
    found = pose_of(vehicle)
    if found is None or not ned.knows_place(found[0]):
        return ()
    odometry, pose = found
    place = place_at(vehicle.origin, odometry.x_m, odometry.y_m)
    if place is None:
        return ()
    north_cm_s, east_cm_s = ned.whole_cm(pose.north_m_s), ned.whole_cm(pose.east_m_s)
    fields = (*place, altitude_mm(vehicle), 0, north_cm_s, east_cm_s, 0, pose.yaw_cdeg)
    return (mavlink.MAVLink_global_position_int_message(vehicle.boot_ms(now_ns), *fields),)


def local_position(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return LOCAL_POSITION_NED."""
    found = pose_of(vehicle)
    if found is None:
        return ()
    pose = found[1]
    fields = (pose.north_m, pose.east_m, 0.0, pose.north_m_s, pose.east_m_s, 0.0)
    return (mavlink.MAVLink_local_position_ned_message(vehicle.boot_ms(now_ns), *fields),)


def attitude(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return ATTITUDE; roll and pitch are 0."""
    found = pose_of(vehicle)
    if found is None:
        return ()
    pose = found[1]
    fields = (0.0, 0.0, pose.yaw_rad, 0.0, 0.0, pose.yaw_rate_rad_s)
    return (mavlink.MAVLink_attitude_message(vehicle.boot_ms(now_ns), *fields),)


def hud(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return VFR_HUD; the air speed is the ground speed, as ArduPilot's Rover has it.

    The throttle is the share of the robot's own fastest speed, 0 before that parameter is read:
    MAVLink has no word for unknown here.
    """
    found = pose_of(vehicle)
    if found is None:
        return ()
    odometry, pose = found
    speed_m_s = abs(odometry.speed_m_s)
    top_m_s = vehicle.parameters.get(SPEED, inf)
    throttle = min(100, round(100 * speed_m_s / top_m_s)) if top_m_s > 0 else 0
    heading_deg = pose.yaw_cdeg // 100
    fields = (speed_m_s, speed_m_s, heading_deg, throttle, vehicle.origin_altitude_m, 0.0)
    return (mavlink.MAVLink_vfr_hud_message(*fields),)


def local_position_cov(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return LOCAL_POSITION_NED_COV: the upper triangle over place, velocity, acceleration."""
    found = pose_of(vehicle)
    if found is None:
        return ()
    odometry, pose = found
    covariance = [nan] * 45
    if ned.knows_place(odometry):
        covariance[0] = odometry.cov_yy_m2
        covariance[1] = odometry.cov_xy_m2
        covariance[9] = odometry.cov_xx_m2
        covariance[2] = covariance[10] = covariance[17] = 0.0
    place = (pose.north_m, pose.east_m, 0.0)
    rest = (pose.north_m_s, pose.east_m_s, 0.0, nan, nan, nan, covariance)
    time_us = vehicle.boot_us(now_ns)
    return (mavlink.MAVLink_local_position_ned_cov_message(time_us, ESTIMATOR, *place, *rest),)


def odometry_message(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return ODOMETRY: the place in local NED, the velocity in the frame of the body."""
    found = pose_of(vehicle)
    if found is None:
        return ()
    odometry, pose = found
    half = pose.yaw_rad / 2
    fields = (
        *(mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD),
        *(pose.north_m, pose.east_m, 0.0),
        [cos(half), 0.0, 0.0, sin(half)],
        *(odometry.speed_m_s, 0.0, 0.0),
        *(0.0, 0.0, pose.yaw_rate_rad_s),
        pose_covariance(odometry),
        [nan] * 21,
    )
    time_us = vehicle.boot_us(now_ns)
    return (mavlink.MAVLink_odometry_message(time_us, *fields, estimator_type=ESTIMATOR),)


def pose_covariance(odometry: PlanarOdometry) -> list[float]:
    """Return the upper triangle over north, east, down, roll, pitch, yaw; NaN if unknown.

    Yaw has the opposite direction of the heading, so its covariances with the position change sign.
    """
    if not ned.knows_place(odometry):
        return [nan] * 21
    covariance = [0.0] * 21
    covariance[0], covariance[1] = odometry.cov_yy_m2, odometry.cov_xy_m2
    covariance[5] = -odometry.cov_yh_m_rad
    covariance[6], covariance[10] = odometry.cov_xx_m2, -odometry.cov_xh_m_rad
    covariance[20] = odometry.cov_hh_rad2
    return covariance


def gps_raw(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return GPS_RAW_INT: a 3D fix while the position is known, otherwise no fix."""
    found, time_us = pose_of(vehicle), vehicle.boot_us(now_ns)
    place = None
    if found is not None and ned.knows_place(found[0]):
        place = place_at(vehicle.origin, found[0].x_m, found[0].y_m)
    if found is None or place is None:
        unknown = (UNKNOWN_16, UNKNOWN_16, UNKNOWN_16, UNKNOWN_16)
        fix = mavlink.GPS_FIX_TYPE_NO_FIX
        return (mavlink.MAVLink_gps_raw_int_message(time_us, fix, 0, 0, 0, *unknown, 0xFF),)
    odometry, pose = found
    speed_cm_s = ned.whole_cm(hypot(pose.north_m_s, pose.east_m_s))
    fields = (*place, altitude_mm(vehicle), UNKNOWN_16, UNKNOWN_16, speed_cm_s, pose.yaw_cdeg)
    message = mavlink.MAVLink_gps_raw_int_message(
        time_us,
        mavlink.GPS_FIX_TYPE_3D_FIX,
        *fields,
        ardupilot.SATELLITES,
        alt_ellipsoid=altitude_mm(vehicle),
        h_acc=max(1, min(0xFFFF_FFFF, round(ned.deviation_m(odometry) * ned.MM_PER_M))),
        yaw=pose.yaw_cdeg or 36_000,
    )
    return (message,)


def gps_origin(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return GPS_GLOBAL_ORIGIN."""
    place = place_of(vehicle.origin.latitude_deg, vehicle.origin.longitude_deg)
    fields = (*place, altitude_mm(vehicle), vehicle.boot_us(now_ns))
    return (mavlink.MAVLink_gps_global_origin_message(*fields),)


def home_position(vehicle: Vehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return HOME_POSITION."""
    x_m, y_m = vehicle.home
    place = place_at(vehicle.origin, x_m, y_m)
    if place is None:
        return ()
    fields = (altitude_mm(vehicle), y_m, x_m, 0.0, list(LEVEL), 0.0, 0.0, 0.0)
    time_us = vehicle.boot_us(now_ns)
    return (mavlink.MAVLink_home_position_message(*place, *fields, time_us),)
