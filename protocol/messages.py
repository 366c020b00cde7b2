"""Typed face of the dialect: one frozen, keyword-only class per message, fields as in the XML."""

from typing import Final

from protocol.message import Message, unfit
from protocol.messages_common import (
    CommandAck,
    CommandInt,
    CommandLong,
    Heartbeat,
    ManualControl,
    MissionAck,
    MissionClearAll,
    MissionCount,
    MissionCurrent,
    MissionItemInt,
    MissionItemReached,
    MissionRequestInt,
    MissionRequestList,
    MissionSetCurrent,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Statustext,
    SystemTime,
    Timesync,
)
from protocol.messages_operator import (
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    LeaseStatus,
    MissionStatus,
    MissionVerdict,
    Teleop,
)

__all__ = [
    "MESSAGES",
    "AvoidanceDecision",
    "CommandAck",
    "CommandInt",
    "CommandLong",
    "CommandRequest",
    "CycleReport",
    "GoalRequest",
    "GroundTruth",
    "Heartbeat",
    "LeaseRequest",
    "LeaseStatus",
    "ManualControl",
    "Message",
    "MissionAck",
    "MissionClearAll",
    "MissionCount",
    "MissionCurrent",
    "MissionItemInt",
    "MissionItemReached",
    "MissionRequestInt",
    "MissionRequestList",
    "MissionSetCurrent",
    "MissionStatus",
    "MissionVerdict",
    "NavigatorStatus",
    "ParamRequestList",
    "ParamRequestRead",
    "ParamSet",
    "ParamValue",
    "PlanarOdometry",
    "RunRequest",
    "RunScore",
    "SonarScan",
    "Statustext",
    "SystemTime",
    "Teleop",
    "TickInputs",
    "Timesync",
    "WheelCommand",
    "WheelTicks",
]


class SonarScan(Message, frozen=True, kw_only=True):
    """One period of the sonar ring. Sonar i looks at (i - 3.5) * 22.5 degrees: 0 right, 7 left."""

    time_ns: int
    seq: int
    range_mm: tuple[int, ...]
    ping_age_us: tuple[int, ...]
    valid: int
    echo: int

    def __post_init__(self) -> None:
        if len(self.range_mm) != 8 or len(self.ping_age_us) != 8:
            raise unfit(self)


class WheelTicks(Message, frozen=True, kw_only=True):
    """Encoder counters and bumper, latched at the tick."""

    time_ns: int
    seq: int
    left: int
    right: int
    bumper: int
    expired: int


class WheelCommand(Message, frozen=True, kw_only=True):
    """What the wheels shall do until the time-to-live runs out."""

    time_ns: int
    seq: int
    sense_seq: int
    epoch: int = 0
    left_mrad_s: int
    right_mrad_s: int
    ttl_ms: int


class PlanarOdometry(Message, frozen=True, kw_only=True):
    """Where the robot believes it is, in its odometry frame, with its covariance."""

    time_ns: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    cov_xx_m2: float
    cov_xy_m2: float
    cov_xh_m_rad: float
    cov_yy_m2: float
    cov_yh_m_rad: float
    cov_hh_rad2: float


class NavigatorStatus(Message, frozen=True, kw_only=True):
    """Vehicle, mode, goal and navigator, each tick."""

    time_ns: int
    goal_started_ns: int
    goal_ended_ns: int
    goal_id: int
    stop_id: int = 0
    goal_x_m: float
    goal_y_m: float
    goal_heading_rad: float
    goal_distance_m: float
    vehicle: int
    mode: int
    goal: int
    vehicle_reason: int
    goal_reason: int
    navigator: int
    side: int


class AvoidanceDecision(Message, frozen=True, kw_only=True):
    """Why the robot turns: what the navigator saw and chose in this tick."""

    time_ns: int
    nearest_bearing_rad: float
    nearest_range_m: float
    zone_m: float
    goal_bearing_rad: float
    rotation_rad: float
    virtual_x_m: float
    virtual_y_m: float
    speed_m_s: float
    yaw_rate_rad_s: float
    branch: int
    guard: int


class CycleReport(Message, frozen=True, kw_only=True):
    """What one control cycle cost, and how late it was."""

    time_ns: int
    tick: int
    missed: int
    overruns: int
    rejected: int
    late_us: int
    sense_age_us: int
    budget_us: int
    stage_us: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.stage_us) != 5:
            raise unfit(self)


class TickInputs(Message, frozen=True, kw_only=True):
    """What the core was given in one tick, so that a recorded run can be executed again."""

    time_ns: int
    now_ms: int
    tick: int
    wheels_seq: int
    scan_seq: int
    requests: int
    scan_age_ms: int
    operator_age_ms: int
    flags: int
    speed_mm_s: int
    yaw_rate_mrad_s: int


class GroundTruth(Message, frozen=True, kw_only=True):
    """Where the robot truly is. For evaluation only; nothing that drives may read it."""

    time_ns: int
    seq: int
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    clearance_m: float
    contact: int


class RunRequest(Message, frozen=True, kw_only=True):
    """Asked of the plant: start, pause, score."""

    until_ns: int
    action: int


class RunScore(Message, frozen=True, kw_only=True):
    """The plant's evaluation of a run, from ground truth."""

    time_ns: int
    ticks: int
    contacts: int
    own_contacts: int
    x_m: float
    y_m: float
    heading_rad: float
    path_m: float
    min_clearance_m: float
    digest: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.digest) != 32:
            raise unfit(self)


MESSAGES: Final[tuple[type[Message], ...]] = (
    Heartbeat,
    SystemTime,
    ParamRequestRead,
    ParamRequestList,
    ParamValue,
    ParamSet,
    MissionSetCurrent,
    MissionCurrent,
    MissionRequestList,
    MissionCount,
    MissionClearAll,
    MissionItemReached,
    MissionAck,
    MissionRequestInt,
    ManualControl,
    MissionItemInt,
    CommandInt,
    CommandLong,
    CommandAck,
    Timesync,
    Statustext,
    SonarScan,
    WheelTicks,
    WheelCommand,
    PlanarOdometry,
    NavigatorStatus,
    AvoidanceDecision,
    CycleReport,
    GroundTruth,
    GoalRequest,
    CommandRequest,
    RunRequest,
    RunScore,
    LeaseRequest,
    LeaseStatus,
    Teleop,
    MissionStatus,
    MissionVerdict,
    TickInputs,
)
