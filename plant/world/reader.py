"""Convert the tables of a world file to a `World`: places, obstacles, overrides and [corpus].

Every problem is reported with its key. The fit of start and goal is checked in `plant.placement`.
"""

from collections.abc import Callable, Mapping, Set
from dataclasses import MISSING, Field, fields, replace
from math import degrees, inf, isfinite, radians
from typing import Any, Final, NamedTuple

from plant.model.configuration import LEVELS, USUAL_LEVEL, Body, Fault, Noise, _fields
from plant.model.errors import WorldReport
from plant.model.geometry import TOUCHING_M, area_m2, crossing_edges, distance_m, folded_corner
from plant.placement import ObstacleFloor, check_places
from plant.world.table import COORDINATE, HUGE, FileTable, NumberLimits, type_name
from protocol.ring import RADIUS_M
from protocol.world import (
    MAX_OBSTACLES,
    ROBOT_GAP_M,
    WALL_THICKNESS_M,
    GoalPose,
    Obstacle,
    Point,
    Polyline,
    Setting,
    Settings,
    Start,
    World,
    WorldCircle,
    WorldPolygon,
    bad_name,
)
from runtime.toml_reader import Key

SHAPES: Final = {
    "polygon_m": "[[2.0, 1.0], [3.0, 1.0], [3.0, 2.0]]",
    "circle_m": "{ x = 4.0, y = 3.0, radius = 0.25 }",
    "wall_m": "[[0.0, 3.0], [2.0, 3.0]]",
}
MOTION: Final = {"path_m": "[[3.0, 0.5], [3.0, 3.5]]", "speed_m_s": "0.1"}
OBSTACLE_EXAMPLES: Final = {**SHAPES, "thickness_m": "0.02", **MOTION}
CIRCLE: Final = {"x": "4.0", "y": "3.0", "radius": "0.25"}
RADIUS: Final = NumberLimits(0.0, 50.0, "m", above_low=True)
THICKNESS: Final = NumberLimits(0.001, 5.0, "m")
SPEED: Final = NumberLimits(0.0, 2.0, "m/s", above_low=True)


def read_obstacle(raw: object, at: Key, report: WorldReport) -> Obstacle | None:
    """Return the obstacle, or None after reporting its problems."""
    table = FileTable(raw, at, OBSTACLE_EXAMPLES, report)
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


def _refuse_out_of_place(table: FileTable, shape: str) -> None:
    if shape != "wall_m" and "thickness_m" in table:
        table.refuse("thickness_m", f"not a key of {shape}", "remove it, or make it a wall_m")
    for key in MOTION:
        if shape != "circle_m" and key in table:
            table.refuse(key, f"{shape} cannot move", "remove it, or make it a circle_m")


def _polygon(table: FileTable) -> WorldPolygon:
    points = table.points("polygon_m", fewest=3)
    if points:
        _check_simple(table, points)
    return WorldPolygon(points)


def _check_simple(table: FileTable, points: tuple[Point, ...]) -> None:
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


def _repeats(table: FileTable, key: str, points: tuple[Point, ...], closed: bool) -> bool:
    """Report the first point that equals the one before it; return whether there is one."""
    for index in range(0 if closed else 1, len(points)):
        if distance_m(points[index], points[index - 1]) <= TOUCHING_M:
            number, before = (index + 1, index) if index else (len(points), 1)
            reason = f"point {number} is the same as point {before}"
            table.refuse(key, reason, f"remove point {number}")
            return True
    return False


def _wall(table: FileTable) -> Polyline:
    points = table.points("wall_m", fewest=2)
    _repeats(table, "wall_m", points, closed=False)
    thickness_m = table.number("thickness_m", THICKNESS, default=WALL_THICKNESS_M)
    return Polyline(points, thickness_m)


