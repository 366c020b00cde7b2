"""Draw in metres on a canvas: lines, shapes, marks, and the ellipse that contains the robot.

A point with a NaN or an infinity is left out and interrupts a line.
"""

from collections.abc import Iterable, Sequence
from math import atan2, ceil, cos, floor, hypot, isfinite, pi, sin, sqrt
from typing import Final

from ground.map.canvas import DOTS_HIGH, DOTS_WIDE, Canvas, Dot
from ground.map.scene import Disc, Point, Shape, View
from protocol.outcome import CHI2_2

WHOLE_TURN_RAD: Final = 2.0 * pi
DOTS_PER_CHORD: Final = 3.0
MIN_CHORDS: Final = 6
MAX_CHORDS: Final = 240
MAX_POINTS: Final = 500
EDGE_DOTS: Final = 1.5 * DOTS_HIGH  # the last row holds the legend


class Pen:
    """Draws on a canvas through a view."""

    def __init__(self, canvas: Canvas, view: View) -> None:
        self.canvas, self.view = canvas, view
        self._per_m = 1.0 / view.m_per_dot
        self._right = view.columns - view.centre_x_m * self._per_m
        self._down = 2.0 * view.rows + view.centre_y_m * self._per_m

    def path(self, points: Iterable[Point], role: str) -> None:
        """Draw lines from point to point, interrupted at points that are not finite."""
        for dots in self._placed(points):
            self.canvas.polyline(dots, role)

    def dots(self, points: Iterable[Point], role: str, *, below: str = "") -> None:
        """Draw a dot at each point; cells that have a role from `below` on keep it."""
        for dots in self._placed(points):
            self.canvas.dots(dots, role, below=below)

    def dotted(self, a: Point, b: Point, role: str, every: int) -> None:
        """Draw a line from `a` to `b` with one dot in `every` set."""
        length = hypot(b[0] - a[0], b[1] - a[1]) * self._per_m
        if not isfinite(length):
            return
        count = min(MAX_POINTS, max(1, round(length / every)))
        step_x_m, step_y_m = (b[0] - a[0]) / count, (b[1] - a[1]) / count
        self.dots(
            ((a[0] + i * step_x_m, a[1] + i * step_y_m) for i in range(count + 1)),
            role,
        )

    def shape(self, shape: Shape, role: str) -> None:
        """Draw the edge of a shape."""
        if isinstance(shape, Disc):
            self.circle((shape.x_m, shape.y_m), shape.radius_m, role)
        else:
            ends = shape.points_m[:1] if shape.closed else ()
            self.path((*shape.points_m, *ends), role)

    def circle(self, centre: Point, radius_m: float, role: str) -> None:
        """Draw a circle."""
        self.path(self.curve(centre, radius_m, radius_m), role)

    def disc(self, centre: Point, radius_m: float, role: str) -> None:
        """Draw a filled circle, row by row; meant for small ones."""
        radius = radius_m * self._per_m
        if not 0.0 <= radius <= MAX_POINTS:
            return
        for x, y in self._placed([centre])[0]:
            for down in range(-floor(radius), floor(radius) + 1):
                half = floor(sqrt(radius * radius - down * down))
                self.canvas.line(x - half, y + down, x + half, y + down, role)

    def uncover(self, centre: Point, radius_m: float, role: str) -> None:
        """Remove marks of a lower rank from the cells of a filled circle."""
        cell, radius = self.view.cell_of(*centre), radius_m * self._per_m
        if cell is None or not 0.0 <= radius <= MAX_POINTS:
            return
        wide, high = floor(radius / DOTS_WIDE), floor(radius / DOTS_HIGH)
        for row in range(cell[1] - high, cell[1] + high + 1):
            for column in range(cell[0] - wide, cell[0] + wide + 1):
                self.canvas.uncover(column, row, role)

    def arc(self, centre: Point, radius_m: float, ends_rad: Point, role: str) -> None:
        """Draw an arc, counter-clockwise from the first bearing to the second."""
        self.path(self.curve(centre, radius_m, radius_m, ends_rad=ends_rad), role)

    def curve(
        self,
        centre: Point,
        long_m: float,
        short_m: float,
        turn_rad: float = 0.0,
        ends_rad: Point = (0.0, WHOLE_TURN_RAD),
    ) -> Sequence[Point]:
        """Return points of an ellipse, or of a part of it, close enough to look round.

        `turn_rad` turns the long axis; `ends_rad` are the angles of the first and last point.
        """
        begun_rad, length_rad = ends_rad[0], ends_rad[1] - ends_rad[0]
        around = long_m * self._per_m * abs(length_rad)
        if not (isfinite(around) and isfinite(turn_rad) and around >= 0.0):
            return ()
        least = ceil(MIN_CHORDS * abs(length_rad) / WHOLE_TURN_RAD)
        chords = max(least, min(MAX_CHORDS, ceil(around / DOTS_PER_CHORD)))
        cosine, sine, step_rad = cos(turn_rad), sin(turn_rad), length_rad / max(1, chords)
        points = []
        for chord in range(chords + 1):
            angle_rad = begun_rad + chord * step_rad
            x_m, y_m = long_m * cos(angle_rad), short_m * sin(angle_rad)
            points.append(
                (centre[0] + x_m * cosine - y_m * sine, centre[1] + x_m * sine + y_m * cosine)
            )
        return points

    def mark(
        self, at: Point, meaning: str, role: str, label: str = "", to_left: bool = False
    ) -> None:
        """Draw a character at a place with a label beside it, on the left if `to_left` and free."""
        cell = self.view.cell_of(*at)
        if cell is not None:
            self.canvas.mark(*cell, meaning, role)
            self._label(cell, label, role, to_left)

    def label(self, at: Point, label: str, role: str, *, is_optional: bool) -> None:
        """Write a label beside a place; an optional one only where it covers nothing."""
        cell = self.view.cell_of(*at)
        if cell is not None:
            self._label(cell, label, role, is_optional=is_optional)

    def heading(self, at: Point, heading_rad: float, role: str, label: str = "") -> None:
        """Draw an arrowhead in the nearest of eight directions.

        An infinite or NaN heading draws nothing.
        """
        cell = self.view.cell_of(*at)
        if cell is not None and isfinite(heading_rad):
            self.canvas.heading(*cell, nearest_eighth(heading_rad), role)
            self._label(cell, label, role)

    def shows(self, at: Point) -> bool:
        """Return whether a place is on the map."""
        cell = self.view.cell_of(*at)
        if cell is None:
            return False
        return 0 <= cell[0] < self.canvas.columns and 0 <= cell[1] < self.canvas.rows

    def off_map(self, at: Point, role: str, label: str) -> None:
        """Draw an arrow on the edge towards a place that is outside the map."""
        x_m, y_m = self.view.centre_x_m, self.view.centre_y_m
        away_x, away_y = (at[0] - x_m) * self._per_m, (at[1] - y_m) * self._per_m
        if not (isfinite(away_x) and isfinite(away_y)) or self.shows(at):
            return
        share = min(
            (self.canvas.width / 2.0 - 1.0) / max(1e-9, abs(away_x)),
            (self.canvas.height / 2.0 - EDGE_DOTS) / max(1e-9, abs(away_y)),
        )
        to_edge_m = max(0.0, share) * self.view.m_per_dot
        cell = self.view.cell_of(x_m + away_x * to_edge_m, y_m + away_y * to_edge_m)
        if cell is not None:
            self.canvas.pointer(*cell, nearest_eighth(atan2(away_y, away_x)), role)
            self._label(cell, label, role)

    def _label(
        self,
        cell: tuple[int, int],
        label: str,
        role: str,
        to_left: bool = False,
        *,
        is_optional: bool = False,
    ) -> None:
        """Write a label on its first free side: right, left, below, above; else on the first.

        One that is optional is left out if no side is free.
        """
        column, row = cell
        wide = len(label)
        if not (wide and 0 <= column < self.canvas.columns and 0 <= row < self.canvas.rows):
            return
        right, left = (column + 2, row), (column - 1 - wide, row)
        beside = (left, right) if to_left else (right, left)
        places = (*beside, (column, row + 1), (column, row - 1))
        for place in places:
            fits = 0 <= place[0] <= self.canvas.columns - wide
            if fits and not self.canvas.is_occupied(*place, wide):
                self.canvas.text(*place, label, role)
                return
        if not is_optional:
            self.canvas.text(*places[0], label, role)

    def _placed(self, points: Iterable[Point]) -> list[list[Dot]]:
        """Return the dots of the points, in pieces that are split where a point is not finite."""
        per_m, right, down = self._per_m, self._right, self._down
        points = list(points)
        try:
            return [[(floor(x * per_m + right), floor(down - y * per_m)) for x, y in points]]
        except (ValueError, OverflowError):
            return self._pieces(points)

    def _pieces(self, points: Iterable[Point]) -> list[list[Dot]]:
        pieces: list[list[Dot]] = [[]]
        for x_m, y_m in points:
            x, y = x_m * self._per_m + self._right, self._down - y_m * self._per_m
            if isfinite(x) and isfinite(y):
                pieces[-1].append((floor(x), floor(y)))
            elif pieces[-1]:
                pieces.append([])
        return pieces


def nearest_eighth(angle_rad: float) -> int:
    """Return the nearest multiple of 45 degrees, from 0 to 8."""
    return round(angle_rad % WHOLE_TURN_RAD / (pi / 4.0))


def ellipse(covariance: tuple[float, float, float]) -> tuple[float, float, float] | None:
    """Return the half axes in metres, the longer first, and its direction in radians.

    `covariance` is xx, xy, yy in m2. Return None when these are not a covariance.
    """
    xx, xy, yy = covariance
    middle, spread = xx / 2.0 + yy / 2.0, xx / 2.0 - yy / 2.0
    half = sqrt(spread * spread + xy * xy)
    if not (isfinite(middle) and isfinite(half)) or middle + half < 0.0:
        return None
    long_m = sqrt(CHI2_2 * (middle + half))
    short_m = sqrt(CHI2_2 * max(0.0, middle - half))
    return long_m, short_m, 0.5 * atan2(2.0 * xy, xx - yy) if half > 0.0 else 0.0
