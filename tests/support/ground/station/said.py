"""Messages of a robot and its plant in each period; a test sets their fields."""

from dataclasses import dataclass, field
from math import inf, nan
from typing import Any

from protocol.topics import (
    CYCLE,
    DECISION,
    DRIVE,
    HEARTBEAT,
    INPUTS,
    LEASE,
    MISSION,
    ODOMETRY,
    SONAR,
    STATUS,
    TRUTH,
    WHEELS,
    Topic,
)
from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    GroundTruth,
    Heartbeat,
    LeaseStatus,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    TickInputs,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from runtime.units import PERIOD_NS

BEAT = Heartbeat(
    type=10, autopilot=3, base_mode=1, custom_mode=0, system_status=3, mavlink_version=3
)


@dataclass
class Lease:
    """The robot's side of it, as short as it can be."""

    holder: str = ""
    name: str = ""
    lapses_ms: int = 3000
    drive_id: int = 0
    driver: str = ""


@dataclass
class Robot:
    """Messages of each period of 50 ms; each part can be switched off."""

    name: str = "r1"
    loop: bool = True
    senses: bool = True
    flags: int = 3
    tick: int = 0
    time_ns: int = 0
    x_m: float = 0.0
    placed: bool = True
    vehicle: Vehicle = Vehicle.ACTIVE
    vehicle_reason: Reason = Reason.NONE
    mode: Mode = Mode.GUIDED
    goal: GoalState = GoalState.NONE
    goal_id: int = 0
    goal_x_m: float = 5.0
    stop_id: int = 0
    rotation_rad: float = 0.0
    lease: Lease = field(default_factory=Lease)

    def said(self) -> list[tuple[Topic[Any], Message]]:
        found: list[tuple[Topic[Any], Message]] = []
        if self.senses:
            found += [(WHEELS, self.wheels()), (SONAR, self.scan()), (TRUTH, self.truth())]
        if self.loop:
            found += self._looped()
            self.tick += 1
        self.time_ns += PERIOD_NS
        return found

    def _looped(self) -> list[tuple[Topic[Any], Message]]:
        found: list[tuple[Topic[Any], Message]] = [
            (DRIVE, WheelCommand(time_ns=self.time_ns, seq=self.tick, sense_seq=self.tick,
                                 left_mrad_s=0, right_mrad_s=0, ttl_ms=150)),
            (ODOMETRY, self.odometry()),
            (STATUS, self.status()),
            (DECISION, self.decision()),
            (CYCLE, self.cycle()),
            (INPUTS, self.inputs()),
        ]  # fmt: skip
        if self.tick % 4 == 0:
            found.append((HEARTBEAT, BEAT))
        if self.tick % 10 == 0:
            found += [(LEASE, self.lease_status()), (MISSION, self.mission())]
        return found

    def wheels(self) -> WheelTicks:
        return WheelTicks(time_ns=self.time_ns, seq=self.tick, left=0, right=0, bumper=0, expired=0)

    def scan(self) -> SonarScan:
        return SonarScan(
            time_ns=self.time_ns,
            seq=self.tick,
            range_mm=(1000,) * 8,
            ping_age_us=(0,) * 8,
            valid=0b0111_1111,
            echo=0b0000_1111,
        )

    def truth(self) -> GroundTruth:
        return GroundTruth(
            time_ns=self.time_ns, seq=self.tick, x_m=self.x_m, y_m=0.0, heading_rad=0.0,
            speed_m_s=0.0, yaw_rate_rad_s=0.0, clearance_m=1.0, contact=0,
        )  # fmt: skip

    def odometry(self) -> PlanarOdometry:
        known = 0.0 if self.placed else nan
        return PlanarOdometry(
            time_ns=self.time_ns, x_m=self.x_m, y_m=0.0, heading_rad=0.0, speed_m_s=0.25,
            yaw_rate_rad_s=0.0, cov_xx_m2=0.04 + known, cov_xy_m2=known, cov_xh_m_rad=known,
            cov_yy_m2=0.01 + known, cov_yh_m_rad=known, cov_hh_rad2=known,
        )  # fmt: skip

    def status(self) -> NavigatorStatus:
        return NavigatorStatus(
            time_ns=self.time_ns, goal_started_ns=0, goal_ended_ns=0,
            goal_id=self.goal_id, stop_id=self.stop_id,
            goal_x_m=self.goal_x_m, goal_y_m=1.0, goal_heading_rad=nan, goal_distance_m=4.0,
            vehicle=self.vehicle, mode=self.mode, goal=self.goal,
            vehicle_reason=self.vehicle_reason, goal_reason=Reason.NONE,
            navigator=Navigator.VGM, side=1,
        )  # fmt: skip

    def decision(self) -> AvoidanceDecision:
        return AvoidanceDecision(
            time_ns=self.time_ns, nearest_bearing_rad=nan, nearest_range_m=inf, zone_m=0.3,
            goal_bearing_rad=0.0, rotation_rad=self.rotation_rad, virtual_x_m=nan, virtual_y_m=nan,
            speed_m_s=0.2, yaw_rate_rad_s=0.0, branch=Branch.TO_GOAL, guard=Reason.NONE,
        )  # fmt: skip

    def cycle(self) -> CycleReport:
        return CycleReport(
            time_ns=self.time_ns, tick=self.tick, missed=0, overruns=0, rejected=0, late_us=90,
            sense_age_us=0, budget_us=5000, stage_us=(1, 2, 3, 4, 5),
        )  # fmt: skip

    def inputs(self) -> TickInputs:
        return TickInputs(
            time_ns=self.time_ns, now_ms=0, tick=self.tick, wheels_seq=0, scan_seq=0, requests=0,
            scan_age_ms=0, operator_age_ms=0, flags=self.flags, speed_mm_s=0, yaw_rate_mrad_s=0,
        )  # fmt: skip

    def lease_status(self) -> LeaseStatus:
        held = bool(self.lease.holder)
        lease = self.lease
        return LeaseStatus(
            time_ns=self.time_ns, lapses_ms=lease.lapses_ms * held, held=held, holder=lease.holder,
            name=lease.name, drive_id=lease.drive_id, driver=lease.driver,
        )  # fmt: skip

    def mission(self) -> MissionStatus:
        return MissionStatus(
            time_ns=self.time_ns, mission_id=0, hold_left_ms=0, count=0, current=0, state=0,
            reason=0,
        )  # fmt: skip
