"""A world, frozen and in metres and radians, and its JSON, with the keys and units of its file.

This is the only reader of a world's JSON: the plant answers with it, recordings keep it, and
`sidestep worlds show --json` prints it. It checks types and sizes; the reader of world files in the
plant checks everything else, and names each problem.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, radians
from typing import Any, Final, TypeAlias

from protocol.ring import RADIUS_M
from runtime.cli.terminal import printable
from runtime.files import value_in

Point: TypeAlias = tuple[float, float]
Setting: TypeAlias = bool | int | float | str
Settings: TypeAlias = Mapping[str, Setting]

WALL_THICKNESS_M = 0.02
MAX_NAME_LENGTH: Final = 64
MAX_NUMBER: Final = 1e6
"""Limit for metres, degrees and m/s in JSON; larger values cannot be drawn."""

MAX_OBSTACLES: Final = 4000
MAX_POINTS: Final = 100_000
NAME: Final = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*\Z")
"""Valid names of a world. A name is also a file name and cannot contain a directory."""


def bad_name(name: str) -> str:
    """Return why a text is no valid name of a world; empty if it is one."""
    if len(name) > MAX_NAME_LENGTH:
        return f"longer than {MAX_NAME_LENGTH} characters"
    if not NAME.match(name):
        return f"{name!r} is not a valid name: use A-Z, a-z, 0-9, '_', '-', and '.' but not first"
    return ""


ROBOT_GAP_M: Final = 0.36
"""Wider than the avoidance zone (0.30 m), so that neighbours do not block each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Start pose of the robot; `gap_m` is free between robots that start beside each other.

    As much is free between their goals.
    """

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    gap_m: float = ROBOT_GAP_M


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalPose:
    """Goal pose; heading None means any."""

    x_m: float
    y_m: float
    heading_rad: float | None = None
    position_tolerance_m: float = 0.05
    heading_tolerance_rad: float = 0.05235987755982989  # 3 degrees


@dataclass(frozen=True, slots=True)
class WorldPolygon:
    """A solid simple polygon, possibly concave, in either direction; its last edge is implicit."""

    points_m: tuple[Point, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldCircle:
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


Obstacle: TypeAlias = WorldPolygon | WorldCircle | Polyline


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

    @property
    def radius_m(self) -> float:
        """Radius of its robot."""
        return float(self.robot.get("radius_m", RADIUS_M))


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPlace:
    """The goal of one robot of a run; `shifted`: it is shifted as the robot's start is."""

    x_m: float
    y_m: float
    shifted: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldRun:
    """A world, and what belongs to one run in it: start and goal of each robot, seed, and noise.

    `noise_level` is None if it is that of the world. `facts` are the JSON, to be written again.
    """

    world: World
    starts: tuple[Start, ...] = ()
    goals: tuple[RobotPlace, ...] = ()
    seed: int | None = None
    noise_level: str | None = None
    facts: Mapping[str, Any] = field(default_factory=dict, hash=False)


def tables_of(world: World, in_degrees: Callable[[float], float]) -> dict[str, Any]:
    """Return a world as lists, numbers and texts under the keys of its file.

    The heading of a goal is None if any will do.
    """
    start, goal = world.start, world.goal
    gap = {} if start.gap_m == ROBOT_GAP_M else {"gap_m": start.gap_m}
    return {
        "name": world.name,
        "size_m": list(world.size_m),
        "walls": world.walls,
        "start": {
            "x_m": start.x_m,
            "y_m": start.y_m,
            "heading_deg": in_degrees(start.heading_rad),
            **gap,
        },
        "goal": {
            "x_m": goal.x_m,
            "y_m": goal.y_m,
            "heading_deg": None if goal.heading_rad is None else in_degrees(goal.heading_rad),
            "position_tolerance_m": goal.position_tolerance_m,
            "heading_tolerance_deg": in_degrees(goal.heading_tolerance_rad),
        },
        "obstacles": [_obstacle_table(obstacle) for obstacle in world.obstacles],
        "robot": _settings_table(world.robot, in_degrees),
        "noise": _settings_table(world.noise, in_degrees),
        "faults": [_settings_table(fault, in_degrees) for fault in world.faults],
    }


def rounded_degrees(angle_rad: float) -> float:
    """Return degrees, rounded so that 3 degrees in a file become 3 again."""
    return round(degrees(angle_rad), 9)


def as_json(world: World, shortest_path_m: float | None) -> dict[str, Any]:
    """Return the JSON of a world with its shortest path; angles are in degrees."""
    length_m = None if shortest_path_m is None else round(shortest_path_m, 6)
    return {**tables_of(world, rounded_degrees), "shortest_path_m": length_m}


def world_in(source: str | bytes | Mapping[str, Any]) -> World:
    """Return the world in the JSON of `as_json`, as text or parsed.

    Unknown keys are ignored. The name becomes printable. Raises ValueError if something is missing,
    malformed, or too large to be drawn.
    """
    return run_in(source).world


def run_in(source: str | bytes | Mapping[str, Any]) -> WorldRun:
    """Return the same with what the JSON says of one run."""
    try:
        facts = value_in(source) if isinstance(source, str | bytes) else source
        return WorldRun(
            world=_world(facts),
            starts=tuple(map(_start, facts.get("starts", ()))),
            goals=tuple(map(_place, facts.get("goals", ()))),
            seed=None if facts.get("seed") is None else int(facts["seed"]),
            noise_level=None if "noise_level" not in facts else str(facts["noise_level"]),
            facts=facts,
        )
    except (KeyError, TypeError, IndexError, AttributeError, OverflowError) as error:
        raise ValueError(f"no world: {error!r}") from error


