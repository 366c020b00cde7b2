"""Convert latitude and longitude to the metres of a mission and back, around its home.

x points east and y north. Both maps are linear and use one radius, that of WGS 84 at the equator. A
place that is written and read again moves by far less than the wire's 0.1 mm.
"""

from math import cos, isfinite, radians
from typing import Final

from ground.missions.mission import Home

RADIUS_M: Final = 6_378_137.0


def to_local(home: Home, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return x and y in metres."""
    east_deg = (longitude_deg - home.longitude_deg + 180.0) % 360.0 - 180.0
    x_m = RADIUS_M * radians(east_deg) * cos(radians(home.latitude_deg))
    return on_the_wire(x_m), on_the_wire(RADIUS_M * radians(latitude_deg - home.latitude_deg))


def to_global(home: Home, x_m: float, y_m: float) -> tuple[float, float]:
    """Return latitude and longitude in degrees."""
    metres_per_deg = RADIUS_M * radians(1.0)
    east_deg = x_m / (metres_per_deg * cos(radians(home.latitude_deg)))
    longitude_deg = (home.longitude_deg + east_deg + 180.0) % 360.0 - 180.0
    return home.latitude_deg + y_m / metres_per_deg, longitude_deg


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
