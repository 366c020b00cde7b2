"""Draw what changes with every frame: the robot, its sonars, its goal, and other moving things."""

from itertools import pairwise
from math import cos, inf, isfinite, pi, sin
from typing import Final

from ground.map.ellipse import ellipse
from ground.map.pen import Pen
from ground.map.scene import BEAM_RAD, MapScene, RobotMark
from ground.map.static_layers import distance_m, draw_heading, heads_right
from ground.map.view import Point

CONE_SPACING: Final = 3
LINE_SPACING: Final = 4
NOSE_DOTS: Final = 5.0
SOLID_DOTS: Final = 6.0
DEAD_DOTS: Final = 6.0
"""Distance of the mark of a dead sonar from the rim, so that it is beside the robot's mark."""
FILLED_DOTS: Final = 60.0
"""A robot with a greater radius than this is only an outline: it would fill the map."""
NOT_DRAWN: Final = -1.0


def draw_trail(pen: Pen, scene: MapScene) -> None:
    """Draw the way that the robot has driven, above those of other robots."""
    for other in scene.others:
        pen.path(other.trail, "other trail")
    pen.path(scene.trail, "trail")


def draw_trail_end(pen: Pen, scene: MapScene, drawn: int) -> None:
    """Draw the trail of the robot after its first `drawn` points."""
    pen.path(scene.trail[max(0, drawn - 1) :], "trail")


def draw_ellipse(pen: Pen, scene: MapScene) -> None:
    """Draw the uncertainty of the robot's position."""
    robot, covariance = scene.robot, scene.covariance
    axes = ellipse(covariance) if covariance is not None else None
    if robot is not None and axes is not None:
        pen.path(pen.curve((robot.x_m, robot.y_m), *axes), "ellipse")


def draw_zone(pen: Pen, scene: MapScene) -> None:
    """Draw the ring within which the robot avoids obstacles."""
    robot, zone_m = scene.robot, scene.zone_m
    if robot is None or robot.radius_m is None or zone_m is None or zone_m <= 0.0:
        return
    pen.circle((robot.x_m, robot.y_m), robot.radius_m + zone_m, "zone")


def draw_sonars(pen: Pen, scene: MapScene) -> None:
    """Draw for each echo the arc on which the obstacle must lie, and the edges of its cone.

    A sonar without a reading has a mark instead.
    """
    robot = scene.robot
    if robot is None or robot.radius_m is None or not scene.shows_sonars:
        return
    at, rim_m = (robot.x_m, robot.y_m), robot.radius_m
    echoes_m = [_echo_m(range_m) for range_m in scene.ranges_m]
    first_rad = robot.heading_rad - len(echoes_m) / 2.0 * BEAM_RAD
    for edge, sides_m in enumerate(pairwise((NOT_DRAWN, *echoes_m, NOT_DRAWN))):
        edge_rad = first_rad + edge * BEAM_RAD
        if max(sides_m) > NOT_DRAWN:
            rim, end = point_at(at, edge_rad, rim_m), point_at(at, edge_rad, rim_m + max(sides_m))
            pen.dotted(rim, end, "cone", CONE_SPACING)
    for sonar, echo_m in enumerate(echoes_m):
        begun_rad = first_rad + sonar * BEAM_RAD
        if echo_m > NOT_DRAWN:
            pen.arc(at, rim_m + echo_m, (begun_rad, begun_rad + BEAM_RAD), "echo")
        elif scene.ranges_m[sonar] is None:
            mark_m = rim_m + DEAD_DOTS * pen.view.m_per_dot
            pen.mark(point_at(at, begun_rad + BEAM_RAD / 2.0, mark_m), "dead sonar", "dead sonar")


