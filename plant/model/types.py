"""What a world is once read: frozen values in metres and radians, checked before they exist."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, TypeAlias

Point: TypeAlias = tuple[float, float]
Setting: TypeAlias = bool | int | float | str
Settings: TypeAlias = Mapping[str, Setting]

WALL_THICKNESS_M = 0.02
LONGEST_NAME: Final = 64
NAME: Final = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*\Z")
"""Grammar of a world's name. It is used as a file name and cannot leave its directory."""


def bad_name(name: str) -> str:
    """Return why a world cannot have this name; empty if it can."""
    if len(name) > LONGEST_NAME:
        return f"longer than {LONGEST_NAME} characters"
    if not NAME.match(name):
        return f"{name!r} is no name: use A-Z, a-z, 0-9, '_', '-', and '.' but not first"
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    x_m: float
    y_m: float
    heading_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalPose:
    """Where to arrive; a heading of None means any."""

    x_m: float
    y_m: float
    heading_rad: float | None = None
    position_tolerance_m: float = 0.05
    heading_tolerance_rad: float = 0.05235987755982989  # 3 degrees


@dataclass(frozen=True, slots=True)
class Polygon:
    """A solid simple polygon, concave allowed, its points in either turn; not closed explicitly."""

    points_m: tuple[Point, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Circle:
    """A disc. With a path it starts at the path's first point and follows it to and fro."""

    x_m: float
    y_m: float
    radius_m: float
    path_m: tuple[Point, ...] = ()
    speed_m_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Polyline:
    """An open wall with round ends and joints: everything within half its thickness of the line."""

    points_m: tuple[Point, ...]
    thickness_m: float = WALL_THICKNESS_M


Obstacle: TypeAlias = Polygon | Circle | Polyline


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """A floor from (0, 0) to `size_m`, its inner outer-wall faces on that rectangle if `walls`.

    `robot`, `noise` and each of `faults` hold only what the file overrides, by field name.
    `family` and what follows it is what a generator or an importer knows, None if nobody said so;
    of an unreachable goal there is no shortest path.
    """

    name: str
    size_m: tuple[float, float]
    start: Start
    goal: GoalPose
    walls: bool = True
    obstacles: tuple[Obstacle, ...] = ()
    robot: Settings = field(default_factory=dict, hash=False)
    noise: Settings = field(default_factory=dict, hash=False)
    faults: tuple[Settings, ...] = field(default=(), hash=False)
    family: str | None = None
    family_seed: int | None = None
    shortest_path_m: float | None = None
    reachable: bool | None = None
