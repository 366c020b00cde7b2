"""Messages about the robot: position and motion, health, clock and mode, sonars and wheels.

Position messages need a fresh pose; global positions also need a known position of the robot.

Sonar 0 looks right and 7 left; MAVLink counts clockwise, from left to right.
Nothing is sent before the robot's own parameters are read: without its farthest range nobody knows
what no echo means.
"""

from collections.abc import Sequence
from math import atan2, cos, degrees, hypot, inf, isfinite, isnan, nan, radians, sin
from typing import Final

from gateways.mavlink import ardupilot, coordinates, robot_port
from gateways.mavlink.coordinates import place_at, place_of
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.motion.setpoints import IGNORE_YAW, SPEED
from gateways.mavlink.robot_port import Snapshot
from protocol.ring import ALL_SONARS, CONE_DEG, CONE_RAD, SONARS
from protocol.wire.enums import GoalState, Mode
from protocol.wire.messages import CycleReport, NavigatorStatus, PlanarOdometry, SonarScan
from protocol.wire.reasons import Reason
from runtime.units import MM_PER_M, NS_PER_US, UINT32

UNKNOWN_16: Final = 0xFFFF
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)
ONLY_PLACE: Final = 0xDF8
"""A type_mask that ignores all but the position."""
ESTIMATOR: Final = mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT


def pose_of(vehicle: MavVehicle) -> tuple[PlanarOdometry, coordinates.NedPose] | None:
    """Return the fresh pose of the robot, if there is one."""
    odometry = vehicle.snapshot.odometry
    if odometry is None or not coordinates.is_usable(odometry):
        return None
    return odometry, coordinates.pose_of(odometry)


def altitude_mm(vehicle: MavVehicle) -> int:
    """Return the altitude of the robot's plane above sea level."""
    return round(vehicle.origin_altitude_m * MM_PER_M)


