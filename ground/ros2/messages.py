"""What a robot reports, as the messages of ROS 2: metres and radians, REP 103 and REP 105.

The frames are map -> odom -> base_link -> the sonars and wheels. The robot has one frame, that of
its world, so map and odom are the same; clients of Nav2 give their goals in map.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, inf, isfinite, nan, pi, sin
from typing import Final, NamedTuple

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
)
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Quaternion as Quaternion
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Transform as Transform
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__TransformStamped as TransformStamped,
)
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Twist as Twist
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__TwistWithCovariance as TwistWithCovariance,
)
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__Odometry as Odometry
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__JointState as JointState
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__LaserScan as LaserScan
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__Range as Range
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header
from rosbags.typesys.stores.ros2_jazzy import tf2_msgs__msg__TFMessage as TFMessage

from ground.ros2.offer import SONAR_FRAMES
from protocol.ring import BEARINGS_RAD, CONE_RAD, RADIUS_M, SONARS
from protocol.wire.messages import PlanarOdometry, SonarScan, WheelTicks
from runtime.units import NS_PER_S

MAP: Final = "map"
ODOM: Final = "odom"
BASE: Final = "base_link"
WHEELS: Final = ("left_wheel", "right_wheel")
JOINTS: Final = ("left_wheel_joint", "right_wheel_joint")

UNKNOWN: Final = 1e6
"""Variance of what is not measured, such as the height, in the unit of its axis."""

SPEED_VARIANCE: Final = 4e-4
YAW_RATE_VARIANCE: Final = 2.5e-3
SIDEWAYS_VARIANCE: Final = 1e-4
"""Of the velocities in m^2/s^2 and rad^2/s^2; the robot estimates none. Wheels do not slide."""

SONAR_HEIGHT_M: Final = 0.05
SONAR_MIN_M: Final = 0.02
ULTRASOUND: Final = 0


@dataclass(frozen=True, slots=True)
class Geometry:
    """The dimensions of a robot, by its parameters."""

    radius_m: float = RADIUS_M
    track_m: float = 0.2
    wheel_radius_m: float = 0.03
    m_per_tick: float = 0.0002
    sonar_max_m: float = 3.0

    @classmethod
    def of(cls, values: Mapping[str, float]) -> "Geometry":
        """Return those that are among the parameters of a robot."""
        return cls(**{name: values[name] for name in cls.__slots__ if name in values})


def time_of(stamp_ns: int) -> Time:
    """Return a time of ROS."""
    return Time(stamp_ns // NS_PER_S, stamp_ns % NS_PER_S)


def header(stamp_ns: int, frame: str) -> Header:
    """Return a header."""
    return Header(time_of(stamp_ns), frame)


def yawed(heading_rad: float) -> Quaternion:
    """Return a rotation about the vertical axis."""
    return Quaternion(0.0, 0.0, sin(heading_rad / 2), cos(heading_rad / 2))


def odometry(found: PlanarOdometry, stamp_ns: int) -> Odometry:
    """Return nav_msgs/Odometry."""
    pose = PoseWithCovariance(pose_of(found), pose_covariance(found))
    velocity = Twist(Vector3(found.speed_m_s, 0.0, 0.0), Vector3(0.0, 0.0, found.yaw_rate_rad_s))
    twist = TwistWithCovariance(velocity, TWIST_COVARIANCE)
    return Odometry(header(stamp_ns, ODOM), BASE, pose, twist)


def pose_of(found: PlanarOdometry) -> Pose:
    """Return the pose of a robot."""
    return Pose(Point(found.x_m, found.y_m, 0.0), yawed(found.heading_rad))


def pose_stamped(found: PlanarOdometry, stamp_ns: int) -> PoseStamped:
    """Return the pose with its time and frame."""
    return PoseStamped(header(stamp_ns, MAP), pose_of(found))


def diagonal(*variances: float) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Return a covariance of x, y, z, roll, pitch and yaw without correlations."""
    return np.diag(np.array(variances, np.float64)).reshape(36)


TWIST_COVARIANCE: Final = diagonal(
    SPEED_VARIANCE, SIDEWAYS_VARIANCE, UNKNOWN, UNKNOWN, UNKNOWN, YAW_RATE_VARIANCE
)


