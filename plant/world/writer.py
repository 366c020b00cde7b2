"""Write a world: as JSON, as the text of a world file, and as a drawing of characters.

`plant.world.file` reads text and JSON as the same world. Angles are written in degrees. If no
decimal number gives exactly the angle, the last bit differs.
"""

import json
from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import ceil, degrees, inf, nextafter, radians
from typing import Any, Final, TypeAlias

from plant.model.configuration import LEVELS, Noise, noise_of
from plant.model.geometry import Pose, clearance_m, distance_m, length_m
from plant.placement import RobotGoal
from protocol.world import (
    Obstacle,
    Point,
    Polyline,
    World,
    WorldCircle,
    rounded_degrees,
    tables_of,
)
from runtime.cli.terminal import printable

COLUMNS: Final = 72
CELL_RATIO: Final = 2.0  # a character is about twice as high as wide
SOLID, MOVING, WAY, START, GOAL, FLOOR = "#", "o", ".", "S", "G", " "
RULER_STEP_M: Final = 1.0


class TextCanvas:
    """A grid of characters over the floor, the first row at the top."""

    def __init__(self, size_m: Point) -> None:
        self.columns = COLUMNS
        self.cell_m = size_m[0] / COLUMNS
        self.row_m = self.cell_m * CELL_RATIO
        self.rows = max(1, ceil(size_m[1] / self.row_m - 1e-9))
        self._cells = [[FLOOR] * self.columns for _ in range(self.rows)]

    def centre(self, column: int, row: int) -> Point:
        """Return the centre of a cell on the floor."""
        return (column + 0.5) * self.cell_m, (self.rows - row - 0.5) * self.row_m

    def put(self, point: Point, mark: str, over: str = FLOOR + SOLID + MOVING + WAY) -> None:
        """Put a mark at a point, if the present mark is one of `over`."""
        column = min(self.columns - 1, max(0, int(point[0] / self.cell_m)))
        row = self.rows - 1 - min(self.rows - 1, max(0, int(point[1] / self.row_m)))
        if self._cells[row][column] in over:
            self._cells[row][column] = mark

    def fill(self, obstacle: Obstacle) -> None:
        """Mark the cells of an obstacle."""
        moving = isinstance(obstacle, WorldCircle) and bool(obstacle.path_m)
        # A thin line must not disappear between two rows.
        near_m = (self.row_m if isinstance(obstacle, Polyline) else self.cell_m) / 2.0
        for row in range(self.rows):
            for column in range(self.columns):
                if clearance_m(self.centre(column, row), obstacle) <= near_m:
                    self._cells[row][column] = MOVING if moving else SOLID

    def lines(self) -> list[str]:
        """Return the rows as text."""
        return ["".join(row) for row in self._cells]


def draw(world: World, path: Sequence[Point] | None) -> str:
    """Return the map with a ruler in metres and a legend."""
    canvas = TextCanvas(world.size_m)
    for obstacle in world.obstacles:
        canvas.fill(obstacle)
    for a, b in pairwise(path or []):
        steps = max(1, ceil(distance_m(a, b) / canvas.cell_m))
        for step in range(steps + 1):
            share = step / steps
            canvas.put((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])), WAY, FLOOR)
    canvas.put((world.start.x_m, world.start.y_m), START)
    canvas.put((world.goal.x_m, world.goal.y_m), GOAL)
    return "\n".join([*_framed(canvas, world.walls), _ruler(world), "", *_legend(world, path)])


def _framed(canvas: TextCanvas, walls: bool) -> list[str]:
    side, corner, top = ("|", "+", "-") if walls else (":", "+", " ")
    edge = corner + top * canvas.columns + corner
    return [edge, *(side + line + side for line in canvas.lines()), edge]


def _ruler(world: World) -> str:
    """Return a scale in metres along the lower wall."""
    step_m = RULER_STEP_M * max(1, ceil(world.size_m[0] / 12.0))
    text = ""
    for index in range(int(world.size_m[0] / step_m) + 1):
        place = 1 + round(index * step_m / world.size_m[0] * COLUMNS)
        text = f"{text:<{place}}{index * step_m:g}"
    return text + " m"


