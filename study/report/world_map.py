"""A map of a world with the drives in it."""

from collections.abc import Sequence
from itertools import pairwise
from math import atan2, cos, degrees, pi, sin, sqrt
from typing import Final

import numpy as np

from plant.model.configuration import body_of
from protocol.outcome import CHI2_2, LOST, UNREACHABLE
from protocol.world import Point, Polyline, World, WorldCircle, WorldPolygon
from study.intervals import Floats
from study.report.charts import Dot, SvgDrawing, colour, dashed
from study.report.drives import DrivenTrial, Pose

RIM: Final = 8.0
STRAIGHT_M: Final = 0.004
MARK: Final = 4.5
FOOT: Final = 14.0


class WorldMap:
    """A map of a world; metres to pixels, y upwards."""

    def __init__(self, world: World, width: float, title: str) -> None:
        self.world = world
        width_m, height_m = world.size_m
        self._scale = min((width - 2 * RIM) / width_m, 1.15 * (width - 2 * RIM) / height_m)
        self._top = RIM + height_m * self._scale
        wide = 2 * RIM + width_m * self._scale
        self.drawing = SvgDrawing(wide, self._top + RIM + FOOT, title)
        self._ground()

    def at(self, point: Point) -> Dot:
        """Return the pixel of a point in metres."""
        return RIM + point[0] * self._scale, self._top - point[1] * self._scale

    def add(self, drive: DrivenTrial, belief: bool = False, faint: bool = False) -> None:
        """Draw the true path in the navigator's colour; with `belief` the estimated one dotted."""
        label = f"{drive.trial.navigator}, {drive.trial.side}"
        kind = f"way l-{colour(label)}{dashed(label)}{' faint' if faint else ''}"
        self.drawing.polyline(map(self.at, simplified(drive.true)), kind)
        if belief:
            self.drawing.polyline(map(self.at, simplified(drive.believed)), "believed")
            self._ellipse(drive)
        if not faint:
            self._end(drive, colour(label))

    def ends(self) -> None:
        """Draw start, goal with tolerance and heading, and a bar one metre long."""
        world, body = self.world, body_of(self.world)
        start, goal = self.at((world.start.x_m, world.start.y_m)), world.goal
        self.drawing.circle(start, 3.0, "start")
        self._heading(start, world.start.heading_rad, 4.0, body.radius_m * self._scale)
        centre = self.at((goal.x_m, goal.y_m))
        self.drawing.circle(centre, max(6.5, goal.position_tolerance_m * self._scale), "goal")
        if goal.heading_rad is not None:
            self._heading(centre, goal.heading_rad, 6.5, 13.0)
        y = self._top + RIM + 4.0
        self.drawing.line((RIM, y), (RIM + self._scale, y), "axis")
        self.drawing.text((RIM + self._scale + 5.0, y + 3.5), "1 m", "small")

    def legend(self, labels: Sequence[str]) -> None:
        """Draw the line style of each navigator beside the bar."""
        x, y = RIM + self._scale + 40.0, self._top + RIM + 4.0
        for label in labels:
            self.drawing.line((x, y), (x + 16.0, y), f"way l-{colour(label)}{dashed(label)}")
            self.drawing.text((x + 20.0, y + 3.5), label, "small")
            x += 32.0 + 5.6 * len(label)

    def straight(self) -> None:
        """Draw the straight line from start to goal."""
        start, goal = self.world.start, self.world.goal
        ends = self.at((start.x_m, start.y_m)), self.at((goal.x_m, goal.y_m))
        self.drawing.line(*ends, "straight")

    def _ground(self) -> None:
        width_m, height_m = self.world.size_m
        kind = "rim" if self.world.walls else "ground"
        corner = self.at((0.0, height_m))
        self.drawing.rectangle(corner, width_m * self._scale, height_m * self._scale, kind)
        for obstacle in self.world.obstacles:
            if isinstance(obstacle, WorldPolygon):
                self.drawing.polygon(map(self.at, obstacle.points_m), "solid")
            elif isinstance(obstacle, Polyline):
                self._wall(obstacle)
            else:
                self._disc(obstacle)

    def _wall(self, wall: Polyline) -> None:
        half = max(0.5, wall.thickness_m * self._scale / 2.0)
        wall_parts(self.drawing, [self.at(point) for point in wall.points_m], half)

    def _disc(self, disc: WorldCircle) -> None:
        if disc.path_m:
            self.drawing.polyline(map(self.at, disc.path_m), "moverline")
        kind = "mover" if disc.path_m else "solid"
        self.drawing.circle(self.at((disc.x_m, disc.y_m)), disc.radius_m * self._scale, kind)

    def _heading(self, at: Dot, heading_rad: float, near: float, far: float) -> None:
        dx, dy = cos(heading_rad), -sin(heading_rad)
        ends = (at[0] + near * dx, at[1] + near * dy), (at[0] + far * dx, at[1] + far * dy)
        self.drawing.line(*ends, "goal")

    def _ellipse(self, drive: DrivenTrial) -> None:
        """Draw the confidence ellipse around the last estimated position."""
        long_m, short_m, turn_rad = ellipse(drive.covariance)
        x_m, y_m, _ = drive.believed[-1]
        radii = long_m * self._scale, short_m * self._scale
        self.drawing.ellipse(self.at((x_m, y_m)), radii, -degrees(turn_rad), "doubt")

    def _end(self, drive: DrivenTrial, name: str) -> None:
        x_m, y_m, _ = drive.true[-1]
        end_mark(self.drawing, self.at((x_m, y_m)), drive.outcome.outcome, f"mark f-{name}")


