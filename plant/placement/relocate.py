"""Derive a world with another start, goal or start time."""

from collections.abc import Iterator
from dataclasses import replace
from math import isfinite
from typing import Final

from plant.model.configuration import body_of
from plant.model.geometry import clearance_m
from plant.model.movers import Mover
from plant.model.scene import moves
from plant.model.types import GoalPose, Obstacle, Point, Start, World
from runtime.errors import UserError

PRESSED_M: Final = 0.005
"""Apparent penetration tolerated for a robot in contact with an obstacle."""


def elsewhere(world: World, start: Start | None, goal: GoalPose | None, at_s: float) -> World:
    """Return the world with the changes; None: unchanged.

    The goal may lie in an obstacle. Raises UserError for a start that is not free at that time, and
    for a place that is outside the world or not finite.
    """
    if start is not None:
        _refuse_outside(world, "start", (start.x_m, start.y_m), start.heading_rad)
    if goal is not None:
        _refuse_outside(world, "goal", (goal.x_m, goal.y_m), goal.heading_rad or 0.0)
    if start is not None or at_s > 0.0:
        _refuse_taken(world, start or world.start, at_s)
    return replace(world, start=start or world.start, goal=goal or world.goal)


def _refuse_outside(world: World, what: str, place: Point, heading_rad: float) -> None:
    if not all(map(isfinite, (*place, heading_rad))):
        raise UserError(f"the {what} needs finite numbers, not {place[0]:g} {place[1]:g}")
    width_m, height_m = world.size_m
    if not (0.0 <= place[0] <= width_m and 0.0 <= place[1] <= height_m):
        size = f"{width_m:g} x {height_m:g} m"
        raise UserError(
            f"the {what} ({place[0]:g}, {place[1]:g}) lies outside the world {world.name} ({size})"
        )


def _refuse_taken(world: World, start: Start, at_s: float) -> None:
    """Raise UserError unless the robot's disc is clear of all obstacles at that time."""
    place, radius_m = (start.x_m, start.y_m), body_of(world).radius_m
    for name, gap_m in _gaps(world, place, at_s):
        if gap_m < radius_m - PRESSED_M:
            raise UserError(
                f"the start ({place[0]:g}, {place[1]:g}) is taken: {name} is {max(gap_m, 0.0):.3f}"
                f" m from it at {at_s:g} s and the robot's radius is {radius_m:g} m"
            )


def _gaps(world: World, place: Point, at_s: float) -> Iterator[tuple[str, float]]:
    """Yield the distances from a place to the surface of each object."""
    for number, obstacle in enumerate(world.obstacles, start=1):
        yield f"obstacle#{number}", clearance_m(place, _at(obstacle, at_s))
    if world.walls:
        x_m, y_m = place
        width_m, height_m = world.size_m
        yield "the outer wall", min(x_m, y_m, width_m - x_m, height_m - y_m)


def _at(obstacle: Obstacle, at_s: float) -> Obstacle:
    """Return an obstacle at its position at that time."""
    if not moves(obstacle):
        return obstacle
    x_m, y_m = Mover(obstacle).position_m(at_s)
    return replace(obstacle, x_m=x_m, y_m=y_m)
