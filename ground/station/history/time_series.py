"""Keep values over time: the last minute in full, ten minutes thinned without losing peaks.

The values are those of the station, and numeric fields of messages that were chosen.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from functools import cache
from math import isfinite, isnan, nan
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from ground.client.telemetry import Age, Telemetry
from protocol.topics import TOPICS, Topic
from protocol.wire.message import LAYOUT, Message
from runtime.units import NS_PER_S

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

    def __init__(self, full: int = FULL) -> None:
        self._full: deque[Point] = deque(maxlen=full)
        self._old: deque[Point] = deque(maxlen=2 * round(KEPT_S / THINNED_S))
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


UNITS: Final = (
    ("_m_s", "m/s"), ("_rad_s", "rad/s"), ("_rad2", "rad²"), ("_m_rad", "m rad"), ("_m2", "m²"),
    ("_rad", "rad"), ("_mm", "mm"), ("_us", "µs"), ("_ms", "ms"), ("_ns", "ns"), ("_hz", "Hz"),
    ("_m", "m"), ("_s", "s"),
)  # fmt: skip
"""Ends of field names and their units, the longest first."""


class MessageField(NamedTuple):
    """A number in the messages of a topic; `element` is the position in an array."""

    topic: Topic[Any]
    name: str
    element: int | None

    @property
    def key(self) -> str:
        """The name of its series."""
        place = "" if self.element is None else f"[{self.element}]"
        return f"{self.topic.path} {self.name}{place}"

    @property
    def unit(self) -> str:
        """The unit, by the end of the name."""
        return next((unit for end, unit in UNITS if self.name.endswith(end)), "")

    def value_in(self, message: Message) -> float:
        """Return the value; NaN if the message is of another type or the value is not finite."""
        found: Any = getattr(message, self.name, None)
        if found is None:
            return nan
        value = float(found if self.element is None else found[self.element])
        return value if isfinite(value) else nan


@cache
def numeric_fields() -> Mapping[str, MessageField]:
    """Return the numeric fields of all topics by their key."""
    found = (
        MessageField(topic, field.name, element)
        for topic in TOPICS
        for message in topic.messages
        for field in LAYOUT[message.__name__].fields
        if not field.is_text
        for element in (range(field.length) if field.length else (None,))
    )
    return MappingProxyType({one.key: one for one in found})


class MessageSeries:
    """Series of the fields that were chosen; each begins when it is chosen."""

    def __init__(self, telemetry: Telemetry, began_ns: int) -> None:
        self.series: dict[str, Series] = {}
        self._telemetry = telemetry
        self._began_ns = began_ns
        self._taken_ns: dict[str, int] = {}

    def watch(self, keys: Iterable[str]) -> None:
        """Keep these fields from now on, and drop all others."""
        wanted = [key for key in keys if key in numeric_fields()]
        self.series = {key: self.series.get(key) or Series() for key in wanted}

    def poll(self, now_ns: int) -> None:
        """Add the newest values; a stream that stops leaves a gap."""
        for key, series in self.series.items():
            field = numeric_fields()[key]
            newest = self._telemetry.latest(field.topic)
            if newest is None:
                continue
            message, arrived_ns = newest
            if self._taken_ns.get(key) != arrived_ns:
                self._taken_ns[key] = arrived_ns
                series.add((arrived_ns - self._began_ns) / NS_PER_S, field.value_in(message))
            elif self._telemetry.age_of(field.topic, now_ns - arrived_ns) is Age.GONE:
                series.gap()