def draw_virtual(pen: Pen, scene: MapScene) -> None:
    """Draw the virtual goal and a line to it, unless it is the goal itself."""
    at, robot = scene.virtual_goal, scene.robot
    if at is None or (scene.goal and distance_m(at, (scene.goal.x_m, scene.goal.y_m)) < 1e-6):
        return
    if robot is not None:
        pen.dotted((robot.x_m, robot.y_m), at, "virtual", LINE_SPACING)
    pen.mark(at, "virtual", "virtual", "virtual")
    pen.off_map(at, "virtual", "virtual")


def draw_goal(pen: Pen, scene: MapScene) -> None:
    """Draw the goal; when it is off the map, an arrow with its distance in metres."""
    goal = scene.goal
    if goal is None:
        return
    at, robot = (goal.x_m, goal.y_m), scene.robot
    draw_heading(pen, goal, "goal")
    pen.mark(at, "goal", "goal", "goal", heads_right(goal))
    away_m = None if robot is None else distance_m((robot.x_m, robot.y_m), at)
    pen.off_map(at, "goal", "goal" if away_m is None else f"goal {away_m:.1f} m")


def draw_others(pen: Pen, scene: MapScene) -> None:
    """Draw moving obstacles from the simulation truth, and other robots with their names."""
    for mover in scene.movers:
        pen.shape(mover, "truth")
        pen.mark((mover.x_m, mover.y_m), "mover", "truth")
    for other in scene.others:
        _body(pen, other, "other")
        mark = "other" if other.live else "lost"
        pen.mark((other.x_m, other.y_m), mark, "other", other.name)


def draw_true_robot(pen: Pen, scene: MapScene) -> None:
    """Draw the outline of the robot where the simulation has it."""
    if scene.true_robot is not None:
        _body(pen, scene.true_robot, "true robot")


def draw_robot(pen: Pen, scene: MapScene) -> None:
    """Draw the robot true to scale and filled, and a mark that stays visible at any scale."""
    robot = scene.robot
    if robot is None:
        return
    at, label = (robot.x_m, robot.y_m), robot.name if scene.others else ""
    if robot.radius_m is not None and robot.radius_m <= FILLED_DOTS * pen.view.m_per_dot:
        pen.disc(at, robot.radius_m, "robot")
        pen.uncover(at, robot.radius_m, "robot")
    _body(pen, robot, "robot")
    if scene.live:
        pen.heading(at, robot.heading_rad, "robot", label)
    else:
        pen.mark(at, "lost", "robot", label)
    pen.off_map(at, "robot", robot.name or "robot")


def draw_cursor(pen: Pen, scene: MapScene) -> None:
    """Draw the cursor with its position in metres."""
    if scene.cursor is not None:
        words = f"{scene.cursor[0]:z.2f} {scene.cursor[1]:z.2f}"
        pen.mark(scene.cursor, "cursor", "cursor", words)
        pen.off_map(scene.cursor, "cursor", words)


def point_at(at: Point, bearing_rad: float, length_m: float) -> Point:
    """Return the point at a bearing (radians) and distance from `at`."""
    return at[0] + length_m * cos(bearing_rad), at[1] + length_m * sin(bearing_rad)


def _body(pen: Pen, robot: RobotMark, role: str) -> None:
    """Draw a robot's outline and nose; fill it when small, to differ from an obstacle.

    Without a known radius there is only the nose.
    """
    at, radius_m = (robot.x_m, robot.y_m), robot.radius_m
    dot_m = pen.view.m_per_dot
    if radius_m is not None:
        if radius_m < SOLID_DOTS * dot_m:
            pen.disc(at, radius_m, role)
        pen.circle(at, radius_m, role)
    if isfinite(robot.heading_rad):
        nose_m = (radius_m or 0.0) + NOSE_DOTS * dot_m
        pen.path((at, point_at(at, robot.heading_rad % (2.0 * pi), nose_m)), role)


def _echo_m(range_m: float | None) -> float:
    """Return the range of an echo; NOT_DRAWN for a missing, infinite or invalid range."""
    return range_m if range_m is not None and 0.0 <= range_m < inf else NOT_DRAWN
