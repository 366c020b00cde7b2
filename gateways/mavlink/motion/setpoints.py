"""Positions, velocities and attitudes that clients stream in GUIDED, as goals and speeds.

A robot with two driven wheels cannot move sideways: it turns to the direction of a velocity. If the
requested yaw differs by more than 90 degrees, it turns away from that direction and drives
backwards.
"""

from collections.abc import Iterable
from math import atan2, copysign, cos, hypot, isfinite, pi, radians, remainder, sin
from typing import Final, NamedTuple

from gateways.mavlink.coordinates import PER_DEG, exists, heading_of, local_at, place_of
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.client.goal import FARTHEST_M, Destination, from_robot
from ground.client.teleop_sender import TTL_MS
from ground.missions.mission import Home
from ground.robot import FASTEST_DEG_S, FASTEST_M_S
from protocol.wire.messages import PlanarOdometry
from runtime.units import NS_PER_MS

SPEED: Final = "v_max_m_s"
"""The robot's parameter that limits the forward speed of goals, missions and MANUAL."""
TURN: Final = "yaw_max_rad_s"
"""The robot's parameter that limits its turns."""
REPEAT_NS: Final = 60 * NS_PER_MS
"""Interval of the speeds to the robot."""
LIFE_NS: Final = TTL_MS * NS_PER_MS
"""A speed is valid on the robot for this time; then it stops without a ramp. So the last one is
sent this long before a time-out, and the wheels stop at the time-out even if the gateway has
ended."""
TURN_GAIN_HZ: Final = 2.0
"""Turn rate per angle to the requested heading."""
FASTEST_RAD_S: Final = radians(FASTEST_DEG_S)
TURN_RAD_S: Final = 1.5
"""Fastest turn to a heading; the robot's own limit may be lower."""


class Velocity(NamedTuple):
    """A forward speed (negative: backwards), and a turn rate or a heading to turn to."""

    speed_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0
    heading_rad: float | None = None

    def twist(self, heading_rad: float | None) -> tuple[float, float]:
        """Return speed and turn rate for a robot with this heading; zero if it is unknown.

        A robot that turns to a heading drives only with the part of its speed in that direction.
        """
        speed_m_s, yaw_rate_rad_s = self.speed_m_s, self.yaw_rate_rad_s
        if self.heading_rad is not None:
            if heading_rad is None:
                return 0.0, 0.0
            error_rad = remainder(self.heading_rad - heading_rad, 2.0 * pi)
            yaw_rate_rad_s = within(TURN_GAIN_HZ * error_rad, TURN_RAD_S)
            speed_m_s *= max(0.0, cos(error_rad))
        return within(speed_m_s, FASTEST_M_S), within(yaw_rate_rad_s, FASTEST_RAD_S)


def within(value: float, limit: float) -> float:
    """Return the value, limited to the range -limit to limit."""
    return max(-limit, min(limit, value))


IGNORE_POSITION: Final = 1 | 2
IGNORE_VELOCITY: Final = 8 | 16
IGNORE_ACCELERATION: Final = 64 | 128 | 256
"""Like ArduPilot's Rover: one of these bits is enough, and a position needs none. It does not read
the bit that calls an acceleration a force, nor does this.
"""
IGNORE_YAW: Final = 1024
IGNORE_YAW_RATE: Final = 2048
ATTITUDE_IGNORE_YAW_RATE: Final = 4
ATTITUDE_IGNORE_THRUST: Final = 64

BODY_FRAMES: Final = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
LOCAL_FRAMES: Final = (
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
    *BODY_FRAMES,
)
GLOBAL_FRAMES: Final = (
    mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)
NOT_FINITE: Final = "a value is not a number"
NO_POSE: Final = "the robot's pose is not known"
NO_LIMITS: Final = "the robot's fastest speed is not known yet"


class Pose(NamedTuple):
    """The robot's pose in the world."""

    x_m: float
    y_m: float
    heading_rad: float


class SetpointError(ValueError):
    """A setpoint that cannot be executed; the text is the reason."""


def pose_in(odometry: PlanarOdometry | None) -> Pose:
    """Return the pose; SetpointError if it is unknown."""
    if odometry is None:
        raise SetpointError(NO_POSE)
    return Pose(odometry.x_m, odometry.y_m, odometry.heading_rad)


def setpoint_of(
    message: MavMessage, odometry: PlanarOdometry | None, origin: Home
) -> Destination | Velocity:
    """Return the goal or speeds of a SET_POSITION_TARGET; a position takes precedence."""
    mask = message.type_mask
    is_global = message.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
    frames = GLOBAL_FRAMES if is_global else LOCAL_FRAMES
    if message.coordinate_frame not in frames:
        raise SetpointError(f"frame {message.coordinate_frame} is none of {frames}")
    is_body = message.coordinate_frame in BODY_FRAMES
    yaw = None if mask & IGNORE_YAW else message.yaw
    if mask & IGNORE_POSITION:
        return velocity_of(message, yaw, odometry, is_body=is_body)
    if is_global:
        latitude_deg, longitude_deg = message.lat_int / PER_DEG, message.lon_int / PER_DEG
        return place_goal(origin, latitude_deg, longitude_deg, world_heading(yaw))
    require_finite((message.x, message.y))
    if message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED:
        return destination(message.y, message.x, world_heading(yaw))
    pose = pose_in(odometry)
    if is_body:
        turn = None if yaw is None else -yaw
        goal = from_robot(destination(message.x, -message.y, turn), *pose)
        return destination(goal.x_m, goal.y_m, goal.heading_rad)
    return destination(pose.x_m + message.y, pose.y_m + message.x, world_heading(yaw))


