"""The goal cursor: a place on the map in round figures, with a heading or with any."""

from dataclasses import dataclass, replace
from math import floor, log10
from typing import Final

TURN_DEG: Final = 15.0
FAR: Final = 10.0
STEPS: Final = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Cursor:
    """Metres; degrees, for it becomes a line that a person reads. None: any heading will do."""

    x_m: float
    y_m: float
    heading_deg: float | None = None

    def moved(self, right: float, up: float, step_m: float) -> "Cursor":
        """By so many steps, onto the grid of the steps."""
        x_m = round(self.x_m / step_m + right) * step_m
        y_m = round(self.y_m / step_m + up) * step_m
        return replace(self, x_m=round(x_m, 6), y_m=round(y_m, 6))

    def turned(self, times: int) -> "Cursor":
        """Counter-clockwise; the first turn makes the heading one at all."""
        start_deg = 0.0 if self.heading_deg is None else self.heading_deg + times * TURN_DEG
        return replace(self, heading_deg=(start_deg + 180.0) % 360.0 - 180.0)

    def words(self) -> str:
        """As the command line takes it."""
        place = f"{self.x_m:g} {self.y_m:g}"
        return place if self.heading_deg is None else f"{place} {self.heading_deg:g}"


def step_of(m_per_cell: float) -> float:
    """The least of 1, 2 and 5 times a power of ten, in metres, that is seen to move."""
    power = 10.0 ** floor(log10(max(m_per_cell, 1e-3)))
    return next(step * power for step in STEPS if step * power >= m_per_cell * 0.999)
