"""The map in words, for whoever does not see it."""

from collections.abc import Iterator
from itertools import chain
from math import atan2, degrees, hypot, inf, isfinite, pi, remainder
from typing import Final

from ground.map.ellipse import CHANCE, ellipse
from ground.map.glyphs import UNKNOWN
from ground.map.scene import BEAM_RAD, Robot, Scene
from ground.map.view import Point

AHEAD_DEG: Final = 5.0
BEHIND_DEG: Final = 175.0
NO_ECHO: Final = "no echo"
MISSING: Final = "missing"


def describe(scene: Scene) -> list[str]:
    """A line for each thing that a person drives by, the most important first."""
    lines = chain(_robot(scene), _goal(scene), _sonars(scene), _mission(scene), _around(scene))
    return ["".join(c if c.isprintable() else UNKNOWN for c in line) for line in lines]


def place(x_m: float, y_m: float, heading_rad: float | None = None) -> str:
    """In metres, and degrees when a heading is known."""
    if not (isfinite(x_m) and isfinite(y_m)):
        return "an unknown place"
    where = f"{x_m:.2f} {y_m:.2f}"
    if heading_rad is None or not isfinite(heading_rad):
        return where
    return f"{where} heading {round(degrees(remainder(heading_rad, 2.0 * pi)))} deg"


def bearing(angle_rad: float) -> str:
    """From the robot's nose: 30 deg to the left."""
    angle_deg = degrees(remainder(angle_rad, 2.0 * pi))
    if abs(angle_deg) < AHEAD_DEG:
        return "ahead"
    if abs(angle_deg) > BEHIND_DEG:
        return "behind"
    return f"{round(abs(angle_deg))} deg to the {'left' if angle_deg > 0.0 else 'right'}"


def away(robot: Robot | None, at: Point) -> str:
    """How far and in which direction from the robot; nothing without one."""
    if robot is None:
        return ""
    dx_m, dy_m = at[0] - robot.x_m, at[1] - robot.y_m
    angle_rad = atan2(dy_m, dx_m) - robot.heading_rad
    if not (isfinite(dx_m) and isfinite(dy_m) and isfinite(angle_rad)):
        return ""
    return f", {hypot(dx_m, dy_m):.2f} m away, {bearing(angle_rad)}"


def _robot(scene: Scene) -> Iterator[str]:
    robot = scene.robot
    if robot is None:
        yield "robot: not heard yet"
        return
    last = "" if scene.live else "not live, last "
    yield f"robot: {last}at {place(robot.x_m, robot.y_m, robot.heading_rad)}"
    axes = ellipse(scene.covariance) if scene.covariance is not None else None
    if axes is not None:
        yield f"sure of its place to {axes[0]:.2f} m ({CHANCE})"


def _goal(scene: Scene) -> Iterator[str]:
    goal = scene.goal
    if goal is None:
        yield "goal: none"
        return
    at = goal.x_m, goal.y_m
    yield f"goal: at {place(*at, goal.heading_rad)}{away(scene.robot, at)}"
    virtual = scene.virtual_goal
    if virtual is not None and hypot(virtual[0] - at[0], virtual[1] - at[1]) > 1e-6:
        yield f"steers to: {place(*virtual)}{away(scene.robot, virtual)}"


def _sonars(scene: Scene) -> Iterator[str]:
    if not (scene.live and scene.ranges_m):
        return
    middle = (len(scene.ranges_m) - 1) / 2.0
    echoes = [
        (range_m, (sonar - middle) * BEAM_RAD)
        for sonar, range_m in enumerate(scene.ranges_m)
        if range_m is not None and 0.0 <= range_m < inf
    ]
    if echoes:
        range_m, angle_rad = min(echoes)
        zone_m = scene.zone_m
        inside = ", inside the avoidance zone" if zone_m is not None and range_m < zone_m else ""
        yield f"nearest echo: {range_m:.2f} m, {bearing(angle_rad)}{inside}"
    yield "sonars, left to right: " + ", ".join(map(_range, reversed(scene.ranges_m)))


def _range(range_m: float | None) -> str:
    if range_m is None or range_m != range_m:
        return MISSING
    return NO_ECHO if range_m == inf else f"{range_m:.2f}"


def _mission(scene: Scene) -> Iterator[str]:
    for index, item in enumerate(scene.mission):
        now = ", under way" if index == scene.current else ""
        yield (
            f"mission item {index + 1} of {len(scene.mission)}:"
            f" at {place(item.x_m, item.y_m, item.heading_rad)}{now}"
        )
    for index, item in enumerate(scene.draft):
        yield (
            f"draft item {index + 1} of {len(scene.draft)}:"
            f" at {place(item.x_m, item.y_m, item.heading_rad)}"
        )


def _around(scene: Scene) -> Iterator[str]:
    for other in scene.others:
        at = other.x_m, other.y_m
        yield f"robot {other.name}: at {place(*at, other.heading_rad)}{away(scene.robot, at)}"
    for mover in scene.movers:
        at = mover.x_m, mover.y_m
        yield f"moving obstacle (simulation truth): at {place(*at)}{away(scene.robot, at)}"
    for ghost in scene.ghosts:
        end = f" at {place(*ghost.path_m[-1])}" if ghost.path_m else ""
        yield f"ghost {ghost.label}: {ghost.outcome or 'under way'}{end}"
    if scene.fence is not None:
        yield "a fence is set"
    if scene.obstacles:
        known = "simulation truth" if scene.truth else "known"
        yield f"obstacles: {len(scene.obstacles)} ({known})"
    if scene.cursor is not None:
        yield f"cursor: at {place(*scene.cursor)}{away(scene.robot, scene.cursor)}"
