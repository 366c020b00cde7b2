"""The positions to which the clients drive, and the arguments of their scripts."""

import argparse
from math import cos, hypot, radians
from pathlib import Path
from struct import pack, unpack
from typing import Final, NamedTuple

METRES_PER_DEG: Final = 111_319.490793
"""Of latitude, on a sphere with the earth's equatorial radius."""
NEAR_M: Final = 0.25
PARAMETER: Final = "V_MAX_M_S"
VALUE: Final = 0.375
"""The value that clients set; exact in 32 bits."""
FLIGHT_TERMINATION: Final = 185
EMERGENCY: Final = 6
"""MAV_STATE_EMERGENCY."""


class Place(NamedTuple):
    """Latitude and longitude in degrees."""

    latitude: float
    longitude: float

    def moved(self, north_m: float, east_m: float) -> "Place":
        """Return the place so many metres away."""
        east_deg = east_m / (METRES_PER_DEG * cos(radians(self.latitude)))
        return Place(self.latitude + north_m / METRES_PER_DEG, self.longitude + east_deg)

    def distance_m(self, other: "Place") -> float:
        """Return the distance of two near places."""
        north_m = (other.latitude - self.latitude) * METRES_PER_DEG
        east_m = (other.longitude - self.longitude) * METRES_PER_DEG
        return hypot(north_m, east_m * cos(radians(self.latitude)))

    def rounded(self) -> "Place":
        """Return the nearest place that 32-bit floats can carry: up to a metre away."""
        return Place(*unpack("<2f", pack("<2f", *self)))

    def is_near(self, other: "Place") -> bool:
        """Return whether a robot that should be there is there."""
        return self.distance_m(other) < NEAR_M


def route(start: Place) -> list[Place]:
    """Return the waypoints of the mission: along the room, and to its side."""
    return [start.moved(0.0, 1.6), start.moved(0.7, 2.6)]


def goal(start: Place) -> Place:
    """Return where the guided goto leads."""
    return start.moved(0.0, 3.4)


def fence(start: Place) -> list[Place]:
    """Return the corners of a fence around the room, in which the robot starts."""
    return [start.moved(n, e) for n, e in ((-1.9, -0.5), (-1.9, 5.2), (1.9, 5.2), (1.9, -0.5))]


class Call(NamedTuple):
    """The arguments of a scenario."""

    host: str
    port: int
    recording: Path
    folder: Path

    @property
    def address(self) -> str:
        """HOST:PORT."""
        return f"{self.host}:{self.port}"

    def require_recording(self, path: Path) -> None:
        """Compare a downloaded log with the recording of the robot, byte for byte."""
        found, real = path.read_bytes(), self.recording.read_bytes()
        assert found == real, f"the log has {len(found)} bytes, and differs from the recording"


def called() -> Call:
    """Parse the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--recording", type=Path, required=True)
    parser.add_argument("--folder", type=Path, required=True)
    found = parser.parse_args()
    return Call(found.host, found.port, found.recording, found.folder)
