"""Read one [[obstacle]]: a polygon, a circle that may move, or a wall."""

from typing import Final

from plant.model.errors import Report
from plant.model.geometry import TOUCHING_M, area_m2, crossing_edges, distance_m, folded_corner
from plant.model.types import WALL_THICKNESS_M, Circle, Obstacle, Point, Polygon, Polyline
from plant.world.table import COORDINATE, Limits, Table
from runtime.toml_reader import Key

SHAPES: Final = {
    "polygon_m": "[[2.0, 1.0], [3.0, 1.0], [3.0, 2.0]]",
    "circle_m": "{ x = 4.0, y = 3.0, radius = 0.25 }",
    "wall_m": "[[0.0, 3.0], [2.0, 3.0]]",
}
MOTION: Final = {"path_m": "[[3.0, 0.5], [3.0, 3.5]]", "speed_m_s": "0.1"}
EXAMPLES: Final = {**SHAPES, "thickness_m": "0.02", **MOTION}
CIRCLE: Final = {"x": "4.0", "y": "3.0", "radius": "0.25"}
RADIUS: Final = Limits(0.0, 50.0, "m", above_low=True)
THICKNESS: Final = Limits(0.001, 5.0, "m")
SPEED: Final = Limits(0.0, 2.0, "m/s", above_low=True)


def read_obstacle(raw: object, at: Key, report: Report) -> Obstacle | None:
    """Return the obstacle, or None after reporting its problems."""
    table = Table(raw, at, EXAMPLES, report)
    shapes = [shape for shape in SHAPES if table.asks_for(shape)]
    if len(shapes) != 1:
        found = " and ".join(shapes) if shapes else "none"
        reason = f"expected one of {', '.join(SHAPES)}, found {found}"
        if isinstance(raw, dict):
            report.add(
                at, reason, f"give each [[obstacle]] one shape, as circle_m = {SHAPES['circle_m']}"
            )
        return None
    obstacle: Obstacle | None
    if shapes == ["circle_m"]:
        obstacle = _circle(table, at, report)
    elif shapes == ["polygon_m"]:
        obstacle = _polygon(table)
    else:
        obstacle = _wall(table)
    _refuse_out_of_place(table, shapes[0])
    return obstacle if table.sound else None


def _refuse_out_of_place(table: Table, shape: str) -> None:
    if shape != "wall_m" and "thickness_m" in table:
        table.refuse("thickness_m", f"not a key of {shape}", "remove it, or make it a wall_m")
    for key in MOTION:
        if shape != "circle_m" and key in table:
            table.refuse(key, f"{shape} cannot move", "remove it, or make it a circle_m")


def _polygon(table: Table) -> Polygon:
    points = table.points("polygon_m", fewest=3)
    if points:
        _check_simple(table, points)
    return Polygon(points)


def _check_simple(table: Table, points: tuple[Point, ...]) -> None:
    if _repeats(table, "polygon_m", points, closed=True):
        return
    crossing = crossing_edges(points)
    if crossing is not None:
        first, second = (_edge_text(index, points) for index in crossing)
        reason = f"the polygon crosses itself: edge {first} meets edge {second}"
        table.refuse("polygon_m", reason, "order the points along the outline")
    elif area_m2(points) <= TOUCHING_M:
        table.refuse("polygon_m", "zero area", "move a point off the line, or make it a wall_m")
    elif (corner := folded_corner(points)) is not None:
        reason = f"the outline runs back on itself at point {corner + 1}"
        table.refuse("polygon_m", reason, "remove that point")


def _edge_text(index: int, points: tuple[Point, ...]) -> str:
    end = (index + 1) % len(points)
    (x1, y1), (x2, y2) = points[index], points[end]
    return f"{index + 1}-{end + 1} ({x1:g}, {y1:g})-({x2:g}, {y2:g})"


def _repeats(table: Table, key: str, points: tuple[Point, ...], closed: bool) -> bool:
    """Report the first point that equals the one before it; return whether there is one."""
    for index in range(0 if closed else 1, len(points)):
        if distance_m(points[index], points[index - 1]) <= TOUCHING_M:
            number, before = (index + 1, index) if index else (len(points), 1)
            reason = f"point {number} is the same as point {before}"
            table.refuse(key, reason, f"remove point {number}")
            return True
    return False


def _wall(table: Table) -> Polyline:
    points = table.points("wall_m", fewest=2)
    _repeats(table, "wall_m", points, closed=False)
    thickness_m = table.number("thickness_m", THICKNESS, default=WALL_THICKNESS_M)
    return Polyline(points, thickness_m)


def _circle(table: Table, at: Key, report: Report) -> Circle | None:
    raw = table.required("circle_m")
    if raw is None:
        return None
    disc = Table(raw, (*at, "circle_m"), CIRCLE, report)
    x_m, y_m = disc.number("x", COORDINATE), disc.number("y", COORDINATE)
    radius_m = disc.number("radius", RADIUS)
    if not any(table.asks_for(key) for key in MOTION):
        return Circle(x_m=x_m, y_m=y_m, radius_m=radius_m)
    path_m = table.points("path_m", fewest=2)
    speed_m_s = table.number("speed_m_s", SPEED)
    if path_m and disc.sound:
        _check_path(table, path_m, (x_m, y_m))
    return Circle(x_m=x_m, y_m=y_m, radius_m=radius_m, path_m=path_m, speed_m_s=speed_m_s)


def _check_path(table: Table, path_m: tuple[Point, ...], centre: Point) -> None:
    _repeats(table, "path_m", path_m, closed=False)
    if distance_m(path_m[0], centre) > TOUCHING_M:
        x, y = centre
        reason = f"the path does not start at the circle's centre ({x:g}, {y:g})"
        table.refuse("path_m", reason, f"make [{x:g}, {y:g}] its first point")
