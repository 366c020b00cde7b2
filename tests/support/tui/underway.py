"""Define the messages and the scene of a robot on its way round an obstacle."""

from math import inf, radians
from typing import Any

from msgspec.structs import replace

from ground.client.parameter import Parameter
from ground.client.telemetry import Age
from ground.map.scene import MapScene, MapTarget, Outline, RobotMark
from ground.station.link.streams import StreamRow
from ground.station.world import WorldFacts
from protocol.topics import CYCLE, DECISION, HEARTBEAT, ODOMETRY, SONAR, STATUS, TRUTH, Topic
from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    GroundTruth,
    Heartbeat,
    McuStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from tests.support.tui.fakes import MS, FakeStation, S


def driving(station: FakeStation, at_s: float = 0.0) -> FakeStation:
    """Fill a station with a robot on its way round an obstacle, `at_s` after the beginning."""
    now_ns = station.clock.now_ns() + round(at_s * S)
    for topic, message in drive_messages(now_ns).items():
        station.air.put(topic, message, now_ns)
    for ago_s in (8.9, 6.0, 4.0, 2.0, 0.0):
        then = status(now_ns - round(ago_s * S))
        then = replace(then, goal_started_ns=now_ns - 8_900 * MS)
        then = replace(then, goal_distance_m=6.42 + 0.265 * ago_s)
        station.progress_now.update(then)
    station.world_now = WorldFacts(
        "demo", (10.0, 8.0), (), (), (0.8, 1.0, 0.0), MapTarget(9.0, 7.0, 0.0), 0.12, "{}"
    )
    station.scene_now = scene()
    station.parameters_now = (
        parameter("d_obs_m", 0.3, 0.4, "sonars nearer than this make it avoid"),
        parameter("guard_stop_m", 0.1, 0.1, "nearer than this it does not drive ahead"),
        parameter("sonar_max_m", 3.0, 3.0, "farther than this there is no echo"),
    )
    station.streams_now = [
        StreamRow(topic, topic.rate_hz, 30 * MS, Age.LIVE, 178, 0, 0.0, 0, "")
        for topic in (HEARTBEAT, STATUS, ODOMETRY, SONAR, CYCLE)
    ]
    return station


def parameter(name: str, default: float, value: float, doc: str) -> Parameter:
    return Parameter(
        name=name, value=value, default=default, unit="m", minimum=0.0, maximum=5.0, doc=doc,
        saved=True,
    )  # fmt: skip


def drive_messages(now_ns: int) -> dict[Topic[Any], Message]:
    return {
        HEARTBEAT: Heartbeat(type=10, autopilot=0, base_mode=0, custom_mode=0, system_status=4),
        STATUS: status(now_ns),
        ODOMETRY: PlanarOdometry(
            time_ns=now_ns, x_m=4.12, y_m=2.84, heading_rad=radians(30), speed_m_s=0.31,
            yaw_rate_rad_s=0.1, cov_xx_m2=1e-3, cov_xy_m2=2e-4, cov_xh_m_rad=0.0,
            cov_yy_m2=2e-3, cov_yh_m_rad=0.0, cov_hh_rad2=1e-3,
        ),
        DECISION: AvoidanceDecision(
            time_ns=now_ns, nearest_bearing_rad=radians(79), nearest_range_m=0.23, zone_m=0.30,
            goal_bearing_rad=radians(10), rotation_rad=radians(64), virtual_x_m=5.1,
            virtual_y_m=2.2, speed_m_s=0.25, yaw_rate_rad_s=-0.4, branch=Branch.PASS_RIGHT,
            guard=0,
        ),
        TRUTH: GroundTruth(
            time_ns=now_ns, seq=178, x_m=4.15, y_m=2.80, heading_rad=radians(31), speed_m_s=0.31,
            yaw_rate_rad_s=0.1, clearance_m=0.1, contact=0,
        ),
        CYCLE: CycleReport(
            time_ns=now_ns, tick=178, missed=0, overruns=0, rejected=0, late_us=40,
            sense_age_us=9000, budget_us=2500, stage_us=(80, 12, 140, 9, 171),
        ),
        SONAR: SonarScan(
            time_ns=now_ns, seq=178, range_mm=(3000, 1800, 2030, 2120, 1370, 460, 230, 80),
            ping_age_us=(0,) * 8, valid=0b1111_1101, echo=0b1111_1110,
        ),
    }  # fmt: skip


def status(
    now_ns: int, goal: int = GoalState.AVOIDING, vehicle: int = Vehicle.ACTIVE
) -> NavigatorStatus:
    return NavigatorStatus(
        time_ns=now_ns,
        goal_started_ns=now_ns - 8_900 * MS,
        goal_ended_ns=0,
        goal_id=7,
        goal_x_m=9.0,
        goal_y_m=7.0,
        goal_heading_rad=0.0,
        goal_distance_m=6.42,
        vehicle=vehicle,
        mode=Mode.GUIDED,
        goal=goal,
        vehicle_reason=0,
        goal_reason=0,
        navigator=Navigator.VGM,
        side=1,
    )


def scene() -> MapScene:
    box = ((5.0, 3.5), (6.2, 3.5), (6.2, 5.2), (5.0, 5.2))
    trail = tuple((0.8 + 0.11 * k, 1.0 + 0.061 * k) for k in range(31))
    return MapScene(
        size_m=(10.0, 8.0),
        obstacles=(Outline(((0, 0), (10, 0), (10, 8), (0, 8))), Outline(box)),
        trail=trail,
        robot=RobotMark(4.12, 2.84, radians(30), 0.12),
        true_robot=RobotMark(4.15, 2.80, radians(31), 0.12),
        covariance=(0.01, 0.002, 0.02),
        ranges_m=(inf, None, 2.03, 2.12, 1.37, 0.46, 0.23, 0.08),
        zone_m=0.3,
        goal=MapTarget(9.0, 7.0, 0.0),
        virtual_goal=(5.4, 2.6),
        hits=((3.33, 2.40),),
    )


def mcu_status() -> McuStatus:
    return McuStatus(
        time_ns=0,
        tick=40,
        command_us=6_019,
        busy_us=21_592,
        budget_us=50_000,
        ram_bytes=52_244,
        ram_size_bytes=56_856,
        skipped_bytes=699,
        emulated=1,
    )
