"""Check that the robot fits at start and goal: on the floor and clear of all obstacles."""

from collections.abc import Mapping
from typing import NamedTuple

from plant.model.errors import Report
from plant.model.geometry import TOUCHING_M, clearance_m
from plant.model.types import Circle, GoalPose, Obstacle, Point, Start


class Floor(NamedTuple):
    """Size, obstacles and robot radius for the check."""

    size_m: Point
    walls: bool
    radius_m: float
    obstacles: Mapping[int, Obstacle]


def check_places(report: Report, floor: Floor, start: Start | None, goal: GoalPose | None) -> None:
    """Report collisions of the robot's disc at start and goal; obstacles are named by index."""
    if start is not None:
        _check_on_floor(report, floor, "start", (start.x_m, start.y_m))
        _check_clear(report, floor, "start", (start.x_m, start.y_m))
    if goal is not None:
        _check_on_floor(report, floor, "goal", (goal.x_m, goal.y_m))
        _check_clear(report, floor, "goal", (goal.x_m, goal.y_m))


def _check_on_floor(report: Report, floor: Floor, what: str, point: Point) -> None:
    margin_m = floor.radius_m if floor.walls else 0.0
    for axis, value_m, size_m in zip(("x_m", "y_m"), point, floor.size_m, strict=True):
        low_m, high_m = margin_m, size_m - margin_m
        if low_m - TOUCHING_M <= value_m <= high_m + TOUCHING_M:
            continue
        if 0.0 <= value_m <= size_m:
            reason = f"{value_m:g} is nearer to the outer wall than the robot's radius"
            reason += f" of {floor.radius_m:g} m"
        else:
            reason = f"{value_m:g} is outside the floor of {floor.size_m[0]:g} x "
            reason += f"{floor.size_m[1]:g} m"
        report.add((what, axis), reason, f"choose {axis} within {low_m:g} to {high_m:g}")


def _check_clear(report: Report, floor: Floor, what: str, point: Point) -> None:
    for index, obstacle in floor.obstacles.items():
        if what == "goal" and isinstance(obstacle, Circle) and obstacle.path_m:
            continue  # a moving obstacle leaves again
        gap_m = clearance_m(point, obstacle)
        if gap_m >= floor.radius_m - TOUCHING_M:
            continue
        name = f"obstacle#{index + 1} (line {report.line(('obstacle', index))})"
        if gap_m <= 0.0:
            reason = f"({point[0]:g}, {point[1]:g}) is inside {name}"
        else:
            reason = f"({point[0]:g}, {point[1]:g}) is {gap_m:.3g} m from {name}, less than"
            reason += f" the robot's radius of {floor.radius_m:g} m"
        report.add((what,), reason, f"keep {what} at least {floor.radius_m:g} m away from it")
