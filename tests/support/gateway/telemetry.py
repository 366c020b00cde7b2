"""Telemetry of a robot that stands disarmed at (3, 4), looks north-west and sees one wall."""

from math import radians
from typing import Any

from protocol.wire.enums import GoalState, Mode, Navigator, Vehicle
from protocol.wire.messages import (
    CycleReport,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    WheelTicks,
)

HEADING_RAD = radians(135.0)

READ = {"sonar_max_m": 3.0, "m_per_tick": 0.0002}
"""Parameters without which no ranges and distances are sent, as the gateway has read them."""


def odometry(**changes: float) -> PlanarOdometry:
    values: dict[str, Any] = {
        "time_ns": 5,
        "x_m": 3.0,
        "y_m": 4.0,
        "heading_rad": HEADING_RAD,
        "speed_m_s": 0.2,
        "yaw_rate_rad_s": 0.5,
        "cov_xx_m2": 0.04,
        "cov_xy_m2": 0.0,
        "cov_xh_m_rad": 0.001,
        "cov_yy_m2": 0.01,
        "cov_yh_m_rad": 0.002,
        "cov_hh_rad2": 0.003,
    }
    return PlanarOdometry(**values | changes)


def status(**changes: Any) -> NavigatorStatus:
    values: dict[str, Any] = {
        "time_ns": 5,
        "goal_started_ns": 0,
        "goal_ended_ns": 0,
        "goal_id": 0,
        "goal_x_m": 0.0,
        "goal_y_m": 0.0,
        "goal_heading_rad": 0.0,
        "goal_distance_m": 0.0,
        "vehicle": Vehicle.STANDBY,
        "mode": Mode.HOLD,
        "goal": GoalState.NONE,
        "vehicle_reason": 0,
        "goal_reason": 0,
        "navigator": Navigator.VGM,
        "side": 1,
    }
    return NavigatorStatus(**values | changes)


def scan(valid: int = 0xFF, **echoes_mm: int) -> SonarScan:
    """Return a scan; `s3=500` is an echo of sonar 3."""
    range_mm, echo = [0] * 8, 0
    for name, here_mm in echoes_mm.items():
        range_mm[int(name[1:])] = here_mm
        echo |= 1 << int(name[1:])
    ages = (0,) * 8
    return SonarScan(
        time_ns=5, seq=1, range_mm=tuple(range_mm), ping_age_us=ages, valid=valid, echo=echo
    )


def wheels(left: int = 0, right: int = 0) -> WheelTicks:
    return WheelTicks(time_ns=5, seq=1, left=left, right=right, bumper=0, expired=0)


def cycle(**changes: Any) -> CycleReport:
    values: dict[str, Any] = {
        "time_ns": 5,
        "tick": 1,
        "missed": 0,
        "overruns": 0,
        "rejected": 0,
        "late_us": 0,
        "sense_age_us": 0,
        "budget_us": 20_000,
        "stage_us": (100, 200, 300, 400, 0),
    }
    return CycleReport(**values | changes)


def everything() -> dict[str, Any]:
    """Return what `FakePort.telemetry` takes: all streams are fresh."""
    return {
        "status": status(),
        "odometry": odometry(),
        "scan": scan(s3=500, s7=1200),
        "wheels": wheels(5000, 10_000),
        "cycle": cycle(),
    }
