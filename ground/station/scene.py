"""What the station knows of one robot and its surroundings, as the map shows it."""

from collections.abc import Iterable
from math import isfinite, sqrt
from typing import Final

from ground.client.telemetry import Age, age_of
from ground.map import Robot, Scene, Target
from ground.map.ellipse import CHI2_2
from ground.station.history.trail import ranges_m
from ground.station.robot.robot_model import RobotModel
from ground.station.world import WorldFacts
from protocol.topics import DECISION, MISSION, ODOMETRY, SONAR, STATUS, TRUTH
from protocol.wire.enums import Mode
from protocol.wire.limits import OPERATOR_LOST_MS
from protocol.wire.messages import AvoidanceDecision, NavigatorStatus, PlanarOdometry
from runtime.units import NS_PER_S

STOPPED_S: Final = OPERATOR_LOST_MS / 1000 + 0.5
"""A robot that lost its operator has stopped by then: it brakes within half a second."""
FARTHEST_S: Final = 30.0


def scene_of(
    watched: RobotModel,
    world: WorldFacts | None,
    now_ns: int,
    *,
    lost: bool,
    others: Iterable[RobotModel] = (),
) -> Scene:
    """What is stale is left out, save the pose: the map marks that it is not live, and `covariance`
    grows with what it may have done since."""
    telemetry, figures = watched.telemetry, watched.figures
    odometry = telemetry.latest(ODOMETRY)
    status = telemetry.live(STATUS, now_ns)
    decision = telemetry.live(DECISION, now_ns)
    scan = telemetry.live(SONAR, now_ns)
    running = telemetry.live(MISSION, now_ns)
    pose = None if odometry is None else odometry[0]
    live = telemetry.seen(ODOMETRY, now_ns).age is not Age.GONE and not lost
    return Scene(
        size_m=None if world is None else world.size_m,
        obstacles=() if world is None else world.obstacles,
        movers=() if world is None else tuple(m.at(_time_s(watched)) for m in world.movers),
        truth=True,
        seen=figures.echoes.points(),
        trail=figures.trail.points(),
        robot=None if pose is None else robot_of(pose, figures.radius_m),
        live=live,
        covariance=None if odometry is None else grown(odometry, now_ns, status_of(watched)),
        ranges_m=() if scan is None else tuple(ranges_m(scan)),
        zone_m=None if decision is None or not isfinite(decision.zone_m) else decision.zone_m,
        goal=None if status is None else goal_of(status),
        virtual_goal=None if decision is None else virtual_of(decision),
        hits=tuple(figures.marks.hit),
        leaves=tuple(figures.marks.leave),
        fence=watched.charts.fence,
        mission=watched.charts.mission,
        current=running.current if running is not None and running.count else None,
        others=tuple(found for other in others if (found := other_of(other, now_ns)) is not None),
    )


def preview_of(world: WorldFacts) -> Scene:
    """A world in which nobody drives yet: its robot at the start."""
    x_m, y_m, heading_rad = world.start
    return Scene(
        size_m=world.size_m,
        obstacles=world.obstacles,
        movers=tuple(mover.at(0.0) for mover in world.movers),
        robot=Robot(x_m, y_m, heading_rad, world.radius_m),
        goal=world.goal,
    )


def grown(
    odometry: tuple[PlanarOdometry, int], now_ns: int, status: NavigatorStatus | None
) -> tuple[float, float, float]:
    """The ellipse of when it was last heard, as drawn wider by how far it may have gone since.

    A robot that needs its operator stops by itself soon after it loses him.
    """
    pose, arrived_ns = odometry
    age_ns = now_ns - arrived_ns
    gone_m = 0.0
    if age_of(ODOMETRY, age_ns) is Age.GONE:
        alone = status is not None and status.mode in (Mode.AUTO, Mode.SMART_RTL)
        gone_s = min(age_ns / NS_PER_S, FARTHEST_S if alone else STOPPED_S)
        gone_m = pose.speed_m_s * gone_s / sqrt(CHI2_2)
    return pose.cov_xx_m2 + gone_m**2, pose.cov_xy_m2, pose.cov_yy_m2 + gone_m**2


def status_of(watched: RobotModel) -> NavigatorStatus | None:
    """The last one heard, however old."""
    newest = watched.telemetry.latest(STATUS)
    return None if newest is None else newest[0]


def robot_of(pose: PlanarOdometry, radius_m: float, name: str = "") -> Robot:
    return Robot(pose.x_m, pose.y_m, pose.heading_rad, radius_m, name)


def other_of(watched: RobotModel, now_ns: int) -> Robot | None:
    pose = watched.telemetry.live(ODOMETRY, now_ns)
    return None if pose is None else robot_of(pose, watched.figures.radius_m, watched.robot)


def goal_of(status: NavigatorStatus) -> Target | None:
    """The goal under way or last come to; None when there is none."""
    if not status.goal_id or not (isfinite(status.goal_x_m) and isfinite(status.goal_y_m)):
        return None
    heading_rad = status.goal_heading_rad
    return Target(status.goal_x_m, status.goal_y_m, heading_rad if isfinite(heading_rad) else None)


def virtual_of(decision: AvoidanceDecision) -> tuple[float, float] | None:
    point = decision.virtual_x_m, decision.virtual_y_m
    return point if all(map(isfinite, point)) else None


def _time_s(watched: RobotModel) -> float:
    """The simulation's time, as far as it was heard."""
    stamps_ns = [
        newest[0].time_ns
        for newest in (watched.telemetry.latest(TRUTH), watched.telemetry.latest(SONAR))
        if newest is not None
    ]
    return max(stamps_ns, default=0) / NS_PER_S