def pose_covariance(
    found: PlanarOdometry,
) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Return the covariance of the pose; a robot that does not know its place has a large one."""
    covariance = diagonal(*[UNKNOWN] * 6)
    known = (
        *(found.cov_xx_m2, found.cov_xy_m2, found.cov_xh_m_rad),
        *(found.cov_yy_m2, found.cov_yh_m_rad, found.cov_hh_rad2),
    )
    if all(map(isfinite, known)):
        covariance[[0, 1, 5, 7, 11, 35]] = known
        covariance[[6, 30, 31]] = known[1], known[2], known[4]
    return covariance


def transform(parent: str, child: str, stamp_ns: int, x_m: float, y_m: float, z_m: float,
              rotation: Quaternion) -> TransformStamped:  # fmt: skip
    """Return the place of a frame in another one."""
    where = Transform(Vector3(x_m, y_m, z_m), rotation)
    return TransformStamped(header(stamp_ns, parent), child, where)


def base_transform(found: PlanarOdometry, stamp_ns: int) -> TransformStamped:
    """Return the place of the robot."""
    rotation = yawed(found.heading_rad)
    return transform(ODOM, BASE, stamp_ns, found.x_m, found.y_m, 0.0, rotation)


def static_transforms(geometry: Geometry, stamp_ns: int) -> TFMessage:
    """Return the frames that never move: odom, and the sonars on the rim of the robot."""
    found = [transform(MAP, ODOM, stamp_ns, 0.0, 0.0, 0.0, yawed(0.0))]
    for frame, bearing_rad in zip(SONAR_FRAMES, BEARINGS_RAD, strict=True):
        x_m, y_m = geometry.radius_m * cos(bearing_rad), geometry.radius_m * sin(bearing_rad)
        rotation = yawed(bearing_rad)
        found.append(transform(BASE, frame, stamp_ns, x_m, y_m, SONAR_HEIGHT_M, rotation))
    return TFMessage(found)


def ranges(scan: SonarScan, geometry: Geometry, stamp_ns: int) -> list[tuple[int, Range]]:
    """Return number and range of each sonar that measured in this period; inf without an echo.

    The stamp is that of the ping (REP 117 for the values).
    """
    found = []
    for sonar, range_mm in enumerate(scan.range_mm):
        if scan.valid >> sonar & 1:
            measured_ns = stamp_ns - scan.ping_age_us[sonar] * 1000
            distance_m = range_mm / 1000 if scan.echo >> sonar & 1 else inf
            top = header(measured_ns, SONAR_FRAMES[sonar])
            limits = (CONE_RAD, SONAR_MIN_M, geometry.sonar_max_m)
            found.append((sonar, Range(top, ULTRASOUND, *limits, distance_m, 0.0)))
    return found


def laser_scan(scan: SonarScan, geometry: Geometry, stamp_ns: int) -> LaserScan:
    """Return the ring as a scan of eight points from the centre of the robot; nan if not measured.

    Nav2's layers read it; it has the width of the cones only as its angles.
    """
    distances = np.full(SONARS, nan, np.float32)
    for sonar, found in ranges(scan, geometry, stamp_ns):
        distances[sonar] = found.range + geometry.radius_m
    return LaserScan(
        header(stamp_ns, BASE),
        BEARINGS_RAD[0],
        BEARINGS_RAD[-1],
        CONE_RAD,
        0.0,
        0.05,
        SONAR_MIN_M + geometry.radius_m,
        geometry.sonar_max_m + geometry.radius_m,
        distances,
        np.zeros(0, np.float32),
    )


class WheelState(NamedTuple):
    """Angle and speed of both wheels."""

    stamp_ns: int
    angles_rad: tuple[float, float]
    speeds_rad_s: tuple[float, float]


class WheelReader:
    """Turns the counters of the encoders, which wrap, into angles and speeds."""

    def __init__(self) -> None:
        self._last: tuple[int, tuple[int, int]] | None = None
        self._ticks = [0, 0]

    def read(self, wheels: WheelTicks, geometry: Geometry, stamp_ns: int) -> WheelState:
        """Return the state at the stamp of the message, which `stamp_ns` is in ROS time."""
        counts = (wheels.left, wheels.right)
        speeds = [0.0, 0.0]
        rad_per_tick = geometry.m_per_tick / geometry.wheel_radius_m
        if self._last is not None:
            passed_s = (wheels.time_ns - self._last[0]) / NS_PER_S
            for side, (now, before) in enumerate(zip(counts, self._last[1], strict=True)):
                ticks = (now - before + (1 << 31)) % (1 << 32) - (1 << 31)
                self._ticks[side] += ticks
                speeds[side] = ticks * rad_per_tick / passed_s if passed_s > 0 else 0.0
        self._last = wheels.time_ns, counts
        left, right = (ticks * rad_per_tick for ticks in self._ticks)
        return WheelState(stamp_ns, (left, right), (speeds[0], speeds[1]))


def joint_states(state: WheelState) -> JointState:
    """Return sensor_msgs/JointState."""
    nothing = np.zeros(0, np.float64)
    angles, speeds = np.array(state.angles_rad), np.array(state.speeds_rad_s)
    return JointState(header(state.stamp_ns, ""), list(JOINTS), angles, speeds, nothing)


def wheel_transforms(state: WheelState, geometry: Geometry) -> list[TransformStamped]:
    """Return the places of the wheels, whose axis is y and which turn about it."""
    found = []
    for side, (frame, angle_rad) in enumerate(zip(WHEELS, state.angles_rad, strict=True)):
        left_m = geometry.track_m * (0.5 - side)
        half = angle_rad % (2 * pi) / 2
        rotation = Quaternion(0.0, sin(half), 0.0, cos(half))
        height_m = geometry.wheel_radius_m
        found.append(transform(BASE, frame, state.stamp_ns, 0.0, left_m, height_m, rotation))
    return found


def urdf(name: str, geometry: Geometry) -> str:
    """Return the description of the robot: its body, wheels and sonars."""
    height_m = 2 * SONAR_HEIGHT_M
    body = shape(f'<cylinder radius="{geometry.radius_m:g}" length="{height_m:g}"/>',
                 f"0 0 {SONAR_HEIGHT_M:g}", "0 0 0")  # fmt: skip
    wheel = shape(f'<cylinder radius="{geometry.wheel_radius_m:g}" length="0.02"/>',
                  "0 0 0", f"{pi / 2:.6f} 0 0")  # fmt: skip
    parts = [f'<link name="{BASE}">{body}</link>']
    for side, (link, joint) in enumerate(zip(WHEELS, JOINTS, strict=True)):
        left_m = geometry.track_m * (0.5 - side)
        where = f'<origin xyz="0 {left_m:g} {geometry.wheel_radius_m:g}" rpy="0 0 0"/>'
        parts.append(f'<link name="{link}">{wheel}</link>')
        parts.append(joined(joint, "continuous", link, where + '<axis xyz="0 1 0"/>'))
    for link, bearing_rad in zip(SONAR_FRAMES, BEARINGS_RAD, strict=True):
        x_m, y_m = geometry.radius_m * cos(bearing_rad), geometry.radius_m * sin(bearing_rad)
        where = (
            f'<origin xyz="{x_m:.6f} {y_m:.6f} {SONAR_HEIGHT_M:g}" rpy="0 0 {bearing_rad:.6f}"/>'
        )
        parts.append(f'<link name="{link}"/>')
        parts.append(joined(f"{link}_joint", "fixed", link, where))
    return f'<?xml version="1.0"?>\n<robot name="{name}">{"".join(parts)}</robot>\n'


def shape(geometry: str, xyz: str, rpy: str) -> str:
    """Return the same shape to be drawn and to be touched."""
    inner = f'<origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry>'
    return f"<visual>{inner}</visual><collision>{inner}</collision>"


def joined(name: str, kind: str, link: str, where: str) -> str:
    """Return the joint between the robot and a link."""
    ends = f'<parent link="{BASE}"/><child link="{link}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{where}</joint>'


def transforms(found: Sequence[TransformStamped]) -> TFMessage:
    """Return tf2_msgs/TFMessage."""
    return TFMessage(list(found))


class RosClock:
    """The time of ROS: that of the simulation where there is one, else the time of day.

    A robot stamps with its own monotonic clock, which may be that of another machine. The least
    time that a stamp was behind the time of day, within the last seconds, is what separates both:
    what took longer was under way.
    """

    WINDOW_NS: Final = 10 * NS_PER_S

    def __init__(self) -> None:
        self.is_simulated = False
        self._newest_ns = 0
        self._least: list[tuple[int, int]] = []

    def note(self, stamp_ns: int, unix_ns: int) -> None:
        """Note that a stamp of the robot has arrived at this time of day."""
        behind_ns, self._newest_ns = unix_ns - stamp_ns, stamp_ns
        if self._least and abs(behind_ns - self._least[0][1]) > self.WINDOW_NS:
            self._least.clear()  # the robot has restarted, or a clock was set
        self._least = [one for one in self._least if unix_ns - one[0] <= self.WINDOW_NS]
        while self._least and self._least[-1][1] >= behind_ns:
            self._least.pop()
        self._least.append((unix_ns, behind_ns))

    def of(self, stamp_ns: int) -> int:
        """Return the time of ROS for a stamp of the robot."""
        if self.is_simulated or not self._least:
            return stamp_ns
        return stamp_ns + self._least[0][1]

    def now(self) -> int:
        """Return the time of ROS: in a simulation that of the newest stamp."""
        return self._newest_ns if self.is_simulated else time.time_ns()
