"""Compose the map of one robot and its surroundings."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from math import inf, isfinite, sqrt
from typing import Final

from ground.client.status_line import knows_place
from ground.client.telemetry import Age
from ground.map.scene import MapScene, MapTarget, RobotMark
from ground.station.history.trail import ranges_m
from ground.station.robot.robot_model import RobotModel
from ground.station.world import WorldFacts
from ground.text.wording import driving
from protocol.outcome import CHI2_2
from protocol.topics import DECISION, MISSION, ODOMETRY, SONAR, STATUS, TRUTH
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import AvoidanceDecision, NavigatorStatus, PlanarOdometry
from runtime.units import NS_PER_S

REACTION_S: Final = 0.3
"""Time from the loss of its operator until a robot brakes, with the lag of its motors."""
FARTHEST_S: Final = 30.0
"""The place of a robot that may drive for longer than this is unknown, however far it is."""


def scene_of(model: RobotModel, world: WorldFacts | None, now_ns: int, *, lost: bool) -> MapScene:
    """Return the scene of one robot; stale data are left out, except the pose.

    The map marks a pose that is not live; its `covariance` grows with what may have been driven.
    """
    telemetry, figures = model.telemetry, model.figures
    odometry = telemetry.latest(ODOMETRY)
    status = telemetry.live(STATUS, now_ns)
    decision = telemetry.live(DECISION, now_ns)
    scan = telemetry.live(SONAR, now_ns)
    running = telemetry.live(MISSION, now_ns)
    pose = None if odometry is None else odometry[0]
    seen = figures.echoes_at(now_ns)
    return MapScene(
        size_m=None if world is None else world.size_m,
        obstacles=() if world is None else world.obstacles,
        movers=() if world is None else tuple(m.at(_time_s(model)) for m in world.movers),
        seen=seen.newest,
        seen_late=seen.late,
        seen_old=seen.old,
        trail=figures.trail.points(),
        robot=None if pose is None else robot_of(pose, model.radius_m, model.robot),
        true_robot=true_robot_of(model, now_ns),
        live=not lost and telemetry.seen(ODOMETRY, now_ns).age is not Age.GONE,
        covariance=None if odometry is None else enlarged(odometry, model, now_ns),
        ranges_m=() if scan is None else tuple(ranges_m(scan, figures.sonar_gaps.silent)),
        zone_m=None if decision is None or not isfinite(decision.zone_m) else decision.zone_m,
        goal=None if status is None else goal_of(status),
        virtual_goal=None if decision is None else virtual_of(decision),
        hits=tuple(figures.marks.hit),
        leaves=tuple(figures.marks.leave),
        fence=model.mission_items.fence,
        mission=model.mission_items.mission,
        current=running.current if running is not None and running.count else None,
    )


def others_of(
    models: Iterable[RobotModel], in_need: Collection[str], now_ns: int
) -> tuple[RobotMark, ...]:
    """Return other robots on the map; `in_need` has the names of those that need attention."""
    marks = (other_of(model, model.robot in in_need, now_ns) for model in models)
    return tuple(mark for mark in marks if mark is not None)


def without_place(scene: MapScene) -> MapScene:
    """Return the scene of a robot that does not know its place, without what refers to it."""
    return replace(scene, placed=False, robot=None, goal=None, virtual_goal=None)


def preview_of(world: WorldFacts) -> MapScene:
    """Return the scene of a world without a run: its robot at the start."""
    x_m, y_m, heading_rad = world.start
    return MapScene(
        size_m=world.size_m,
        obstacles=world.obstacles,
        movers=tuple(mover.at(0.0) for mover in world.movers),
        robot=RobotMark(x_m, y_m, heading_rad, world.radius_m),
        goal=world.goal,
    )


def enlarged(
    odometry: tuple[PlanarOdometry, int], model: RobotModel, now_ns: int
) -> tuple[float, float, float]:
    """Return the covariance, enlarged by the distance that a silent robot may have driven."""
    pose, arrived_ns = odometry
    age_ns = now_ns - arrived_ns
    gone_m = 0.0
    if model.telemetry.age_of(ODOMETRY, age_ns) is Age.GONE:
        status = status_of(model)
        speed_m_s = fastest_m_s(pose, model, status)
        gone_s = min(age_ns / NS_PER_S, longest_s(speed_m_s, model, status), FARTHEST_S)
        gone_m = speed_m_s * gone_s / sqrt(CHI2_2)
    return pose.cov_xx_m2 + gone_m**2, pose.cov_xy_m2, pose.cov_yy_m2 + gone_m**2


def fastest_m_s(pose: PlanarOdometry, model: RobotModel, status: NavigatorStatus | None) -> float:
    """Return the greatest speed that a silent robot may have: that of its limit if it drives."""
    may_speed_up = (
        status is not None
        and status.vehicle == Vehicle.ACTIVE
        and (status.mode == Mode.MANUAL or (status.mode != Mode.HOLD and driving(status)))
    )
    limit_m_s = model.parameters.value("v_max_m_s") if may_speed_up else None
    return max(abs(pose.speed_m_s), limit_m_s or 0.0)


def longest_s(speed_m_s: float, model: RobotModel, status: NavigatorStatus | None) -> float:
    """Return how long a silent robot may go on by its own parameters; inf while they are unknown.

    A robot that needs its operator stops soon after the operator's heartbeat ends.
    """
    lost_ms = model.parameters.value("op_lost_ms")
    braking_m_s2 = model.parameters.value("accel_m_s2")
    alone = status is not None and status.mode in (Mode.AUTO, Mode.SMART_RTL)
    if alone or lost_ms is None or not braking_m_s2:
        return inf
    return lost_ms / 1000 + REACTION_S + speed_m_s / braking_m_s2


def status_of(model: RobotModel) -> NavigatorStatus | None:
    """Return the last status, however old."""
    newest = model.telemetry.latest(STATUS)
    return None if newest is None else newest[0]


def robot_of(pose: PlanarOdometry, radius_m: float | None, name: str = "") -> RobotMark:
    """Return a pose as a robot on the map; one of unknown radius has no outline."""
    return RobotMark(pose.x_m, pose.y_m, pose.heading_rad, radius_m, name)


def true_robot_of(model: RobotModel, now_ns: int) -> RobotMark | None:
    """Return the true pose of a simulated robot; None without a live one."""
    truth = model.telemetry.live(TRUTH, now_ns)
    if truth is None:
        return None
    return RobotMark(truth.x_m, truth.y_m, truth.heading_rad, model.plant_radius_m)


def other_of(model: RobotModel, in_need: bool, now_ns: int) -> RobotMark | None:
    """Return another robot on the map with its trail; None without a pose, or without a place."""
    newest = model.telemetry.latest(ODOMETRY)
    if newest is None or not knows_place(newest[0]):
        return None
    mark = robot_of(newest[0], model.radius_m, model.robot)
    is_live = model.telemetry.age_of(ODOMETRY, now_ns - newest[1]) is not Age.GONE
    return replace(mark, live=is_live, trail=model.figures.trail.points(), in_need=in_need)


def goal_of(status: NavigatorStatus) -> MapTarget | None:
    """Return the present or last goal; None without one."""
    if not status.goal_id or not (isfinite(status.goal_x_m) and isfinite(status.goal_y_m)):
        return None
    heading_rad = status.goal_heading_rad
    return MapTarget(
        status.goal_x_m, status.goal_y_m, heading_rad if isfinite(heading_rad) else None
    )


def virtual_of(decision: AvoidanceDecision) -> tuple[float, float] | None:
    """Return the virtual goal, or None without one."""
    point = decision.virtual_x_m, decision.virtual_y_m
    return point if all(map(isfinite, point)) else None


def _time_s(model: RobotModel) -> float:
    """Return the newest time of the simulation that was received, in s."""
    stamps_ns = [
        newest[0].time_ns
        for newest in (model.telemetry.latest(TRUTH), model.telemetry.latest(SONAR))
        if newest is not None
    ]
    return max(stamps_ns, default=0) / NS_PER_S
