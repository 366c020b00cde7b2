"""Define which part of the plane the map shows, and at which scale.

The world is in metres, x to the right and y up; dots count from the top left corner, y down. Any
numbers, NaN included, give a usable view.
"""

from dataclasses import dataclass, replace
from math import isfinite
from typing import Final

from ground.map.canvas import DOTS_HIGH, DOTS_WIDE

MIN_M_PER_DOT: Final = 1e-4
MAX_M_PER_DOT: Final = 1e6
MAX_CENTRE_M: Final = 1e9
MARGIN_DOTS: Final = 2
MIN_LEGEND_ROWS: Final = 6
FOLLOW_SHARE: Final = 0.25
OPEN_FLOOR_M: Final = 4.0
GROWTH_SHARE: Final = 0.3
SCALE_STEPS: Final = (1.0, 2.0, 5.0)

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Least x and y, greatest x and y, in metres."""


@dataclass(frozen=True, slots=True)
class View:
    """A window of `columns` x `rows` cells around a centre; a dot is `m_per_dot` wide and high."""

    columns: int
    rows: int
    centre_x_m: float = 0.0
    centre_y_m: float = 0.0
    m_per_dot: float = 0.05

    @classmethod
    def fit(cls, box: Box | None, columns: int, rows: int, bounded: bool = True) -> "View":
        """Return the view that shows all of the box with a margin.

        There is a row for the legend where possible.

        A box that is not `bounded` may grow: it gets more room around it, and some open floor at
        least. So does a map without a box, or with an infinite one.
        """
        if box is None or not all(map(isfinite, box)):
            box, bounded = (0.0, 0.0, 0.0, 0.0), False
        across = max(1, DOTS_WIDE * columns - 2 * MARGIN_DOTS)
        below = DOTS_HIGH if rows >= MIN_LEGEND_ROWS else 0
        down = max(1, DOTS_HIGH * rows - 2 * MARGIN_DOTS - below)
        scale_m = max((box[2] - box[0]) / across, (box[3] - box[1]) / down)
        open_m = OPEN_FLOOR_M / min(across, down)
        if not bounded:
            scale_m = max(open_m, scale_m * (1.0 + GROWTH_SHARE))
        elif scale_m <= 0.0:
            scale_m = open_m
        centre = box[0] / 2.0 + box[2] / 2.0, box[1] / 2.0 + box[3] / 2.0
        return cls(columns, rows)._at(centre[0], centre[1] - below * scale_m / 2.0, scale_m)

    def resized(self, columns: int, rows: int) -> "View":
        """Return the same view with another number of cells."""
        return replace(self, columns=columns, rows=rows)

    def zoomed(self, factor: float, about: Point | None = None) -> "View":
        """Return the view enlarged by a factor about a point, or about the centre."""
        if not (isfinite(factor) and factor > 0.0):
            return self
        x_m, y_m = about or (self.centre_x_m, self.centre_y_m)
        scale_m = min(MAX_M_PER_DOT, max(MIN_M_PER_DOT, self.m_per_dot / factor))
        share = scale_m / self.m_per_dot
        centre_x_m = x_m + (self.centre_x_m - x_m) * share
        return self._at(centre_x_m, y_m + (self.centre_y_m - y_m) * share, scale_m)

    def centred(self, x_m: float, y_m: float) -> "View":
        """Return the view moved to a centre."""
        return self._at(x_m, y_m, self.m_per_dot)

    def following(self, x_m: float, y_m: float) -> "View":
        """Return the view moved to the point when that is near the edge, else the view unchanged.

        A map that moved with every step would be redrawn with every step, and hard to read.
        """
        x, y = self.to_dots(x_m, y_m)
        wide, high = DOTS_WIDE * self.columns, DOTS_HIGH * self.rows
        near = FOLLOW_SHARE * wide <= x <= (1.0 - FOLLOW_SHARE) * wide
        if near and FOLLOW_SHARE * high <= y <= (1.0 - FOLLOW_SHARE) * high:
            return self
        return self.centred(x_m, y_m)

    def to_dots(self, x_m: float, y_m: float) -> Point:
        """Return the position of a place on the canvas, in dots and fractions of them."""
        x = (x_m - self.centre_x_m) / self.m_per_dot + self.columns
        return x, (self.centre_y_m - y_m) / self.m_per_dot + 2.0 * self.rows

    def to_metres(self, x: float, y: float) -> Point:
        """Return the place under a point of the canvas, the inverse of `to_dots`."""
        x_m = self.centre_x_m + (x - self.columns) * self.m_per_dot
        return x_m, self.centre_y_m - (y - 2.0 * self.rows) * self.m_per_dot

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int] | None:
        """Return column and row of a place, which may be off the map; None if not finite."""
        x, y = self.to_dots(x_m, y_m)
        if not (isfinite(x) and isfinite(y)):
            return None
        return int(x // DOTS_WIDE), int(y // DOTS_HIGH)

    def middle(self) -> Point:
        """Return the centre in metres."""
        return self.centre_x_m, self.centre_y_m

    def middle_of(self, column: int, row: int) -> Point:
        """Return the place in the middle of a cell."""
        return self.to_metres(DOTS_WIDE * (column + 0.5), DOTS_HIGH * (row + 0.5))

    def box(self) -> Box:
        """Return the box that is shown."""
        left_m, top_m = self.to_metres(0.0, 0.0)
        right_m, low_m = self.to_metres(DOTS_WIDE * self.columns, DOTS_HIGH * self.rows)
        return left_m, low_m, right_m, top_m

    def shows(self, box: Box) -> bool:
        """Return whether all of the box is on the map."""
        left_m, low_m, right_m, top_m = self.box()
        wide = left_m <= box[0] and box[2] <= right_m
        return wide and low_m <= box[1] and box[3] <= top_m

    def scale_bar(self, most_cells: int) -> tuple[float, int]:
        """Return a round length in metres and its cells: the longest that fits, at least 1."""
        most_m = max(1, most_cells) * DOTS_WIDE * self.m_per_dot
        power = 10.0
        while power < most_m:
            power *= 10.0
        while power > most_m:
            power /= 10.0
        length_m = max(
            power * step for step in SCALE_STEPS if power * step <= most_m * (1.0 + 1e-9)
        )
        return length_m, max(1, round(length_m / (DOTS_WIDE * self.m_per_dot)))

    def _at(self, x_m: float, y_m: float, scale_m: float) -> "View":
        if not (isfinite(x_m) and isfinite(y_m) and isfinite(scale_m)):
            return self
        x_m, y_m = (max(-MAX_CENTRE_M, min(MAX_CENTRE_M, value_m)) for value_m in (x_m, y_m))
        scale_m = min(MAX_M_PER_DOT, max(MIN_M_PER_DOT, scale_m))
        return View(self.columns, self.rows, x_m, y_m, scale_m)
