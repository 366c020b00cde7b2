"""Values of a world: frozen, in metres and radians, checked before construction."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, TypeAlias

Point: TypeAlias = tuple[float, float]
Setting: TypeAlias = bool | int | float | str
Settings: TypeAlias = Mapping[str, Setting]

WALL_THICKNESS_M = 0.02
MAX_NAME_LENGTH: Final = 64
NAME: Final = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*\Z")
"""Valid names of a world. A name is also a file name and cannot contain a directory."""


def bad_name(name: str) -> str:
    """Return why a text is no valid name of a world; empty if it is one."""
    if len(name) > MAX_NAME_LENGTH:
        return f"longer than {MAX_NAME_LENGTH} characters"
    if not NAME.match(name):
        return f"{name!r} is not a valid name: use A-Z, a-z, 0-9, '_', '-', and '.' but not first"
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Start pose of the robot."""

    x_m: float
    y_m: float
    heading_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalPose:
    """Goal pose; heading None means any."""

    x_m: float
    y_m: float
    heading_rad: float | None = None
    position_tolerance_m: float = 0.05
    heading_tolerance_rad: float = 0.05235987755982989  # 3 degrees


@dataclass(frozen=True, slots=True)
class Polygon:
    """A solid simple polygon, possibly concave, in either direction; its last edge is implicit."""

    points_m: tuple[Point, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Circle:
    """A disc. With a path it starts at the path's first point and moves back and forth along it."""

    x_m: float
    y_m: float
    radius_m: float
    path_m: tuple[Point, ...] = ()
    speed_m_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Polyline:
    """An open wall with round ends and joints: all points within half its thickness of the line."""

    points_m: tuple[Point, ...]
    thickness_m: float = WALL_THICKNESS_M


Obstacle: TypeAlias = Polygon | Circle | Polyline


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """A floor from (0, 0) to `size_m`, with outer walls around that rectangle if `walls`.

    `robot`, `noise` and each of `faults` contain only the overrides of the file, by field name.
    `family` and the fields after it are known to a generator or importer, else None. An unreachable
    goal has no shortest path.
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
