"""Keep the history of a robot's telemetry: values, trail, echoes, marks and silent sonars."""

from collections import deque
from collections.abc import Callable
from functools import reduce
from math import inf, sqrt
from operator import and_
from typing import Any, Final

from ground.client.status_line import knows_place
from ground.client.telemetry import Age, Telemetry
from ground.station.history.goal_progress import GoalProgress, LastDrive
from ground.station.history.time_series import MessageSeries, SeriesTable
from ground.station.history.trail import AgedEchoes, BoundaryMarks, DrivenPath, EchoGrid
from protocol.ring import ALL_SONARS
from protocol.topics import CYCLE, DECISION, ODOMETRY, SONAR, STATUS, Topic
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from runtime.units import NS_PER_S

HELD: Final = 10
"""A sonar counts as silent until it has had a reading in this number of consecutive scans."""


class SonarGaps:
    """Stores which sonars were valid in the last scans."""

    def __init__(self) -> None:
        self._valid: deque[int] = deque(maxlen=HELD)

    def add(self, scan: SonarScan) -> None:
        """Add the next scan."""
        self._valid.append(scan.valid)

    @property
    def silent(self) -> int:
        """A bit for each sonar, 1 if one of the last scans has no reading of it."""
        return ALL_SONARS & ~reduce(and_, self._valid, ALL_SONARS)


MAX_APART_S: Final = 0.25
"""A scan and a pose further apart in time do not locate an echo."""
SERIES_OF: Final = {
    ODOMETRY.path: ("speed", "uncertainty_m"),
    STATUS.path: ("goal_distance",),
    DECISION.path: ("nearest_range",),
    CYCLE.path: ("cycle_us", "late_us"),
}
"""Names of the series that each topic feeds."""


class TelemetryHistory:
    """Samples telemetry at each poll, each message once; a stream that stops leaves a gap."""

    def __init__(self, telemetry: Telemetry, began_ns: int) -> None:
        self.history = SeriesTable()
        self._radius_m: float | None = None
        self.last_drive = LastDrive()
        self.sonar_gaps = SonarGaps()
        self.restart()
        self.fields = MessageSeries(telemetry, began_ns)
        self._telemetry = telemetry
        self._began_ns = began_ns
        self._taken_ns: dict[str, int] = {}
        self._placed = True

    def restart(self) -> None:
        """Drop what refers to the estimated position: a restarted robot estimates it anew."""
        self.trail = DrivenPath()
        self.echoes = EchoGrid()
        self.marks = BoundaryMarks()
        self.worst_cycle = WorstCycle()
        self.progress = GoalProgress()
        self.last_drive.lose_place()

    def poll(self, now_ns: int, radius_m: float | None) -> None:
        """Add the newest message of each topic; echoes have a place once the radius is known."""
        self._radius_m = radius_m
        self.fields.poll(now_ns)
        takes: tuple[tuple[Topic[Any], Callable[[Any, float], None]], ...] = (
            (ODOMETRY, self._odometry),
            (STATUS, self._status),
            (DECISION, self._decision),
            (CYCLE, self._cycle),
            (SONAR, self._sonar),
        )
        for topic, take in takes:
            newest = self._telemetry.latest(topic)
            if newest is None:
                continue
            message, arrived_ns = newest
            if self._taken_ns.get(topic.path) != arrived_ns:
                self._taken_ns[topic.path] = arrived_ns
                take(message, (arrived_ns - self._began_ns) / NS_PER_S)
            elif self._telemetry.age_of(topic, now_ns - arrived_ns) is Age.GONE:
                for name in SERIES_OF.get(topic.path, ()):
                    self.history[name].gap()

    def echoes_at(self, now_ns: int) -> AgedEchoes:
        """Return the echoes by their age at an instant of the station's clock."""
        return self.echoes.by_age((now_ns - self._began_ns) / NS_PER_S)

    def _odometry(self, odometry: PlanarOdometry, time_s: float) -> None:
        self.last_drive.moved(odometry)
        self.history["speed"].add(time_s, odometry.speed_m_s)
        placed = knows_place(odometry)
        if placed is not self._placed:
            self._placed = placed
            self.restart()
        if placed:
            self.trail.add(odometry.x_m, odometry.y_m)
            self.history["uncertainty_m"].add(time_s, uncertainty_m(odometry))
        else:
            self.history["uncertainty_m"].gap()

    def _status(self, status: NavigatorStatus, time_s: float) -> None:
        self.history["goal_distance"].add(time_s, status.goal_distance_m)
        self.progress.update(status)
        self.last_drive.update(status)
        pose = self._telemetry.latest(ODOMETRY)
        if pose is not None and self._placed:
            self.marks.update(status, pose[0])

    def _decision(self, decision: AvoidanceDecision, time_s: float) -> None:
        self.history["nearest_range"].add(time_s, decision.nearest_range_m)

    def _cycle(self, cycle: CycleReport, time_s: float) -> None:
        self.history["cycle_us"].add(time_s, float(sum(cycle.stage_us)))
        self.history["late_us"].add(time_s, float(cycle.late_us))
        self.worst_cycle.add(cycle, time_s)

    def _sonar(self, scan: SonarScan, time_s: float) -> None:
        self.sonar_gaps.add(scan)
        pose = self._telemetry.latest(ODOMETRY)
        if pose is None or not self._placed or self._radius_m is None:
            return
        apart_s = abs((pose[1] - self._began_ns) / NS_PER_S - time_s)
        if apart_s <= MAX_APART_S:
            self.echoes.scan(scan, pose[0], self._radius_m, time_s)


def uncertainty_m(odometry: PlanarOdometry) -> float:
    """Return the larger semi-axis in m of the ellipse of one standard deviation."""
    mean_m2 = (odometry.cov_xx_m2 + odometry.cov_yy_m2) / 2.0
    half_m2 = (odometry.cov_xx_m2 - odometry.cov_yy_m2) / 2.0
    most_m2 = mean_m2 + sqrt(half_m2 * half_m2 + odometry.cov_xy_m2 * odometry.cov_xy_m2)
    return sqrt(max(0.0, most_m2)) if most_m2 == most_m2 else most_m2


class WorstCycle:
    """Keep the most expensive control cycle of each second, so the displayed value is readable."""

    def __init__(self) -> None:
        self.cycle: CycleReport | None = None
        self._this: CycleReport | None = None
        self._second = -1

    def add(self, cycle: CycleReport, time_s: float) -> None:
        """Add the next cycle; times must not decrease."""
        second = int(time_s)
        if second > self._second:
            before = self._this if second == self._second + 1 else None
            self.cycle, self._this, self._second = before, None, second
        if spent_us(cycle) > spent_us(self._this):
            self._this = cycle
        if spent_us(cycle) > spent_us(self.cycle):
            self.cycle = cycle


def spent_us(cycle: CycleReport | None) -> float:
    """Return the time spent in all stages, or minus infinity without a cycle."""
    return -inf if cycle is None else sum(cycle.stage_us)
