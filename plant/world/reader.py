"""Convert the tables of a world file to a `World`; checks of geometry are in other modules."""

from math import isfinite, radians
from typing import Final

from plant.model.body import Body
from plant.model.errors import Report
from plant.model.types import GoalPose, Settings, Start, World, bad_name
from plant.placement.clear_places import Floor, check_places
from plant.world.corpus_table import check_length, read_corpus
from plant.world.overrides import read_fault, read_noise, read_robot
from plant.world.shapes import read_obstacle
from plant.world.table import COORDINATE, Limits, Table, type_name
from runtime.toml_reader import Key

EXAMPLES: Final = {
    "name": '"my_world"',
    "size_m": "[6.0, 4.0]",
    "walls": "true",
    "start": "{ x_m = 0.6, y_m = 2.0, heading_deg = 0.0 }",
    "goal": "{ x_m = 5.4, y_m = 2.0, heading_deg = 0.0 }",
    "obstacle": "[{ circle_m = { x = 3.0, y = 2.0, radius = 0.25 } }]",
    "robot": "{ radius_m = 0.12 }",
    "noise": '{ level = "default" }',
    "fault": '[{ kind = "sonar_dead", target = "3" }]',
    "corpus": '{ family = "u_trap", seed = 1, shortest_path_m = 5.2 }',
}
START: Final = {"x_m": "0.6", "y_m": "2.0", "heading_deg": "0.0"}
GOAL: Final = {**START, "position_tolerance_m": "0.05", "heading_tolerance_deg": "3.0"}
SIZE: Final = Limits(0.5, 100.0, "m")
HEADING: Final = Limits(-360.0, 360.0, "degrees")
POSITION_TOLERANCE: Final = Limits(0.001, 2.0, "m")
HEADING_TOLERANCE: Final = Limits(0.1, 180.0, "degrees")
MAX_OBSTACLES: Final = 4000


def read_world(raw: object, report: Report) -> World | None:
    """Return the world, or None after reporting its problems."""
    table = Table(raw, (), EXAMPLES, report)
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
        floor = Floor(size_m, walls, _radius_m(robot), obstacles)
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


def _name(table: Table) -> str:
    name = table.text("name")
    if "name" in table and isinstance(table.raw["name"], str) and (why := bad_name(name)):
        table.refuse("name", why, f"write name = {EXAMPLES['name']}")
    return name


def _start(table: Table, report: Report) -> Start | None:
    raw = table.required("start")
    if raw is None:
        return None
    start = Table(raw, ("start",), START, report)
    x_m, y_m = start.number("x_m", COORDINATE), start.number("y_m", COORDINATE)
    heading_deg = start.number("heading_deg", HEADING, default=0.0)
    return Start(x_m=x_m, y_m=y_m, heading_rad=radians(heading_deg)) if start.sound else None


def _goal(table: Table, report: Report) -> GoalPose | None:
    raw = table.required("goal")
    if raw is None:
        return None
    goal = Table(raw, ("goal",), GOAL, report)
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


def _items(table: Table, key: str, report: Report) -> list[tuple[object, Key]]:
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
