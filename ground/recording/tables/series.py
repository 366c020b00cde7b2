"""Gather time series of a run from a recording, for plots."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import cos, inf, isfinite, nan, sin, sqrt

from ground.recording.bookmarks import Mark, changes
from ground.recording.tables.time_axis import Timed
from ground.recording.world_metadata import BEARINGS_RAD
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    GroundTruth,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from runtime.units import NS_PER_S

Place = tuple[float, float, float]
"""Metres, metres, radians."""


@dataclass(slots=True)
class TimedValues:
    """Values over time; NaN is a gap."""

    times_s: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def add(self, time_s: float, value: float) -> None:
        """Append a value."""
        self.times_s.append(time_s)
        self.values.append(value)


@dataclass(slots=True)
class RunSeries:
    """Series of a run; `error_m` is the error of the estimate where the truth is known."""

    estimated: list[Place] = field(default_factory=list)
    true: list[Place] = field(default_factory=list)
    covariances: list[tuple[float, float, float]] = field(default_factory=list)
    echoes: list[tuple[float, float]] = field(default_factory=list)
    goals: list[Place] = field(default_factory=list)
    marks: tuple[Mark, ...] = ()
    nearest_m: TimedValues = field(default_factory=TimedValues)
    zone_m: TimedValues = field(default_factory=TimedValues)
    speed_m_s: TimedValues = field(default_factory=TimedValues)
    commanded_m_s: TimedValues = field(default_factory=TimedValues)
    yaw_rate_rad_s: TimedValues = field(default_factory=TimedValues)
    sigma_m: TimedValues = field(default_factory=TimedValues)
    error_m: TimedValues = field(default_factory=TimedValues)


def collect_series(timed: Iterable[Timed], radius_m: float) -> RunSeries:
    """Collect the series; `radius_m` of the robot, as sonars measure from its rim."""
    run = RunSeries()
    truths: dict[int, tuple[float, float]] = {}
    statuses: list[tuple[int, Message]] = []
    for one in timed:
        message, time_s = one.message, one.time_s
        if isinstance(message, PlanarOdometry):
            _add_odometry(run, message, time_s)
        elif isinstance(message, GroundTruth):
            run.true.append((message.x_m, message.y_m, message.heading_rad))
            truths[message.time_ns] = (message.x_m, message.y_m)
        elif isinstance(message, SonarScan):
            _add_scan(run, message, time_s, radius_m)
        elif isinstance(message, AvoidanceDecision):
            run.commanded_m_s.add(time_s, message.speed_m_s)
            if isfinite(message.zone_m):
                run.zone_m.add(time_s, message.zone_m)
        elif isinstance(message, NavigatorStatus):
            statuses.append((round(time_s * NS_PER_S), message))
            goal = (message.goal_x_m, message.goal_y_m, message.goal_heading_rad)
            if goal[0] == goal[0] and (not run.goals or run.goals[-1][:2] != goal[:2]):
                run.goals.append(goal)
    run.marks = tuple(changes(statuses))
    run.error_m = _errors(run, truths)
    return run


def _errors(run: RunSeries, truths: dict[int, tuple[float, float]]) -> TimedValues:
    """Return the distance between estimate and truth of the same stamp."""
    errors = TimedValues()
    for time_s, (x_m, y_m, _) in zip(run.speed_m_s.times_s, run.estimated, strict=True):
        true = truths.get(round(time_s * NS_PER_S))
        if true is not None:
            errors.add(time_s, sqrt((true[0] - x_m) ** 2 + (true[1] - y_m) ** 2))
    return errors


def _add_odometry(run: RunSeries, odometry: PlanarOdometry, time_s: float) -> None:
    run.estimated.append((odometry.x_m, odometry.y_m, odometry.heading_rad))
    run.covariances.append((odometry.cov_xx_m2, odometry.cov_xy_m2, odometry.cov_yy_m2))
    run.speed_m_s.add(time_s, odometry.speed_m_s)
    run.yaw_rate_rad_s.add(time_s, odometry.yaw_rate_rad_s)
    variance_m2 = odometry.cov_xx_m2 + odometry.cov_yy_m2
    run.sigma_m.add(time_s, sqrt(max(variance_m2, 0.0)))  # NaN, of an unknown place, is kept


def _add_scan(run: RunSeries, scan: SonarScan, time_s: float, radius_m: float) -> None:
    """Add a scan; a missing echo is a gap, not a distance."""
    nearest_m = inf
    for sonar, range_mm in enumerate(scan.range_mm):
        if not scan.echo & scan.valid & 1 << sonar:
            continue
        nearest_m = min(nearest_m, range_mm / 1000.0)
        if run.estimated:
            x_m, y_m, heading_rad = run.estimated[-1]
            bearing_rad = heading_rad + BEARINGS_RAD[sonar]
            far_m = radius_m + range_mm / 1000.0
            run.echoes.append((x_m + far_m * cos(bearing_rad), y_m + far_m * sin(bearing_rad)))
    run.nearest_m.add(time_s, nan if nearest_m == inf else nearest_m)
