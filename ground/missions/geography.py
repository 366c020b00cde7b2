"""Convert latitude and longitude to the metres of a mission and back, around its home.

x points east and y north in the plane that touches the WGS 84 ellipsoid at the home. A place on
Earth is the point of the ellipsoid below or above a point of that plane (EPSG method 9840, the
orthographic projection), so both maps are exact: over 1 km they differ from distances on the ground
by less than 0.1 mm. The error of both conversions together is far less than the 0.1 mm of the wire
format.
"""

from functools import lru_cache
from math import atan2, cos, degrees, hypot, isfinite, radians, sin, sqrt
from typing import Final, NamedTuple

from ground.missions.mission import Home

SEMI_MAJOR_M: Final = 6_378_137.0
FLATTENING: Final = 1 / 298.257223563
ECCENTRICITY_2: Final = FLATTENING * (2 - FLATTENING)
NEAR_COSINE: Final = cos(radians(5.0))
"""A position more than 5 degrees from its home has no exact metres, only an approximate
distance."""


class Plane(NamedTuple):
    """The plane at a home: sine and cosine of its latitude, and its radius of curvature east."""

    sine: float
    cosine: float
    radius_m: float


@lru_cache(maxsize=16)
def _plane(latitude_deg: float) -> Plane:
    latitude = radians(latitude_deg)
    sine = sin(latitude)
    return Plane(sine, cos(latitude), SEMI_MAJOR_M / sqrt(1 - ECCENTRICITY_2 * sine * sine))


def to_local(home: Home, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return x and y in metres.

    A position more than 5 degrees away has an approximate distance, far beyond the limit of a
    mission.
    """
    plane, place = _plane(home.latitude_deg), _plane(latitude_deg)
    east_deg = (longitude_deg - home.longitude_deg + 180.0) % 360.0 - 180.0
    turn = cos(radians(east_deg))
    if place.sine * plane.sine + place.cosine * plane.cosine * turn < NEAR_COSINE:
        north_m = SEMI_MAJOR_M * radians(latitude_deg - home.latitude_deg)
        return on_the_wire(SEMI_MAJOR_M * radians(east_deg) * plane.cosine), on_the_wire(north_m)
    x_m = place.radius_m * place.cosine * sin(radians(east_deg))
    polar_m = (1 - ECCENTRICITY_2) * (place.radius_m * place.sine - plane.radius_m * plane.sine)
    # The difference of the distances from the axis, in a form without cancellation near the home.
    half = sin(radians(east_deg / 2))
    outward_m = place.radius_m * place.cosine - plane.radius_m * plane.cosine
    outward_m -= 2 * place.radius_m * place.cosine * half * half
    return on_the_wire(x_m), on_the_wire(polar_m * plane.cosine - outward_m * plane.sine)


def to_global(home: Home, x_m: float, y_m: float) -> tuple[float, float]:
    """Return latitude and longitude in degrees; x and y are at most FARTHEST_M."""
    plane = _plane(home.latitude_deg)
    drop_m = _drop(plane, x_m, y_m)
    outward_m = plane.radius_m * plane.cosine - y_m * plane.sine - drop_m * plane.cosine
    polar_m = (1 - ECCENTRICITY_2) * plane.radius_m * plane.sine
    polar_m += y_m * plane.cosine - drop_m * plane.sine
    axis_m = hypot(outward_m, x_m)
    latitude_deg = degrees(atan2(polar_m, (1 - ECCENTRICITY_2) * axis_m))
    longitude_deg = home.longitude_deg + degrees(atan2(x_m, outward_m))
    return latitude_deg, (longitude_deg + 180.0) % 360.0 - 180.0


def _drop(plane: Plane, x_m: float, y_m: float) -> float:
    """Return the depth of the ellipsoid below a point of the plane.

    With the ellipsoid as X^2 + Y^2 + Z^2 / (1 - e^2) = a^2, the depth solves the quadratic equation
    square * depth^2 - 2 * slope * depth + gap = 0; the smaller root is the near side.
    """
    stretch = 1 / (1 - ECCENTRICITY_2)
    square = plane.cosine * plane.cosine + plane.sine * plane.sine * stretch
    slope = plane.radius_m + y_m * plane.sine * plane.cosine * (stretch - 1)
    gap = x_m * x_m + y_m * y_m * (plane.sine * plane.sine + plane.cosine * plane.cosine * stretch)
    return gap / (slope + sqrt(slope * slope - square * gap))


def on_the_wire(metres: float) -> float:
    """Round a length to 0.1 mm, the resolution of the wire.

    A length beyond the range of the wire is returned unchanged; range checks reject it.
    """
    tenths = metres * 1e4
    return round(tenths) / 1e4 if isfinite(tenths) else metres


def heading_of(yaw_deg: float) -> float:
    """Convert a compass angle to a heading (counter-clockwise from east), -180 to 180 deg."""
    return 180.0 - (yaw_deg + 90.0) % 360.0


def yaw_of(heading_deg: float) -> float:
    """Convert a heading to a compass angle in (0, 360] deg; 0 would mean "none"."""
    return 360.0 - (heading_deg - 90.0) % 360.0
