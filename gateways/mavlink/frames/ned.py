"""Local coordinates: north, east, down, and yaw clockwise from north."""

from math import cos, hypot, pi, sin, sqrt, tau
from typing import Final, NamedTuple

from protocol.wire.messages import PlanarOdometry

CM_PER_M: Final = 100.0
MM_PER_M: Final = 1000.0
INT16: Final = 32_767
FARTHEST: Final = 1e6


def yaw_of(heading_rad: float) -> float:
    """Convert a heading to a yaw in (-pi, pi], and a yaw to a heading: the map is its inverse."""
    turned = (pi / 2 - heading_rad) % tau
    return turned - tau if turned > pi else turned


heading_of: Final = yaw_of


class NedPose(NamedTuple):
    """A pose with its velocity in north-east-down; the robot moves in a horizontal plane."""

    north_m: float
    east_m: float
    yaw_rad: float
    north_m_s: float
    east_m_s: float
    yaw_rate_rad_s: float

    @property
    def yaw_cdeg(self) -> int:
        """The yaw as a compass angle, 0 to 35,999 hundredths of a degree."""
        return round(self.yaw_rad % tau * 18_000 / pi) % 36_000


def pose_of(odometry: PlanarOdometry) -> NedPose:
    """Convert the robot's pose."""
    heading_rad, speed_m_s = odometry.heading_rad, odometry.speed_m_s
    return NedPose(
        north_m=odometry.y_m,
        east_m=odometry.x_m,
        yaw_rad=yaw_of(heading_rad),
        north_m_s=speed_m_s * sin(heading_rad),
        east_m_s=speed_m_s * cos(heading_rad),
        yaw_rate_rad_s=-odometry.yaw_rate_rad_s,
    )


def is_usable(odometry: PlanarOdometry) -> bool:
    """Return whether pose and speeds are in the range of the MAVLink fields."""
    values = (odometry.x_m, odometry.y_m, odometry.heading_rad)
    speeds = (odometry.speed_m_s, odometry.yaw_rate_rad_s)
    return all(abs(value) < FARTHEST for value in (*values, *speeds))


def knows_place(odometry: PlanarOdometry) -> bool:
    """Return whether the pose is relative to the origin; the covariance is NaN if it is not."""
    place = (odometry.cov_xx_m2, odometry.cov_xy_m2, odometry.cov_yy_m2)
    heading = (odometry.cov_xh_m_rad, odometry.cov_yh_m_rad, odometry.cov_hh_rad2)
    return is_usable(odometry) and all(abs(value) < FARTHEST**2 for value in (*place, *heading))


def deviation_m(odometry: PlanarOdometry) -> float:
    """Return the standard deviation of the position in the worst direction."""
    mean = (odometry.cov_xx_m2 + odometry.cov_yy_m2) / 2
    half = (odometry.cov_xx_m2 - odometry.cov_yy_m2) / 2
    return sqrt(max(0.0, mean + hypot(half, odometry.cov_xy_m2)))


def whole_cm(metres: float) -> int:
    """Round a length or a speed to centimetres, within 16 bits."""
    return max(-INT16, min(INT16, round(metres * CM_PER_M)))