def _circle(table: FileTable, at: Key, report: WorldReport) -> WorldCircle | None:
    raw = table.required("circle_m")
    if raw is None:
        return None
    disc = FileTable(raw, (*at, "circle_m"), CIRCLE, report)
    x_m, y_m = disc.number("x", COORDINATE), disc.number("y", COORDINATE)
    radius_m = disc.number("radius", RADIUS)
    if not any(table.asks_for(key) for key in MOTION):
        return WorldCircle(x_m=x_m, y_m=y_m, radius_m=radius_m)
    path_m = table.points("path_m", fewest=2)
    speed_m_s = table.number("speed_m_s", SPEED)
    if path_m and disc.sound:
        _check_path(table, path_m, (x_m, y_m))
    return WorldCircle(x_m=x_m, y_m=y_m, radius_m=radius_m, path_m=path_m, speed_m_s=speed_m_s)


def _check_path(table: FileTable, path_m: tuple[Point, ...], centre: Point) -> None:
    _repeats(table, "path_m", path_m, closed=False)
    if distance_m(path_m[0], centre) > TOUCHING_M:
        x, y = centre
        reason = f"the path does not start at the circle's centre ({x:g}, {y:g})"
        table.refuse("path_m", reason, f"make [{x:g}, {y:g}] its first point")


ANY_NUMBER: Final = NumberLimits(-HUGE, HUGE)


def read_robot(raw: object, at: Key, report: WorldReport) -> Settings:
    """Return the overrides of the robot, and report their problems."""
    return _read(raw, at, report, Body, lambda settings: Body(**_fields(settings)))


def read_noise(raw: object, at: Key, report: WorldReport) -> Settings:
    """Return the overrides of the noise, and report their problems."""

    def build(settings: Settings) -> Noise:
        """Build the noise to check its values."""
        values = _fields(settings)
        level = values.pop("level", USUAL_LEVEL)
        if level not in LEVELS:
            raise ValueError(f"level: no noise level {level!r}; there are {', '.join(LEVELS)}")
        return replace(LEVELS[level], **values)

    return _read(raw, at, report, Noise, build, {"level": '"default"'})


def read_fault(raw: object, at: Key, report: WorldReport) -> Settings:
    """Return the fields of a fault, and report their problems."""
    return _read(raw, at, report, Fault, lambda settings: Fault(**_fields(settings)))


def _read(
    raw: object,
    at: Key,
    report: WorldReport,
    kind: type,
    build: Callable[[Settings], object],
    more: Mapping[str, str] | None = None,
) -> Settings:
    """Return the table's settings by field name and in the field's unit; report problems."""
    known = {_file_key(field.name): field for field in fields(kind)}
    examples = {**(more or {}), **{key: _example(field) for key, field in known.items()}}
    table = FileTable(raw, at, examples, report)
    needed = {name for name, field in known.items() if field.default is MISSING}
    settings: dict[str, Setting] = {}
    for key in examples:
        field = known.get(key)
        if key in table or key in needed:
            settings[field.name if field else key] = _value(table, key, field)
    if table.sound:
        _try(table, settings, needed, build)
    return settings


def _file_key(name: str) -> str:
    """Return the key in the file, where angles are in degrees."""
    return name.removesuffix("_rad") + "_deg" if name.endswith("_rad") else name


def _example(field: "Field[Any]") -> str:
    if field.default is MISSING:
        return '"sonar_dead"'
    if isinstance(field.default, str):
        return '"3"'
    if field.default == inf:
        return "10.0"
    return f"{degrees(field.default) if field.name.endswith('_rad') else field.default:g}"


def _value(table: FileTable, key: str, field: "Field[Any] | None") -> Setting:
    if field is None or field.type is str:
        return table.text(key)
    if field.type is int:
        return table.whole_number(key, ANY_NUMBER)
    value = table.number(key, ANY_NUMBER)
    return radians(value) if field.name.endswith("_rad") else value


def _try(
    table: FileTable, settings: Settings, needed: Set[str], build: Callable[[Settings], object]
) -> None:
    """Build the object; report and drop refused settings until it succeeds."""
    left = dict(settings)
    while True:
        try:
            build(left)
            return
        except ValueError as refusal:
            name, _, reason = str(refusal).partition(": ")
            key = _file_key(name)
            unit = " (in radians)" if key != name else ""
            given = left.pop(name, None) is not None
            if given:
                table.refuse(key, reason + unit, f"write a value such as {table.example(key)}")
            elif table.sound:
                table.refuse(key, reason + unit, f"set {key} too, to fit {', '.join(left)}")
            if not given or name in needed:
                return