def global_position(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return GLOBAL_POSITION_INT."""
    found = pose_of(vehicle)
    if found is None or not coordinates.knows_place(found[0]):
        return ()
    odometry, pose = found
    place = place_at(vehicle.origin, odometry.x_m, odometry.y_m)
    if place is None:
        return ()
    north_cm_s, east_cm_s = (
        coordinates.whole_cm(pose.north_m_s),
        coordinates.whole_cm(pose.east_m_s),
    )
    fields = (*place, altitude_mm(vehicle), 0, north_cm_s, east_cm_s, 0, pose.yaw_cdeg)
    return (mavlink.MAVLink_global_position_int_message(vehicle.boot_ms(now_ns), *fields),)


def local_position(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return LOCAL_POSITION_NED."""
    found = pose_of(vehicle)
    if found is None:
        return ()
    pose = found[1]
    fields = (pose.north_m, pose.east_m, 0.0, pose.north_m_s, pose.east_m_s, 0.0)
    return (mavlink.MAVLink_local_position_ned_message(vehicle.boot_ms(now_ns), *fields),)


def attitude(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return ATTITUDE; roll and pitch are 0."""
    found = pose_of(vehicle)
    if found is None:
        return ()
    pose = found[1]
    fields = (0.0, 0.0, pose.yaw_rad, 0.0, 0.0, pose.yaw_rate_rad_s)
    return (mavlink.MAVLink_attitude_message(vehicle.boot_ms(now_ns), *fields),)


def hud(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
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


def local_position_cov(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return LOCAL_POSITION_NED_COV: the upper triangle over place, velocity, acceleration."""
    found = pose_of(vehicle)
    if found is None:
        return ()
    odometry, pose = found
    covariance = [nan] * 45
    if coordinates.knows_place(odometry):
        covariance[0] = odometry.cov_yy_m2
        covariance[1] = odometry.cov_xy_m2
        covariance[9] = odometry.cov_xx_m2
        covariance[2] = covariance[10] = covariance[17] = 0.0
    place = (pose.north_m, pose.east_m, 0.0)
    rest = (pose.north_m_s, pose.east_m_s, 0.0, nan, nan, nan, covariance)
    time_us = vehicle.boot_us(now_ns)
    return (mavlink.MAVLink_local_position_ned_cov_message(time_us, ESTIMATOR, *place, *rest),)


def odometry_message(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
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
    if not coordinates.knows_place(odometry):
        return [nan] * 21
    covariance = [0.0] * 21
    covariance[0], covariance[1] = odometry.cov_yy_m2, odometry.cov_xy_m2
    covariance[5] = -odometry.cov_yh_m_rad
    covariance[6], covariance[10] = odometry.cov_xx_m2, -odometry.cov_xh_m_rad
    covariance[20] = odometry.cov_hh_rad2
    return covariance


ON_THE_WAY: Final = (
    *(GoalState.ACCEPTED, GoalState.DRIVING),
    *(GoalState.AVOIDING, GoalState.ALIGNING),
)
TO_GOALS: Final = (Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL)


def goal_status(vehicle: MavVehicle) -> NavigatorStatus | None:
    """Return the status of a robot that drives to a goal; None if it does not."""
    status = vehicle.snapshot.status
    if status is None or status.mode not in TO_GOALS or status.goal not in ON_THE_WAY:
        return None
    return status


def nav_controller(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return NAV_CONTROLLER_OUTPUT while the robot drives to a goal, as ArduPilot's Rover sends it.

    Both bearings are that of the goal: the navigator publishes no desired heading. The distance is
    infinite until the robot has first driven to a goal, and on the way to other targets before it.
    """
    status, found = goal_status(vehicle), pose_of(vehicle)
    if status is None or found is None:
        return ()
    if not all(map(isfinite, (status.goal_x_m, status.goal_y_m, status.goal_distance_m))):
        return ()
    ahead_m, left_m = status.goal_x_m - found[0].x_m, status.goal_y_m - found[0].y_m
    bearing_deg = round(degrees(coordinates.yaw_of(atan2(left_m, ahead_m)))) % 360
    distance_m = max(0, min(UNKNOWN_16, round(status.goal_distance_m)))
    fields = (0.0, 0.0, bearing_deg, bearing_deg, distance_m, 0.0, 0.0, 0.0)
    return (mavlink.MAVLink_nav_controller_output_message(*fields),)


def position_target(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return POSITION_TARGET_GLOBAL_INT while the robot drives to a goal at a known position."""
    status, found = goal_status(vehicle), pose_of(vehicle)
    if status is None or found is None or not coordinates.knows_place(found[0]):
        return ()
    place = place_at(vehicle.origin, status.goal_x_m, status.goal_y_m)
    if place is None:
        return ()
    is_free = isnan(status.goal_heading_rad)
    yaw_rad = 0.0 if is_free else coordinates.yaw_of(status.goal_heading_rad)
    mask = ONLY_PLACE if is_free else ONLY_PLACE & ~IGNORE_YAW
    head = vehicle.boot_ms(now_ns), mavlink.MAV_FRAME_GLOBAL, mask
    motion = (0.0,) * 6
    return (
        mavlink.MAVLink_position_target_global_int_message(
            *head, *place, vehicle.origin_altitude_m, *motion, yaw_rad, 0.0
        ),
    )


def gps_raw(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return GPS_RAW_INT: a 3D fix while the position is known, otherwise no fix."""
    found, time_us = pose_of(vehicle), vehicle.boot_us(now_ns)
    place = None
    if found is not None and coordinates.knows_place(found[0]):
        place = place_at(vehicle.origin, found[0].x_m, found[0].y_m)
    if found is None or place is None:
        unknown = (UNKNOWN_16, UNKNOWN_16, UNKNOWN_16, UNKNOWN_16)
        fix = mavlink.GPS_FIX_TYPE_NO_FIX
        return (mavlink.MAVLink_gps_raw_int_message(time_us, fix, 0, 0, 0, *unknown, 0xFF),)
    odometry, pose = found
    speed_cm_s = coordinates.whole_cm(hypot(pose.north_m_s, pose.east_m_s))
    fields = (*place, altitude_mm(vehicle), UNKNOWN_16, UNKNOWN_16, speed_cm_s, pose.yaw_cdeg)
    message = mavlink.MAVLink_gps_raw_int_message(
        time_us,
        mavlink.GPS_FIX_TYPE_3D_FIX,
        *fields,
        ardupilot.SATELLITES,
        alt_ellipsoid=altitude_mm(vehicle),
        h_acc=max(1, min(UINT32, round(coordinates.deviation_m(odometry) * MM_PER_M))),
        yaw=pose.yaw_cdeg or 36_000,
    )
    return (message,)


def gps_origin(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return GPS_GLOBAL_ORIGIN."""
    place = place_of(vehicle.origin.latitude_deg, vehicle.origin.longitude_deg)
    fields = (*place, altitude_mm(vehicle), vehicle.boot_us(now_ns))
    return (mavlink.MAVLink_gps_global_origin_message(*fields),)


def home_position(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return HOME_POSITION."""
    x_m, y_m = vehicle.home
    place = place_at(vehicle.origin, x_m, y_m)
    if place is None:
        return ()
    fields = (altitude_mm(vehicle), y_m, x_m, 0.0, list(LEVEL), 0.0, 0.0, 0.0)
    time_us = vehicle.boot_us(now_ns)
    return (mavlink.MAVLink_home_position_message(*place, *fields, time_us),)


MOTION_BITS: Final = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_AHRS
)
"""Bits that MAVSDK requires of a healthy vehicle; here they show the health of the odometry."""
PLACE_BITS: Final = (
    mavlink.MAV_SYS_STATUS_SENSOR_GPS | mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
)
MOTOR_BITS: Final = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
FENCE_BITS: Final = mavlink.MAV_SYS_STATUS_GEOFENCE
SONAR_BITS: Final = (
    mavlink.MAV_SYS_STATUS_SENSOR_PROXIMITY | mavlink.MAV_SYS_STATUS_OBSTACLE_AVOIDANCE
)
PREARM_BIT: Final = mavlink.MAV_SYS_STATUS_PREARM_CHECK
EVERY_BIT: Final = MOTION_BITS | PLACE_BITS | MOTOR_BITS | FENCE_BITS | SONAR_BITS | PREARM_BIT
FENCE_TROUBLE: Final = (Reason.FENCE_BREACHED, Reason.FENCE_UNREADABLE, Reason.FENCE_UNCHECKED)
FULL_LOAD: Final = 1000

MOVING: Final = mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_VELOCITY_VERT
RELATIVE: Final = mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_PRED_POS_HORIZ_REL
ABSOLUTE: Final = (
    mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_PRED_POS_HORIZ_ABS | mavlink.EKF_POS_VERT_ABS
)

UNKNOWN_TEMPERATURE: Final = 0x7FFF


def sys_status(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return SYS_STATUS; there is no battery to measure."""
    snapshot = vehicle.snapshot
    enabled = EVERY_BIT if vehicle.has_fence else EVERY_BIT & ~FENCE_BITS
    fields = (
        EVERY_BIT,
        enabled,
        health(snapshot),
        load_permille(snapshot.cycle),
        UNKNOWN_16,
        -1,
        -1,
    )
    return (mavlink.MAVLink_sys_status_message(*fields, 0, 0, 0, 0, 0, 0),)


def health(snapshot: Snapshot) -> int:
    """Return the bits of healthy subsystems."""
    status, odometry, scan = snapshot.status, snapshot.odometry, snapshot.scan
    found = 0
    if odometry is not None and coordinates.is_usable(odometry):
        found |= MOTION_BITS | (PLACE_BITS if coordinates.knows_place(odometry) else 0)
    if scan is not None and scan.valid == ALL_SONARS:
        found |= SONAR_BITS
    if status is not None:
        found |= 0 if status.vehicle_reason == Reason.WHEEL_STUCK else MOTOR_BITS
        found |= 0 if status.vehicle_reason in FENCE_TROUBLE else FENCE_BITS
    return found if robot_port.arming_faults(snapshot) else found | PREARM_BIT


def load_permille(cycle: CycleReport | None) -> int:
    """Return the part of the time budget that the control loop uses, in thousandths."""
    if cycle is None or not cycle.budget_us:
        return 0
    return min(FULL_LOAD, round(FULL_LOAD * sum(cycle.stage_us) / cycle.budget_us))


def battery_status(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return BATTERY_STATUS, all unknown; without it QGroundControl requests all streams again."""
    kind = (mavlink.MAV_BATTERY_FUNCTION_UNKNOWN, mavlink.MAV_BATTERY_TYPE_UNKNOWN)
    fields = (UNKNOWN_TEMPERATURE, [UNKNOWN_16] * 10, -1, -1, -1, -1)
    return (mavlink.MAVLink_battery_status_message(0, *kind, *fields),)


def ekf_status(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return EKF_STATUS_REPORT; variances above 0.8 are shown as errors."""
    odometry = vehicle.snapshot.odometry
    flags, place_m2, yaw_rad2 = mavlink.EKF_UNINITIALIZED, 0.0, 0.0
    if odometry is not None and coordinates.is_usable(odometry):
        flags = MOVING | RELATIVE
        if coordinates.knows_place(odometry):
            flags |= ABSOLUTE
            place_m2, yaw_rad2 = (
                coordinates.deviation_m(odometry) ** 2,
                max(0.0, odometry.cov_hh_rad2),
            )
    return (mavlink.MAVLink_ekf_status_report_message(flags, 0.0, place_m2, 0.0, yaw_rad2, 0.0),)


def system_time(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return SYSTEM_TIME."""
    offset_ns = vehicle.unix_offset_ns
    unix_us = 0 if offset_ns is None else (now_ns + offset_ns) // NS_PER_US
    return (mavlink.MAVLink_system_time_message(unix_us, vehicle.boot_ms(now_ns)),)


def extended_state(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return EXTENDED_SYS_STATE: on the ground."""
    ground = mavlink.MAV_LANDED_STATE_ON_GROUND
    return (mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, ground),)


def current_mode(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return CURRENT_MODE."""
    state = ardupilot.state_of(vehicle.snapshot, vehicle.modes.number)
    return (ardupilot.current_mode(state.mode),)


def autopilot_version(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return AUTOPILOT_VERSION."""
    return (ardupilot.autopilot_version(vehicle.port.name, vehicle.commit),)


LEFTMOST_DEG: Final = -CONE_DEG * (SONARS - 1) / 2
UNUSED: Final = 0xFFFF
DISTANCES: Final = 72
MIN_CM: Final = 0
SECTOR_RAD: Final = radians(45.0)
VERTICAL_RAD: Final = CONE_RAD
NOT_MEASURED: Final = 0xFF
SECTORS: Final = (
    (mavlink.MAV_SENSOR_ROTATION_YAW_270, (7,)),
    (mavlink.MAV_SENSOR_ROTATION_YAW_315, (6, 5)),
    (mavlink.MAV_SENSOR_ROTATION_NONE, (4, 3)),
    (mavlink.MAV_SENSOR_ROTATION_YAW_45, (2, 1)),
    (mavlink.MAV_SENSOR_ROTATION_YAW_90, (0,)),
)
"""The sonars of each sector of 45 degrees, clockwise from the left."""
WHEELS: Final = 16


def max_cm(vehicle: MavVehicle) -> int | None:
    """Return the farthest range of a sonar, None while it is unknown."""
    longest_m = vehicle.parameters.get("sonar_max_m")
    return None if longest_m is None else round(longest_m * 100)


def ranges_m(scan: SonarScan) -> list[float | None]:
    """Return the range of each sonar: infinite without an echo, None if it has failed."""
    found: list[float | None] = []
    for sonar, range_mm in enumerate(scan.range_mm):
        bit = 1 << sonar
        if not scan.valid & bit:
            found.append(None)
        else:
            found.append(range_mm / 1000 if scan.echo & bit else inf)
    return found


def obstacle_distance(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return OBSTACLE_DISTANCE: max + 1 without an echo, 65535 for a failed sonar."""
    scan, longest_cm = vehicle.snapshot.scan, max_cm(vehicle)
    if scan is None or longest_cm is None:
        return ()
    distances = [UNUSED] * DISTANCES
    for place, range_m in enumerate(reversed(ranges_m(scan))):
        if range_m is not None:
            distances[place] = round(min(range_m * 100, longest_cm + 1))
    message = mavlink.MAVLink_obstacle_distance_message(
        vehicle.boot_us(now_ns),
        mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND,
        distances,
        int(CONE_DEG),
        MIN_CM,
        longest_cm,
        increment_f=CONE_DEG,
        angle_offset=LEFTMOST_DEG,
        frame=mavlink.MAV_FRAME_BODY_FRD,
    )
    return (message,)


def distance_sensors(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return a DISTANCE_SENSOR per sector, with the nearest echo of its sonars.

    Without an echo it is the farthest range. A sector whose sonars have all failed is not sent. A
    touching obstacle is shown at 1 cm, because Mission Planner ignores ranges of 0.
    """
    scan, longest_cm = vehicle.snapshot.scan, max_cm(vehicle)
    if scan is None or longest_cm is None:
        return ()
    measured, time_ms = ranges_m(scan), vehicle.boot_ms(now_ns)
    found = []
    for number, (rotation, sonars) in enumerate(SECTORS):
        inside = [range_m for sonar in sonars if (range_m := measured[sonar]) is not None]
        if inside:
            here_cm = max(1, round(min(*inside, longest_cm / 100) * 100))
            fields = (MIN_CM, longest_cm, here_cm, mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND)
            message = mavlink.MAVLink_distance_sensor_message(
                *(time_ms, *fields, number, rotation, NOT_MEASURED),
                horizontal_fov=SECTOR_RAD,
                vertical_fov=VERTICAL_RAD,
            )
            found.append(message)
    return found


def rangefinder(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return RANGEFINDER: the nearest echo; the farthest range if there is none."""
    scan, longest_cm = vehicle.snapshot.scan, max_cm(vehicle)
    measured = [] if scan is None else [one for one in ranges_m(scan) if one is not None]
    if not measured or longest_cm is None:
        return ()
    return (mavlink.MAVLink_rangefinder_message(min(*measured, longest_cm / 100), 0.0),)


def wheel_distance(vehicle: MavVehicle, now_ns: int) -> Sequence[MavMessage]:
    """Return WHEEL_DISTANCE: the distances of the left and the right wheel."""
    vehicle.port.need_wheels(now_ns)
    wheels, m_per_tick = vehicle.snapshot.wheels, vehicle.parameters.get("m_per_tick")
    if wheels is None or m_per_tick is None:
        return ()
    distances_m = [0.0] * WHEELS
    distances_m[:2] = wheels.left * m_per_tick, wheels.right * m_per_tick
    return (mavlink.MAVLink_wheel_distance_message(vehicle.boot_us(now_ns), 2, distances_m),)
