"""Describe a mission: poses in order, and the fence around them.

Positions are metres in the robot's own frame, x forward and y left of its start pose. Headings are
degrees, counter-clockwise from x.
"""

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from msgspec import Meta

FARTHEST_M = 200_000.0  # what fits the wire; the robot's own limit is nearer
LOOSEST_M = 1.0  # the largest tolerance of a position

Coordinate: TypeAlias = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Heading: TypeAlias = Annotated[float, Meta(ge=-360.0, le=360.0)]
Corner: TypeAlias = tuple[Coordinate, Coordinate]


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """A pose to drive to, with a wait of `hold_s`; heading None allows any."""

    x_m: Coordinate
    y_m: Coordinate
    heading_deg: Heading | None = None
    position_tolerance_m: Annotated[float, Meta(ge=0.005, le=LOOSEST_M)] = 0.05
    heading_tolerance_deg: Annotated[float, Meta(ge=0.2, le=180.0)] = 3.0
    hold_s: Annotated[float, Meta(ge=0.0, le=86_400.0)] = 0.0

    def __str__(self) -> str:
        heading = "" if self.heading_deg is None else f" at {self.heading_deg:g} deg"
        hold = f", hold {self.hold_s:g} s" if self.hold_s else ""
        return f"({self.x_m:g}, {self.y_m:g}){heading}{hold}"


@dataclass(frozen=True, kw_only=True)
class Circle:
    """A fence: the robot stays within this distance of a point."""

    x_m: Coordinate
    y_m: Coordinate
    radius_m: Annotated[float, Meta(gt=0.0, le=FARTHEST_M)]

    def __str__(self) -> str:
        return f"circle of {self.radius_m:g} m around ({self.x_m:g}, {self.y_m:g})"


@dataclass(frozen=True, kw_only=True)
class Polygon:
    """A fence: the robot stays inside these corners."""

    corners: tuple[Corner, ...]

    def __str__(self) -> str:
        return f"polygon of {len(self.corners)} corners"


Fence: TypeAlias = Circle | Polygon


@dataclass(frozen=True, kw_only=True)
class Home:
    """The place on Earth where x and y are 0; x points east, y north."""

    latitude_deg: Annotated[float, Meta(ge=-85.0, le=85.0)]
    longitude_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]


@dataclass(frozen=True, kw_only=True)
class Mission:
    """Contents of a mission file: at least one waypoint, a fence and a home."""

    waypoints: tuple[Waypoint, ...]
    fence: Fence | None = None
    home: Home | None = None

    def __str__(self) -> str:
        count = len(self.waypoints)
        fence = "" if self.fence is None else f", fence: {self.fence}"
        return f"{count} waypoint{'' if count == 1 else 's'}{fence}"
