"""How often the screen is drawn, and how fast simulated time goes."""

from typing import Final

from ground.station.station import Station
from protocol.topics import STATUS

NS_PER_S: Final = 1_000_000_000
SLOW_HZ: Final = 2.0
WINDOW_NS: Final = 2 * NS_PER_S
SLACK_NS: Final = 25_000_000


class Pace:
    """Slower while nobody looks or the terminal cannot keep up."""

    def __init__(self, hz: float) -> None:
        self.hz = hz
        self.watched = True
        self.choked = False
        self.factor: float | None = None
        self._drawn_ns: int | None = None
        self._mark: tuple[int, int] | None = None

    @property
    def period_ns(self) -> int:
        hz = self.hz if self.watched and not self.choked else min(self.hz, SLOW_HZ)
        return round(NS_PER_S / hz) if hz else 0

    def due(self, now_ns: int) -> bool:
        """True when it is time to draw; a little early is better than a whole round late."""
        slack_ns = min(self.period_ns // 8, SLACK_NS)
        if self._drawn_ns is not None and now_ns - self._drawn_ns < self.period_ns - slack_ns:
            return False
        self._drawn_ns = now_ns
        return True

    def heard(self, station: Station) -> None:
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
