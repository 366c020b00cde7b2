"""Write a world as the text of a world file, which `plant.world.file` reads as the same world.

Angles are written in degrees. If no decimal number gives exactly the angle, the last bit differs.
"""

import json
from math import degrees, inf, nextafter, radians
from typing import Final

from plant.model.types import Circle, Obstacle, Point, Polygon, Setting, Settings, World
from runtime.cli.terminal import printable

MAX_DECIMALS: Final = 15


def dumps(world: World, comment: str = "") -> str:
    """Return the text of a world file that begins with a comment."""
    start, goal = world.start, world.goal
    start_table = {"x_m": start.x_m, "y_m": start.y_m, "heading_rad": start.heading_rad}
    goal_table: dict[str, Setting] = {"x_m": goal.x_m, "y_m": goal.y_m}
    if goal.heading_rad is not None:
        goal_table["heading_rad"] = goal.heading_rad
    goal_table["position_tolerance_m"] = goal.position_tolerance_m
    goal_table["heading_tolerance_rad"] = goal.heading_tolerance_rad
    lines = [f"# {printable(line)}".rstrip() for line in comment.splitlines()]
    lines += [f"name = {_text(world.name)}", f"size_m = {_pair(world.size_m)}"]
    lines += [] if world.walls else ["walls = false"]
    lines += [f"start = {{ {', '.join(_pairs(start_table))} }}"]
    lines += [f"goal = {{ {', '.join(_pairs(goal_table))} }}"]
    for obstacle in world.obstacles:
        lines += ["", "[[obstacle]]", *_obstacle(obstacle)]
    for header, settings in _tables(world):
        lines += ["", header, *_pairs(settings)]
    return "\n".join(lines) + "\n"


def _tables(world: World) -> list[tuple[str, Settings]]:
    """Return the non-empty tables below the obstacles."""
    corpus = {
        "family": world.family,
        "seed": world.family_seed,
        "shortest_path_m": world.shortest_path_m,
        "reachable": world.reachable,
    }
    known = {key: value for key, value in corpus.items() if value is not None}
    tables = [("[robot]", world.robot), ("[noise]", world.noise)]
    tables += [("[[fault]]", fault) for fault in world.faults]
    return [(header, table) for header, table in (*tables, ("[corpus]", known)) if table]


def _obstacle(obstacle: Obstacle) -> list[str]:
    if isinstance(obstacle, Polygon):
        return [f"polygon_m = {_points(obstacle.points_m)}"]
    if not isinstance(obstacle, Circle):
        walls = [f"wall_m = {_points(obstacle.points_m)}"]
        return [*walls, f"thickness_m = {_number(obstacle.thickness_m)}"]
    x, y, radius = (_number(one) for one in (obstacle.x_m, obstacle.y_m, obstacle.radius_m))
    lines = [f"circle_m = {{ x = {x}, y = {y}, radius = {radius} }}"]
    if obstacle.path_m:
        lines += [f"path_m = {_points(obstacle.path_m)}"]
        lines += [f"speed_m_s = {_number(obstacle.speed_m_s)}"]
    return lines


def _pairs(settings: Settings) -> list[str]:
    return [_keyed(name, value) for name, value in settings.items()]


def _keyed(name: str, value: Setting) -> str:
    if isinstance(value, bool):
        return f"{name} = {'true' if value else 'false'}"
    if isinstance(value, str):
        return f"{name} = {_text(value)}"
    if name.endswith("_rad"):
        return f"{name.removesuffix('_rad')}_deg = {_number(in_degrees(float(value)))}"
    return f"{name} = {_number(value)}"


def in_degrees(angle_rad: float) -> float:
    """Return the shortest decimal degrees that give exactly this angle, or else the nearest."""
    angle_deg = degrees(angle_rad)
    tries = [round(angle_deg, decimals) for decimals in range(MAX_DECIMALS + 1)]
    below, above = nextafter(angle_deg, -inf), nextafter(angle_deg, inf)
    tries += [angle_deg, below, above, nextafter(below, -inf), nextafter(above, inf)]
    return next((one for one in tries if radians(one) == angle_rad), angle_deg)


def _points(points: tuple[Point, ...]) -> str:
    return f"[{', '.join(_pair(point) for point in points)}]"


def _pair(point: Point) -> str:
    return f"[{_number(point[0])}, {_number(point[1])}]"


def _number(value: float) -> str:
    return repr(value)


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
