"""Keep where the robot was and what it detected: trail, echoes, hit and leave points."""

from collections import deque
from collections.abc import Iterator
from math import cos, floor, hypot, isfinite, nan, sin
from typing import Final, NamedTuple

from protocol.ring import BEARINGS_RAD
from protocol.wire.enums import GoalState
from protocol.wire.messages import NavigatorStatus, PlanarOdometry, SonarScan

STEP_M: Final = 0.03
TRAIL: Final = 1000
GRID_M: Final = 0.05
ECHOES: Final = 1500
NEWEST_S: Final = 5.0
LATE_S: Final = 20.0
MARKS: Final = 200

Point = tuple[float, float]


class DrivenPath:
    """The whole path from its start; its resolution decreases as it grows."""

    def __init__(self, size: int = TRAIL) -> None:
        self._points: list[Point] = []
        self._model: tuple[Point, ...] | None = None
        self._size = size
        self._step_m = STEP_M

    def add(self, x_m: float, y_m: float) -> None:
        """Add a position, unless it is too close to the last one."""
        if not (isfinite(x_m) and isfinite(y_m)):
            return
        if self._points:
            last_x_m, last_y_m = self._points[-1]
            if hypot(x_m - last_x_m, y_m - last_y_m) < self._step_m:
                return
        self._points.append((x_m, y_m))
        self._model = None
        if len(self._points) > self._size:
            del self._points[1::2]
            self._step_m *= 2.0

    def points(self) -> tuple[Point, ...]:
        """Return the points; the same object until a point is added."""
        if self._model is None:
            self._model = tuple(self._points)
        return self._model


class AgedEchoes(NamedTuple):
    """Positions of echoes by age: the newest, those of the last 20 s, all older ones."""

    newest: tuple[Point, ...] = ()
    late: tuple[Point, ...] = ()
    old: tuple[Point, ...] = ()


class EchoGrid:
    """Positions of echoes, one for each cell of a grid; the cell unseen for longest is dropped."""

    def __init__(self, size: int = ECHOES) -> None:
        self._size = size
        self._cells: dict[tuple[int, int], tuple[Point, float]] = {}
        self._newest: list[Point] = []
        self._aged = AgedEchoes()
        self._aged_at_s = nan

    def add(self, x_m: float, y_m: float, time_s: float) -> None:
        """Add the position of an echo, received at `time_s`."""
        cell = round(x_m / GRID_M), round(y_m / GRID_M)
        known = self._cells.pop(cell, None)
        self._cells[cell] = (known[0] if known else (x_m, y_m)), time_s
        if known is None:
            self._newest.append((x_m, y_m))
        if len(self._cells) > self._size:
            del self._cells[next(iter(self._cells))]
            self._aged_at_s = nan

    def scan(self, scan: SonarScan, pose: PlanarOdometry, radius_m: float, time_s: float) -> None:
        """Add all echoes of a scan taken at this pose and received at `time_s`."""
        if not all(map(isfinite, (pose.x_m, pose.y_m, pose.heading_rad))):
            return
        for bearing_rad, range_m in zip(BEARINGS_RAD, ranges_m(scan), strict=True):
            if range_m is not None and isfinite(range_m):
                turn_rad = pose.heading_rad + bearing_rad
                reach_m = radius_m + range_m
                x_m, y_m = reach_m * cos(turn_rad), reach_m * sin(turn_rad)
                self.add(pose.x_m + x_m, pose.y_m + y_m, time_s)

    def by_age(self, time_s: float) -> AgedEchoes:
        """Return the points by age.

        They are sorted anew once a second. Until then the newest grow at their end by cells that
        are added, and the others are the same objects.
        """
        moment_s = floor(time_s)
        if moment_s != self._aged_at_s:
            self._aged_at_s = moment_s
            ages: tuple[list[Point], list[Point], list[Point]] = ([], [], [])
            for point, seen_s in self._cells.values():
                age_s = moment_s - seen_s
                ages[0 if age_s < NEWEST_S else 1 if age_s < LATE_S else 2].append(point)
            self._newest = ages[0]
            self._aged = AgedEchoes(*map(tuple, ages))
        elif len(self._newest) > len(self._aged.newest):
            self._aged = self._aged._replace(newest=tuple(self._newest))
        return self._aged


def ranges_m(scan: SonarScan, silent: int = 0) -> Iterator[float | None]:
    """Yield the ranges from right to left: inf for no echo, None for no measurement.

    `silent` has a bit for each sonar that gave no measurement lately.
    """
    valid = scan.valid & ~silent
    for sonar, range_mm in enumerate(scan.range_mm):
        if not valid >> sonar & 1:
            yield None
        else:
            yield range_mm / 1000.0 if scan.echo >> sonar & 1 else float("inf")


class BoundaryMarks:
    """Positions at which the robot began and ended to avoid obstacles on the way to this goal."""

    def __init__(self) -> None:
        self.hit: deque[Point] = deque(maxlen=MARKS)
        self.leave: deque[Point] = deque(maxlen=MARKS)
        self._goal_id = 0
        self._goal = int(GoalState.NONE)

    def update(self, status: NavigatorStatus, pose: PlanarOdometry) -> None:
        """Note the start or the end of an avoidance."""
        if status.goal_id != self._goal_id:
            self.hit.clear()
            self.leave.clear()
            self._goal_id, self._goal = status.goal_id, int(GoalState.NONE)
        here = pose.x_m, pose.y_m
        if all(map(isfinite, here)) and status.goal != self._goal:
            if status.goal == GoalState.AVOIDING:
                self.hit.append(here)
            elif self._goal == GoalState.AVOIDING and status.goal == GoalState.DRIVING:
                self.leave.append(here)
        self._goal = status.goal