def _legend(world: World, path: Sequence[Point] | None) -> list[str]:
    start, goal = world.start, world.goal
    heading = "any heading"
    if goal.heading_rad is not None:
        tolerance_deg = degrees(goal.heading_tolerance_rad)
        heading = f"heading {degrees(goal.heading_rad):.4g} +- {tolerance_deg:.3g} deg"
    still = sum(not (isinstance(one, WorldCircle) and one.path_m) for one in world.obstacles)
    lines = [
        f"{world.name}: {world.size_m[0]:g} x {world.size_m[1]:g} m",
        f"  {START}  start ({start.x_m:g}, {start.y_m:g}), "
        f"heading {degrees(start.heading_rad):.4g} deg",
        f"  {GOAL}  goal ({goal.x_m:g}, {goal.y_m:g}) +- {goal.position_tolerance_m:g} m, "
        f"{heading}",
        f"  {SOLID}  {still} static",
    ]
    if still < len(world.obstacles):
        lines.append(f"  {MOVING}  {len(world.obstacles) - still} moving, where they begin")
    if path is None and world.shortest_path_m is not None:
        return [*lines, f"     shortest way {world.shortest_path_m:.2f} m, from the file"]
    if path is None:
        return [*lines, "     the goal cannot be reached"]
    return [*lines, f"  {WAY}  shortest way {length_m(path):.2f} m"]


Json: TypeAlias = str | bool | int | float | list["Json"] | dict[str, "Json"] | None


def run_json(world: World, seed: int, noise: Noise) -> dict[str, Json]:
    """Return what a run needs besides its world: the seed, and a noise that is not the world's."""
    levels = [name for name, level in LEVELS.items() if level == noise]
    other = {} if noise == noise_of(world) or not levels else {"noise_level": levels[0]}
    return {"seed": seed, **other}


def places_json(starts: Iterable[Pose], goals: Iterable[RobotGoal]) -> dict[str, Json]:
    """Return start and goal of each robot; `shifted`: the goal is shifted as the start is."""
    return {
        "starts": [
            {"x_m": x_m, "y_m": y_m, "heading_deg": rounded_degrees(turn_rad)}
            for x_m, y_m, turn_rad in starts
        ],
        "goals": [{"x_m": x_m, "y_m": y_m, "shifted": shifted} for x_m, y_m, shifted in goals],
    }


MAX_DECIMALS: Final = 15


def dumps(world: World, comment: str = "") -> str:
    """Return the text of a world file that begins with a comment."""
    tables = tables_of(world, in_degrees)
    head = {key: tables[key] for key in ("name", "size_m", "walls", "start", "goal")}
    if world.walls:
        del head["walls"]  # the default
    corpus = {
        "family": world.family,
        "seed": world.family_seed,
        "shortest_path_m": world.shortest_path_m,
        "reachable": world.reachable,
    }
    lines = [f"# {printable(line)}".rstrip() for line in comment.splitlines()]
    lines += _pairs(head)
    for header, table in (
        *(("[[obstacle]]", obstacle) for obstacle in tables["obstacles"]),
        *(("[robot]", tables["robot"]), ("[noise]", tables["noise"])),
        *(("[[fault]]", fault) for fault in tables["faults"]),
        ("[corpus]", corpus),
    ):
        if pairs := _pairs(table):
            lines += ["", header, *pairs]
    return "\n".join(lines) + "\n"


def in_degrees(angle_rad: float) -> float:
    """Return the shortest decimal degrees that give exactly this angle, or else the nearest."""
    angle_deg = degrees(angle_rad)
    tries = [round(angle_deg, decimals) for decimals in range(MAX_DECIMALS + 1)]
    below, above = nextafter(angle_deg, -inf), nextafter(angle_deg, inf)
    tries += [angle_deg, below, above, nextafter(below, -inf), nextafter(above, inf)]
    return next((one for one in tries if radians(one) == angle_rad), angle_deg)


def _pairs(table: dict[str, Any]) -> list[str]:
    """Return a table's assignments, without the unknown values."""
    return [f"{key} = {_text(value)}" for key, value in table.items() if value is not None]


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    return f"{{ {', '.join(_pairs(value))} }}" if isinstance(value, dict) else repr(value)
