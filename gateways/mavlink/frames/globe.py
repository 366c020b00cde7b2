"""Positions on Earth as in MAVLink messages: whole multiples of 1e-7 degrees."""

from typing import Final, NamedTuple

from ground.missions.geography import to_global, to_local
from ground.missions.mission import FARTHEST_M, Home

PER_DEG: Final = 10_000_000
DEFAULT_ORIGIN: Final = Home(latitude_deg=-35.3632621, longitude_deg=149.1652374)
"""The model airfield at Canberra where ArduPilot's simulator starts."""
DEFAULT_ALTITUDE_M: Final = 584.0
MAX_LATITUDE_DEG: Final = 85.0


class Place(NamedTuple):
    """Latitude and longitude in 1e-7 degrees."""

    latitude_e7: int
    longitude_e7: int


def place_of(latitude_deg: float, longitude_deg: float) -> Place:
    """Round a position to the resolution of MAVLink, about 1 cm."""
    return Place(round(latitude_deg * PER_DEG), round(longitude_deg * PER_DEG))


def place_at(origin: Home, x_m: float, y_m: float) -> Place | None:
    """Return the position of local metres; None beyond the largest distance of a mission."""
    if not (abs(x_m) <= FARTHEST_M and abs(y_m) <= FARTHEST_M):
        return None
    return place_of(*to_global(origin, x_m, y_m))


def local_at(origin: Home, place: Place) -> tuple[float, float]:
    """Return local metres of a position."""
    return to_local(origin, place.latitude_e7 / PER_DEG, place.longitude_e7 / PER_DEG)


def exists(place: Place) -> bool:
    """Return whether a position is on Earth; 0/0 means "none"."""
    is_on_earth = abs(place.latitude_e7) <= 90 * PER_DEG
    return is_on_earth and abs(place.longitude_e7) <= 180 * PER_DEG and any(place)


def home_at(place: Place) -> Home | None:
    """Return an origin; None if it is too near a pole, or is no position."""
    latitude_deg, longitude_deg = place.latitude_e7 / PER_DEG, place.longitude_e7 / PER_DEG
    if abs(latitude_deg) > MAX_LATITUDE_DEG or not exists(place):
        return None
    return Home(latitude_deg=latitude_deg, longitude_deg=longitude_deg)