def _world(facts: Mapping[str, Any]) -> World:
    width_m, height_m = map(_number, facts["size_m"])
    tables = facts["obstacles"]
    lists = [table.get(key, ()) for table in tables for key in ("polygon_m", "wall_m", "path_m")]
    if len(tables) > MAX_OBSTACLES or sum(map(len, lists)) > MAX_POINTS:
        raise ValueError("too many obstacles or points")
    length_m, robot = facts.get("shortest_path_m"), _settings(facts.get("robot", {}))
    _number(robot.get("radius_m", RADIUS_M))
    return World(
        name=printable(str(facts["name"])[:MAX_NAME_LENGTH]),
        size_m=(width_m, height_m),
        walls=bool(facts.get("walls", True)),
        start=_start(facts["start"]),
        goal=_goal(facts["goal"]),
        obstacles=tuple(map(_obstacle, tables)),
        robot=robot,
        noise=_settings(facts.get("noise", {})),
        faults=tuple(map(_settings, facts.get("faults", ()))),
        shortest_path_m=None if length_m is None else _number(length_m),
    )


def _start(start: Mapping[str, Any]) -> Start:
    return Start(
        x_m=_number(start["x_m"]),
        y_m=_number(start["y_m"]),
        heading_rad=radians(_number(start["heading_deg"])),
        gap_m=_number(start.get("gap_m", ROBOT_GAP_M)),
    )


def _place(goal: Mapping[str, Any]) -> RobotPlace:
    x_m, y_m = _number(goal["x_m"]), _number(goal["y_m"])
    return RobotPlace(x_m=x_m, y_m=y_m, shifted=bool(goal["shifted"]))


def _goal(goal: Mapping[str, Any]) -> GoalPose:
    heading_deg = goal.get("heading_deg")
    usual = GoalPose(x_m=_number(goal["x_m"]), y_m=_number(goal["y_m"]))
    tolerance_deg = goal.get("heading_tolerance_deg")
    return replace(
        usual,
        heading_rad=None if heading_deg is None else radians(_number(heading_deg)),
        position_tolerance_m=_number(goal.get("position_tolerance_m", usual.position_tolerance_m)),
        heading_tolerance_rad=usual.heading_tolerance_rad
        if tolerance_deg is None
        else radians(_number(tolerance_deg)),
    )


def _obstacle(table: Mapping[str, Any]) -> Obstacle:
    if "polygon_m" in table:
        return WorldPolygon(_points(table["polygon_m"]))
    if "wall_m" in table:
        thickness_m = _number(table.get("thickness_m", WALL_THICKNESS_M))
        return Polyline(_points(table["wall_m"]), thickness_m)
    disc = table["circle_m"]
    x_m, y_m, radius_m = _number(disc["x"]), _number(disc["y"]), _number(disc["radius"])
    if "path_m" not in table:
        return WorldCircle(x_m=x_m, y_m=y_m, radius_m=radius_m)
    path_m = _points(table["path_m"])
    speed_m_s = _number(table["speed_m_s"])
    return WorldCircle(x_m=x_m, y_m=y_m, radius_m=radius_m, path_m=path_m, speed_m_s=speed_m_s)


def _points(points: Sequence[Sequence[float]]) -> tuple[Point, ...]:
    if not points:
        raise ValueError("a list of points is empty")
    return tuple((_number(x_m), _number(y_m)) for x_m, y_m in points)


def _number(value: Any) -> float:
    """Return a number; ValueError when it cannot be drawn."""
    number = float(value)
    if not abs(number) <= MAX_NUMBER:
        raise ValueError(f"{number} is out of range")
    return number


def _settings(table: Mapping[str, Any]) -> dict[str, Setting]:
    """Return settings by field name: those in degrees become radians."""
    found: dict[str, Setting] = {}
    for key, value in table.items():
        if not isinstance(value, bool | int | float | str):
            raise ValueError(f"{key} is no setting")
        if key.endswith("_deg"):
            found[key.removesuffix("_deg") + "_rad"] = radians(_number(value))
        else:
            found[key] = value
    return found


def _obstacle_table(obstacle: Obstacle) -> dict[str, Any]:
    if isinstance(obstacle, WorldPolygon):
        return {"polygon_m": list(map(list, obstacle.points_m))}
    if not isinstance(obstacle, WorldCircle):
        wall_m = list(map(list, obstacle.points_m))
        return {"wall_m": wall_m, "thickness_m": obstacle.thickness_m}
    disc = {"x": obstacle.x_m, "y": obstacle.y_m, "radius": obstacle.radius_m}
    if not obstacle.path_m:
        return {"circle_m": disc}
    path_m = list(map(list, obstacle.path_m))
    return {"circle_m": disc, "path_m": path_m, "speed_m_s": obstacle.speed_m_s}


def _settings_table(settings: Settings, in_degrees: Callable[[float], float]) -> dict[str, Any]:
    return {
        name.removesuffix("_rad") + "_deg" if name.endswith("_rad") else name: (
            in_degrees(float(value)) if name.endswith("_rad") else value
        )
        for name, value in settings.items()
    }