CORPUS_EXAMPLES: Final = {
    "family": '"u_trap"',
    "seed": "1",
    "shortest_path_m": "5.2",
    "reachable": "true",
}
SEED: Final = NumberLimits(0, 2**53)
LENGTH: Final = NumberLimits(0.0, 100_000.0, "m")
MAX_FAMILY_LENGTH: Final = 64
ROUNDED_M: Final = 0.001


class Corpus(NamedTuple):
    """Facts about a world; None if unknown. An unreachable goal has no shortest path."""

    family: str | None = None
    seed: int | None = None
    shortest_path_m: float | None = None
    reachable: bool | None = None


def read_corpus(raw: object, at: Key, report: WorldReport) -> Corpus:
    """Return the contents of the table, and report its problems."""
    table = FileTable(raw, at, CORPUS_EXAMPLES, report)
    family = _family(table) if "family" in table else None
    seed = table.whole_number("seed", SEED) if "seed" in table else None
    length_m = table.number("shortest_path_m", LENGTH) if "shortest_path_m" in table else None
    reachable = table.flag("reachable", default=True) if "reachable" in table else None
    if length_m is not None and reachable is False:
        fix = "remove it, or write reachable = true"
        table.refuse("shortest_path_m", "an unreachable goal has no shortest path", fix)
    return Corpus(family, seed, length_m, True if length_m is not None else reachable)


def check_length(corpus: Corpus, start: Start, goal: GoalPose, report: WorldReport) -> None:
    """Report a shortest path that is shorter than the straight line."""
    length_m = corpus.shortest_path_m
    straight_m = distance_m((start.x_m, start.y_m), (goal.x_m, goal.y_m))
    if length_m is not None and isfinite(length_m) and length_m < straight_m - ROUNDED_M:
        reason = f"{length_m:g} m is shorter than the straight line of {straight_m:.3f} m"
        fix = "remove it; it is then computed when needed"
        report.add(("corpus", "shortest_path_m"), reason, fix)


def _family(table: FileTable) -> str | None:
    family = table.text("family")
    if isinstance(table.raw["family"], str) and not _is_name(family):
        reason = f"empty, unprintable or longer than {MAX_FAMILY_LENGTH} characters"
        table.refuse("family", reason, f"write family = {CORPUS_EXAMPLES['family']}")
    return family


def _is_name(text: str) -> bool:
    return bool(text.strip()) and text.isprintable() and len(text) <= MAX_FAMILY_LENGTH


EXAMPLES: Final = {
    "name": '"my_world"',
    "size_m": "[6.0, 4.0]",
    "walls": "true",
    "start": "{ x_m = 0.6, y_m = 2.0, heading_deg = 0.0 }",
    "goal": "{ x_m = 5.4, y_m = 2.0, heading_deg = 0.0 }",
    "obstacle": "[{ circle_m = { x = 3.0, y = 2.0, radius = 0.25 } }]",
    "robot": f"{{ radius_m = {RADIUS_M} }}",
    "noise": '{ level = "default" }',
    "fault": '[{ kind = "sonar_dead", target = "3" }]',
    "corpus": '{ family = "u_trap", seed = 1, shortest_path_m = 5.2 }',
}
POSE: Final = {"x_m": "0.6", "y_m": "2.0", "heading_deg": "0.0"}
START: Final = {**POSE, "gap_m": f"{ROBOT_GAP_M}"}
GOAL: Final = {**POSE, "position_tolerance_m": "0.05", "heading_tolerance_deg": "3.0"}
SIZE: Final = NumberLimits(0.5, 100.0, "m")
GAP: Final = NumberLimits(0.0, 10.0, "m")
HEADING: Final = NumberLimits(-360.0, 360.0, "degrees")
POSITION_TOLERANCE: Final = NumberLimits(0.001, 2.0, "m")
HEADING_TOLERANCE: Final = NumberLimits(0.1, 180.0, "degrees")


