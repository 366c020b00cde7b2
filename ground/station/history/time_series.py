"""Keep values over time: the last minute in full, ten minutes thinned without losing peaks."""

from collections import deque
from math import isnan, nan
from typing import Final

SERIES: Final = (
    "speed",
    "goal_distance",
    "nearest_range",
    "cycle_us",
    "uncertainty_m",
    "late_us",
)
FULL: Final = 1200
THINNED_S: Final = 0.5
KEPT_S: Final = 600.0

Point = tuple[float, float]


class Series:
    """Values over time; NaN is a gap."""

    def __init__(self, full: int = FULL, kept_s: float = KEPT_S) -> None:
        self._full: deque[Point] = deque(maxlen=full)
        self._old: deque[Point] = deque(maxlen=2 * round(kept_s / THINNED_S))
        self._lowest: Point | None = None
        self._highest: Point | None = None

    def add(self, time_s: float, value: float) -> None:
        """Add the next value; times must not decrease."""
        if len(self._full) == self._full.maxlen:
            self._thin(self._full[0])
        self._full.append((time_s, value))

    def gap(self) -> None:
        """Add a gap, because the stream has stopped."""
        if self._full and not isnan(self._full[-1][1]):
            self.add(self._full[-1][0], nan)

    @property
    def last(self) -> Point | None:
        """The newest point."""
        return self._full[-1] if self._full else None

    def points(self, since_s: float = 0.0) -> list[Point]:
        """Return the points from the oldest; of each old half second the lowest and the highest."""
        return [
            point
            for part in (self._old, self._pending(), self._full)
            for point in part
            if point[0] >= since_s
        ]

    def _thin(self, point: Point) -> None:
        lowest, highest = self._lowest, self._highest
        if isnan(point[1]):
            self._flush()
            self._old.append(point)
        elif lowest is None or highest is None:
            self._lowest = self._highest = point
        elif point[0] - min(lowest[0], highest[0]) >= THINNED_S:
            self._flush()
            self._lowest = self._highest = point
        elif point[1] < lowest[1]:
            self._lowest = point
        elif point[1] > highest[1]:
            self._highest = point

    def _flush(self) -> None:
        self._old.extend(self._pending())
        self._lowest = self._highest = None

    def _pending(self) -> list[Point]:
        return sorted({point for point in (self._lowest, self._highest) if point is not None})


class SeriesTable(dict[str, Series]):
    """All series by name."""

    def __init__(self) -> None:
        super().__init__({name: Series() for name in SERIES})