def wall_parts(drawing: SvgDrawing, dots: Sequence[Dot], half: float) -> None:
    """Draw a wall with round ends and joints; `half` is half its width in pixels."""
    for a, b in pairwise(dots):
        drawing.polygon(_bar(a, b, half), "solid")
    for dot in dots:
        drawing.circle(dot, half, "solid")


def end_mark(drawing: SvgDrawing, at: Dot, outcome: str, kind: str) -> None:
    """Draw the mark of an outcome.

    Disc: reached; cross: collided; square: stuck; bar: unreachable; rhombus: lost; triangle:
    others.
    """
    x, y = at
    if outcome == "reached":
        drawing.circle(at, MARK, kind)
    elif outcome == "collided":
        drawing.line((x - MARK, y - MARK), (x + MARK, y + MARK), "cross")
        drawing.line((x - MARK, y + MARK), (x + MARK, y - MARK), "cross")
    elif outcome == "stuck":
        drawing.rectangle((x - MARK, y - MARK), 2 * MARK, 2 * MARK, kind)
    elif outcome == UNREACHABLE:
        drawing.rectangle((x - MARK, y - MARK / 2), 2 * MARK, MARK, kind)
    elif outcome == LOST:
        drawing.polygon(((x, y - MARK), (x + MARK, y), (x, y + MARK), (x - MARK, y)), kind)
    else:
        tip = ((x, y - MARK - 1), (x - MARK, y + MARK - 1), (x + MARK, y + MARK - 1))
        drawing.polygon(tip, kind)


def ellipse(covariance: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return both semi-axes of the confidence ellipse in m, and the direction of the longer."""
    xx, xy, yy = covariance
    middle, half = (xx + yy) / 2.0, sqrt(((xx - yy) / 2.0) ** 2 + xy * xy)
    long_m = sqrt(CHI2_2 * max(0.0, middle + half))
    short_m = sqrt(CHI2_2 * max(0.0, middle - half))
    return long_m, short_m, 0.5 * atan2(2.0 * xy, xx - yy) if half > 0.0 else 0.0


def simplified(poses: Sequence[Pose]) -> list[Point]:
    """Return the path without points that a straight line covers within `STRAIGHT_M`.

    Ramer, Douglas and Peucker's algorithm with a stack instead of recursion.
    """
    points = np.array(poses, dtype=np.float64)[:, :2]
    kept = np.zeros(len(points), dtype=np.bool_)
    kept[[0, -1]] = True
    pending = [(0, len(points) - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        away_m = _away_m(points[first + 1 : last], points[first], points[last])
        worst = int(away_m.argmax())
        if away_m[worst] > STRAIGHT_M:
            middle = first + 1 + worst
            kept[middle] = True
            pending += [(first, middle), (middle, last)]
    return [(x_m, y_m) for x_m, y_m in points[kept].tolist()]


def _away_m(points: Floats, a: Floats, b: Floats) -> Floats:
    """Return the distance of each point from the segment ab."""
    along, off = b - a, points - a
    length2 = float(along @ along)
    share = np.clip(off @ along / length2, 0.0, 1.0) if length2 > 0.0 else np.zeros(len(points))
    away: Floats = np.sqrt(((off - share[:, None] * along) ** 2).sum(axis=1))
    return away


def _bar(a: Dot, b: Dot, half: float) -> tuple[Dot, Dot, Dot, Dot]:
    """Return the corners of a line of width 2 `half`."""
    turn = atan2(b[1] - a[1], b[0] - a[0]) + pi / 2.0
    dx, dy = half * cos(turn), half * sin(turn)
    return (
        (a[0] + dx, a[1] + dy),
        (b[0] + dx, b[1] + dy),
        (b[0] - dx, b[1] - dy),
        (
            a[0] - dx,
            a[1] - dy,
        ),
    )