def read_world(raw: object, report: WorldReport) -> World | None:
    """Return the world, or None after reporting its problems."""
    table = FileTable(raw, (), EXAMPLES, report)
    name, size_m = _name(table), table.pair("size_m", SIZE)
    walls = table.flag("walls", default=True)
    start, goal = _start(table, report), _goal(table, report)
    read = [read_obstacle(one, at, report) for one, at in _items(table, "obstacle", report)]
    robot = read_robot(table.raw.get("robot", {}), ("robot",), report)
    noise = read_noise(table.raw.get("noise", {}), ("noise",), report)
    faults = [read_fault(one, at, report) for one, at in _items(table, "fault", report)]
    corpus = read_corpus(table.raw.get("corpus", {}), ("corpus",), report)
    obstacles = {index: obstacle for index, obstacle in enumerate(read) if obstacle is not None}
    if size_m is not None:
        floor = ObstacleFloor(size_m, walls, _radius_m(robot), obstacles)
        check_places(report, floor, start, goal)
    if start is not None and goal is not None:
        check_length(corpus, start, goal, report)
    if report.problems or size_m is None or start is None or goal is None:
        return None
    return World(
        name=name,
        size_m=size_m,
        walls=walls,
        start=start,
        goal=goal,
        obstacles=tuple(obstacles.values()),
        robot=robot,
        noise=noise,
        faults=tuple(faults),
        family=corpus.family,
        family_seed=corpus.seed,
        shortest_path_m=corpus.shortest_path_m,
        reachable=corpus.reachable,
    )


def _name(table: FileTable) -> str:
    name = table.text("name")
    if "name" in table and isinstance(table.raw["name"], str) and (why := bad_name(name)):
        table.refuse("name", why, f"write name = {EXAMPLES['name']}")
    return name


def _start(table: FileTable, report: WorldReport) -> Start | None:
    raw = table.required("start")
    if raw is None:
        return None
    start = FileTable(raw, ("start",), START, report)
    x_m, y_m = start.number("x_m", COORDINATE), start.number("y_m", COORDINATE)
    heading_deg = start.number("heading_deg", HEADING, default=0.0)
    gap_m = start.number("gap_m", GAP, default=ROBOT_GAP_M)
    if not start.sound:
        return None
    return Start(x_m=x_m, y_m=y_m, heading_rad=radians(heading_deg), gap_m=gap_m)


def _goal(table: FileTable, report: WorldReport) -> GoalPose | None:
    raw = table.required("goal")
    if raw is None:
        return None
    goal = FileTable(raw, ("goal",), GOAL, report)
    x_m, y_m = goal.number("x_m", COORDINATE), goal.number("y_m", COORDINATE)
    heading_deg = goal.number("heading_deg", HEADING) if goal.asks_for("heading_deg") else None
    position_m = goal.number("position_tolerance_m", POSITION_TOLERANCE, default=0.05)
    tolerance_deg = goal.number("heading_tolerance_deg", HEADING_TOLERANCE, default=3.0)
    if not goal.sound:
        return None
    return GoalPose(
        x_m=x_m,
        y_m=y_m,
        heading_rad=None if heading_deg is None else radians(heading_deg),
        position_tolerance_m=position_m,
        heading_tolerance_rad=radians(tolerance_deg),
    )


def _items(table: FileTable, key: str, report: WorldReport) -> list[tuple[object, Key]]:
    """Return the tables of a list such as [[obstacle]], each with its key."""
    raw = table.raw.get(key, [])
    if not isinstance(raw, list):
        reason = f"expected [[{key}]] tables, found {type_name(raw)}"
        report.add((key,), reason, f"write [[{key}]] instead of [{key}]")
        return []
    if len(raw) > MAX_OBSTACLES:
        report.add((key,), f"{len(raw)} of them, at most {MAX_OBSTACLES}", "remove some")
        return []
    return [(one, (key, index)) for index, one in enumerate(raw)]


def _radius_m(robot: Settings) -> float:
    """Return the robot's radius, or the default if that of the file was refused."""
    radius_m = robot.get("radius_m", Body().radius_m)
    sound = isinstance(radius_m, float) and isfinite(radius_m) and radius_m > 0.0
    return float(radius_m) if sound else Body().radius_m
