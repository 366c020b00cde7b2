"""Draw what does not move with the robot: walls, fence, mission and its draft, ghosts."""

from collections.abc import Sequence
from itertools import pairwise
from math import cos, hypot, isfinite, sin
from typing import Final

from ground.map.canvas import DOTS_WIDE
from ground.map.pen import Pen
from ground.map.scene import Disc, MapScene, MapTarget, Outline, Shape, floor
from ground.map.view import Point

EDGE_SPACING: Final = 3
HEADING_DOTS: Final = 9.0
MARKED_OUTCOMES: Final = {
    "reached": "reached",
    "collided": "collided",
    "stuck": "stuck",
    "unreachable": "unreachable",
    "lost": "ghost lost",  # `lost` is the mark of a robot without a place
}
"""The marks of the outcomes of ghosts; other outcomes have the mark `ended`."""


def draw_walls(pen: Pen, scene: MapScene) -> None:
    """Draw the obstacles, and the edge of the floor as dots where it has no wall."""
    role = "truth" if scene.truth else "wall"
    if scene.size_m is not None:
        dotted(pen, Outline(floor(scene.size_m)), role)
    for obstacle in scene.obstacles:
        pen.shape(obstacle, role)


def draw_seen(pen: Pen, scene: MapScene) -> None:
    """Draw where the robot has seen obstacles, by age; without colours, by characters, too."""
    pen.dots(scene.seen_old, "seen old")
    plain = pen.canvas.ascii_only or pen.canvas.is_mono
    for points, role in ((scene.seen_late, "seen late"), (scene.seen, "seen")):
        pen.dots(points, role)
        for at in points if plain else ():
            pen.mark(at, role, role)


def draw_fence(pen: Pen, scene: MapScene) -> None:
    """Draw the fence as dots, so that it differs from a wall without colours, too."""
    if scene.fence is not None:
        dotted(pen, scene.fence, "fence")


def draw_ghosts(pen: Pen, scene: MapScene) -> None:
    """Draw the path of each ghost, with its outcome at the end."""
    for ghost in scene.ghosts:
        pen.path(ghost.path_m, "ghost")
        if ghost.path_m:
            label = " ".join(word for word in (ghost.label, ghost.outcome) if word)
            end = MARKED_OUTCOMES.get(ghost.outcome, "ended")
            pen.mark(ghost.path_m[-1], end, "ghost", label)


def draw_hit_points(pen: Pen, scene: MapScene) -> None:
    """Draw where the robot met and left the boundary of an obstacle."""
    for at in scene.hits:
        pen.mark(at, "hit", "hit")
    for at in scene.leaves:
        pen.mark(at, "leave", "leave")


def draw_mission(pen: Pen, scene: MapScene) -> None:
    """Draw the items of the mission, counted from 1; a `>` marks the one under way."""
    numbers = [f"{number}" for number in range(1, len(scene.mission) + 1)]
    if scene.current is not None and 0 <= scene.current < len(numbers):
        numbers[scene.current] = f">{numbers[scene.current]}"
    draw_legs(pen, scene.mission, "mission", 2 * EDGE_SPACING)
    for number, item in zip(numbers, scene.mission, strict=True):
        pen.mark((item.x_m, item.y_m), "waypoint", "mission", number, heads_right(item))


def draw_draft(pen: Pen, scene: MapScene) -> None:
    """Draw the draft of a mission with hollow marks, numbers with a `d`, and fewer dots."""
    draw_legs(pen, scene.draft, "draft", 4 * EDGE_SPACING)
    for number, item in enumerate(scene.draft, start=1):
        pen.mark((item.x_m, item.y_m), "draft", "draft", f"d{number}", heads_right(item))


def draw_legs(pen: Pen, items: Sequence[MapTarget], role: str, every: int) -> None:
    """Draw dotted lines from item to item, and the heading at each."""
    for a, b in pairwise([(item.x_m, item.y_m) for item in items]):
        pen.dotted(a, b, role, every)
    for item in items:
        draw_heading(pen, item, role)


def draw_heading(pen: Pen, target: MapTarget, role: str) -> None:
    """Draw the tolerance, where it is large enough to see, and the heading on arrival."""
    at: Point = (target.x_m, target.y_m)
    if target.tolerance_m > DOTS_WIDE * pen.view.m_per_dot:
        pen.circle(at, target.tolerance_m, role)
    if target.heading_rad is not None and isfinite(target.heading_rad):
        length_m = HEADING_DOTS * pen.view.m_per_dot
        tip = at[0] + length_m * cos(target.heading_rad), at[1] + length_m * sin(target.heading_rad)
        pen.path((at, tip), role)


def heads_right(target: MapTarget) -> bool:
    """Return whether the heading is drawn to the right, where the label would be."""
    heading_rad = target.heading_rad
    return heading_rad is not None and isfinite(heading_rad) and cos(heading_rad) > 0.5


def dotted(pen: Pen, shape: Shape, role: str) -> None:
    """Draw the edge of a shape as dots."""
    if isinstance(shape, Disc):
        points = pen.curve((shape.x_m, shape.y_m), shape.radius_m, shape.radius_m)
    else:
        points = (*shape.points_m, *shape.points_m[:1])
    for a, b in pairwise(points):
        pen.dotted(a, b, role, EDGE_SPACING)


def distance_m(a: Point, b: Point) -> float:
    """Return the distance between two points."""
    return hypot(b[0] - a[0], b[1] - a[1])
