"""How often the screen is drawn, and how fast simulated time goes."""

from typing import Final, Protocol

from ground.station.station import Station
from protocol.topics import STATUS
from runtime.units import NS_PER_S

SLOW_HZ: Final = 2.0
MAX_DIVISOR: Final = 16
"""To one frame in 1.6 s, of ten a second."""
RECOVERY_NS: Final = 20 * NS_PER_S
"""So long after it was too slow a terminal is tried at twice the rate."""
WINDOW_NS: Final = 2 * NS_PER_S
SLACK_NS: Final = 25_000_000


class Drawable(Protocol):
    """Where the screen is drawn."""

    @property
    def busy(self) -> bool:
        """Something that was drawn has not been taken yet."""
        ...


class FrameRate:
    """Slower while nobody looks, and where one frame is not taken before the next one is due.

    What such a terminal has yet to take may be seconds of drawing: a key must not wait behind it.
    """

    def __init__(self, hz: float) -> None:
        self.hz = hz
        self.focused = True
        self.terminal: Drawable | None = None
        self.factor: float | None = None
        self.divisor = 1
        self._changed_ns = 0
        self._late = False
        self._drawn_ns: int | None = None
        self._mark: tuple[int, int] | None = None

    @property
    def period_ns(self) -> int:
        hz = self.hz / self.divisor
        hz = hz if self.focused else min(hz, SLOW_HZ)
        return round(NS_PER_S / hz) if hz else 0

    def due(self, now_ns: int) -> bool:
        """True when it is time to draw; a little early is better than a whole round late."""
        slack_ns = min(self.period_ns // 8, SLACK_NS)
        if self._drawn_ns is not None and now_ns - self._drawn_ns < self.period_ns - slack_ns:
            return False
        if self.terminal is not None and self.terminal.busy:
            self._too_fast(now_ns)
            return False
        if self.divisor > 1 and now_ns - self._changed_ns > RECOVERY_NS:
            self.divisor, self._changed_ns = self.divisor // 2, now_ns
        self._drawn_ns, self._late = now_ns, False
        return True

    def _too_fast(self, now_ns: int) -> None:
        """Once for each frame: half the rate from now on."""
        if not self._late:
            self._late, self._changed_ns = True, now_ns
            self.divisor = min(2 * self.divisor, MAX_DIVISOR)

    def measure_time_factor(self, station: Station) -> None:
        """The robot's stamps against our own clock, over two seconds."""
        newest = station.telemetry.latest(STATUS)
        if newest is None:
            return
        stamp_ns, arrived_ns = newest[0].time_ns, newest[1]
        if self._mark is None or stamp_ns < self._mark[0]:
            self._mark = (stamp_ns, arrived_ns)
        elif arrived_ns - self._mark[1] >= WINDOW_NS:
            self.factor = (stamp_ns - self._mark[0]) / (arrived_ns - self._mark[1])
            self._mark = (stamp_ns, arrived_ns)
