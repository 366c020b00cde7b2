"""What moves with every frame: the robot, what it sees, where it goes, and who else is there."""

from itertools import pairwise
from math import cos, inf, isfinite, pi, sin
from typing import Final

from ground.map.ellipse import ellipse
from ground.map.pen import Pen
from ground.map.scene import BEAM_RAD, Robot, Scene
from ground.map.standing import apart_m, draw_heading, looks_right
from ground.map.view import Point

CONE_EVERY: Final = 3
WAY_EVERY: Final = 4
NOSE_DOTS: Final = 5.0
SOLID_DOTS: Final = 6.0
NO_ECHO: Final = -1.0


def draw_trail(pen: Pen, scene: Scene) -> None:
    pen.path(scene.trail, "trail")


def draw_ellipse(pen: Pen, scene: Scene) -> None:
    robot, covariance = scene.robot, scene.covariance
    axes = ellipse(covariance) if covariance is not None else None
    if robot is not None and axes is not None:
        pen.path(pen.curve((robot.x_m, robot.y_m), *axes), "ellipse")


def draw_zone(pen: Pen, scene: Scene) -> None:
    """The ring within which it avoids."""
    robot, zone_m = scene.robot, scene.zone_m
    if robot is not None and zone_m is not None and zone_m > 0.0:
        pen.circle((robot.x_m, robot.y_m), robot.radius_m + zone_m, "zone")


def draw_sonars(pen: Pen, scene: Scene) -> None:
    """Of each echo the arc on which it must lie, and the cone that it came through.

    Old echoes are worse than none: somebody may walk where there was nobody.
    """
    robot = scene.robot
    if robot is None or not (scene.live and isfinite(robot.heading_rad)):
        return
    at, rim_m = (robot.x_m, robot.y_m), robot.radius_m
    echoes_m = [_echo_m(range_m) for range_m in scene.ranges_m]
    first_rad = robot.heading_rad - len(echoes_m) / 2.0 * BEAM_RAD
    for edge, sides_m in enumerate(pairwise((NO_ECHO, *echoes_m, NO_ECHO))):
        edge_rad = first_rad + edge * BEAM_RAD
        if max(sides_m) > NO_ECHO:
            rim, end = towards(at, edge_rad, rim_m), towards(at, edge_rad, rim_m + max(sides_m))
            pen.dotted(rim, end, "cone", CONE_EVERY)
    for sonar, echo_m in enumerate(echoes_m):
        begun_rad = first_rad + sonar * BEAM_RAD
        if echo_m > NO_ECHO:
            pen.arc(at, rim_m + echo_m, (begun_rad, begun_rad + BEAM_RAD), "echo")


def draw_virtual(pen: Pen, scene: Scene) -> None:
    """Where it steers now, if that is not the goal itself, and the way there."""
    at, robot = scene.virtual_goal, scene.robot
    if at is None or (scene.goal and apart_m(at, (scene.goal.x_m, scene.goal.y_m)) < 1e-6):
        return
    if robot is not None:
        pen.dotted((robot.x_m, robot.y_m), at, "virtual", WAY_EVERY)
    pen.mark(at, "virtual", "virtual", "virtual")
    pen.off_map(at, "virtual", "virtual")


def draw_goal(pen: Pen, scene: Scene) -> None:
    goal = scene.goal
    if goal is None:
        return
    at, robot = (goal.x_m, goal.y_m), scene.robot
    draw_heading(pen, goal, "goal")
    pen.mark(at, "goal", "goal", "goal", looks_right(goal))
    away_m = None if robot is None else apart_m((robot.x_m, robot.y_m), at)
    pen.off_map(at, "goal", "goal" if away_m is None else f"goal {away_m:.1f} m")


def draw_others(pen: Pen, scene: Scene) -> None:
    """Whoever else moves: walkers as the simulation knows them, other robots by name."""
    for mover in scene.movers:
        pen.shape(mover, "truth")
        pen.mark((mover.x_m, mover.y_m), "mover", "truth")
    for other in scene.others:
        _body(pen, other, "other")
        pen.mark((other.x_m, other.y_m), "other", "other", other.name)


def draw_robot(pen: Pen, scene: Scene) -> None:
    """True to scale, with a pointer that is seen however small that is."""
    robot = scene.robot
    if robot is None:
        return
    at, label = (robot.x_m, robot.y_m), robot.name if scene.others else ""
    _body(pen, robot, "robot")
    if scene.live:
        pen.heading(at, robot.heading_rad, "robot", label)
    else:
        pen.mark(at, "lost", "robot", label)
    pen.off_map(at, "robot", robot.name or "robot")


def draw_cursor(pen: Pen, scene: Scene) -> None:
    if scene.cursor is not None:
        words = f"{scene.cursor[0]:.2f} {scene.cursor[1]:.2f}"
        pen.mark(scene.cursor, "cursor", "cursor", words)
        pen.off_map(scene.cursor, "cursor", words)


def towards(at: Point, bearing_rad: float, length_m: float) -> Point:
    return at[0] + length_m * cos(bearing_rad), at[1] + length_m * sin(bearing_rad)


def _body(pen: Pen, robot: Robot, role: str) -> None:
    """Solid where it is small, so that it is not taken for an obstacle."""
    at = robot.x_m, robot.y_m
    dot_m = pen.view.m_per_dot
    if robot.radius_m < SOLID_DOTS * dot_m:
        pen.disc(at, robot.radius_m, role)
    pen.circle(at, robot.radius_m, role)
    if isfinite(robot.heading_rad):
        nose_m = robot.radius_m + NOSE_DOTS * dot_m
        pen.path((at, towards(at, robot.heading_rad % (2.0 * pi), nose_m)), role)


def _echo_m(range_m: float | None) -> float:
    """A missing one and what is no range is no echo here: neither is drawn."""
    return range_m if range_m is not None and 0.0 <= range_m < inf else NO_ECHO