def velocity_of(
    message: MavMessage, yaw: float | None, odometry: PlanarOdometry | None, *, is_body: bool
) -> Velocity:
    """Return the speeds of a SET_POSITION_TARGET."""
    mask = message.type_mask
    has_speed, has_rate = not mask & IGNORE_VELOCITY, not mask & IGNORE_YAW_RATE
    if not mask & IGNORE_ACCELERATION:
        raise SetpointError("accelerations are not supported: ignore them by bit 6, 7 or 8")
    if not (has_speed or has_rate or yaw is not None):
        raise SetpointError("type_mask ignores position, velocity and yaw")
    ahead_m_s, right_m_s = (message.vx, message.vy) if has_speed else (0.0, 0.0)
    rate_rad_s = message.yaw_rate if has_rate else 0.0
    require_finite((ahead_m_s, right_m_s, rate_rad_s))
    speed_m_s = hypot(ahead_m_s, right_m_s)
    if has_rate:
        return Velocity(copysign(speed_m_s, ahead_m_s), -rate_rad_s)
    if is_body and right_m_s == 0.0 and yaw is None:
        return Velocity(ahead_m_s)
    wanted_rad = world_heading(yaw, pose_in(odometry) if is_body and yaw is not None else None)
    if speed_m_s == 0.0:
        return Velocity(heading_rad=wanted_rad)
    direction_rad = atan2(ahead_m_s, right_m_s)
    if is_body:
        direction_rad = pose_in(odometry).heading_rad + atan2(-right_m_s, ahead_m_s)
    if wanted_rad is not None and cos(wanted_rad - direction_rad) < 0.0:
        backwards_rad = atan2(-sin(direction_rad), -cos(direction_rad))
        return Velocity(-speed_m_s, heading_rad=backwards_rad)
    return Velocity(speed_m_s, heading_rad=direction_rad)


def attitude_of(message: MavMessage, fastest_m_s: float | None) -> Velocity:
    """Return the speeds of a SET_ATTITUDE_TARGET: thrust drives, yaw or its rate steers."""
    if message.type_mask & ATTITUDE_IGNORE_THRUST:
        raise SetpointError("type_mask ignores the thrust")
    if fastest_m_s is None:
        raise SetpointError(NO_LIMITS)
    require_finite((message.thrust,))
    speed_m_s = fastest_m_s * max(-1.0, min(1.0, message.thrust))
    if not message.type_mask & ATTITUDE_IGNORE_YAW_RATE:
        require_finite((message.body_yaw_rate,))
        return Velocity(speed_m_s, -message.body_yaw_rate)
    require_finite(message.q)
    w, x, y, z = message.q
    if not any(message.q):
        raise SetpointError("the quaternion is zero")
    yaw_rad = atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return Velocity(speed_m_s, heading_rad=heading_of(yaw_rad))


def world_heading(yaw_rad: float | None, pose: Pose | None = None) -> float | None:
    """Return the heading for a yaw, relative to a pose if one is given; NaN is no yaw."""
    if yaw_rad is None or yaw_rad != yaw_rad:
        return None
    require_finite((yaw_rad,))
    return heading_of(yaw_rad) if pose is None else pose.heading_rad - yaw_rad


def destination(x_m: float, y_m: float, heading_rad: float | None) -> Destination:
    """Return a goal; SetpointError if it is too far away for the wire format."""
    if not (abs(x_m) <= FARTHEST_M and abs(y_m) <= FARTHEST_M):
        raise SetpointError("the place is too far away")
    if heading_rad is None or heading_rad != heading_rad:
        return Destination(x_m=x_m, y_m=y_m, heading_rad=None)
    require_finite((heading_rad,))
    return Destination(x_m=x_m, y_m=y_m, heading_rad=heading_rad)


def place_goal(
    origin: Home, latitude_deg: float, longitude_deg: float, heading_rad: float | None
) -> Destination:
    """Return the goal at a position on Earth; 0/0 is no position."""
    require_finite((latitude_deg, longitude_deg))
    place = place_of(latitude_deg, longitude_deg)
    if not exists(place):
        raise SetpointError(f"no place for a goal: {latitude_deg:g}, {longitude_deg:g}")
    return destination(*local_at(origin, place), heading_rad)


def require_finite(values: Iterable[float]) -> None:
    """Raise SetpointError for NaN and infinity."""
    if not all(isfinite(value) for value in values):
        raise SetpointError(NOT_FINITE)
