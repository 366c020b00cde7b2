"""Coordinates: the robot's metres and radians to MAVLink's north-east-down and 1e-7 degrees.

The robot's x points east and y north of the origin; headings count counter-clockwise from x, in
radians. Yaw counts clockwise from north. Other units and frames exist only in this package.
"""

from math import cos, hypot, pi, sin, sqrt, tau
from typing import Final, NamedTuple

from ground.missions.mission import FARTHEST_M, Home
from ground.missions.qgroundcontrol import to_global, to_local
from protocol.wire.messages import PlanarOdometry

PER_DEG: Final = 10_000_000
DEFAULT_ORIGIN: Final = Home(latitude_deg=-35.3632621, longitude_deg=149.1652374)
"""The model airfield at Canberra where ArduPilot's simulator starts."""
DEFAULT_ALTITUDE_M: Final = 584.0
MAX_LATITUDE_DEG: Final = 85.0


class GlobalPlace(NamedTuple):
    """Latitude and longitude in 1e-7 degrees."""

    latitude_e7: int
    longitude_e7: int


def place_of(latitude_deg: float, longitude_deg: float) -> GlobalPlace:
    """Round a position to the resolution of MAVLink, about 1 cm."""
    return GlobalPlace(round(latitude_deg * PER_DEG), round(longitude_deg * PER_DEG))


def place_at(origin: Home, x_m: float, y_m: float) -> GlobalPlace | None:
    """Return the position of local metres; None beyond the largest distance of a mission."""
    if not (abs(x_m) <= FARTHEST_M and abs(y_m) <= FARTHEST_M):
        return None
    return place_of(*to_global(origin, x_m, y_m))


def local_at(origin: Home, place: GlobalPlace) -> tuple[float, float]:
    """Return local metres of a position."""
    return to_local(origin, place.latitude_e7 / PER_DEG, place.longitude_e7 / PER_DEG)


def exists(place: GlobalPlace) -> bool:
    """Return whether a position is on Earth; 0/0 means "none"."""
    is_on_earth = abs(place.latitude_e7) <= 90 * PER_DEG
    return is_on_earth and abs(place.longitude_e7) <= 180 * PER_DEG and any(place)


def home_at(place: GlobalPlace) -> Home | None:
    """Return an origin; None if it is too near a pole, or is no position."""
    latitude_deg, longitude_deg = place.latitude_e7 / PER_DEG, place.longitude_e7 / PER_DEG
    if abs(latitude_deg) > MAX_LATITUDE_DEG or not exists(place):
        return None
    return Home(latitude_deg=latitude_deg, longitude_deg=longitude_deg)


CM_PER_M: Final = 100.0
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
