"""Measure how fast simulated time runs, from the stamps of the plant."""

from math import inf
from typing import Final

from runtime.units import NS_PER_S

WINDOW_NS: Final = 2 * NS_PER_S
STALE_NS: Final = 2 * WINDOW_NS
"""Without a message of the plant for this time, the factor is unknown."""
SLOW: Final = 0.9
"""Less than this share of the chosen speed is shown as slow."""
STILL: Final = 0.05
MIN_PACE: Final = 0.2


class TimeFactor:
    """Simulated over wall time in the last window, and whether that is less than `speed`.

    The stamps of the plant are used, because those of a robot jump when it is restarted. `speed` is
    the chosen factor, None if it is unknown, and `inf` without a limit.
    """

    def __init__(self, speed: float | None = None) -> None:
        self.speed = speed
        self._factor: float | None = None
        self._mark: tuple[int, int] | None = None
        self._arrived_ns = 0

    def take(self, stamp_ns: int, arrived_ns: int) -> None:
        """Take the newest stamp and the time of its arrival; the same one may be passed again."""
        if self._mark is None or stamp_ns < self._mark[0] or self._is_stale(arrived_ns):
            self._mark, self._factor = (stamp_ns, arrived_ns), None
        elif arrived_ns - self._mark[1] >= WINDOW_NS:
            self._factor = (stamp_ns - self._mark[0]) / (arrived_ns - self._mark[1])
            self._mark = (stamp_ns, arrived_ns)
        self._arrived_ns = arrived_ns

    def factor(self, now_ns: int) -> float | None:
        """Return simulated time over wall time; None while it is unknown."""
        return None if self._is_stale(now_ns) else self._factor

    def pace(self, now_ns: int) -> float:
        """Return how much slower than real time the simulation runs: from 0.2 to 1."""
        factor = self.factor(now_ns)
        return 1.0 if factor is None else min(1.0, max(MIN_PACE, factor))

    def words(self, now_ns: int) -> str:
        """Return the factor in words, as in `SIM 0.8x`."""
        factor = self.factor(now_ns)
        return "SIM" if factor is None else f"SIM {factor:.1f}x"

    def hint(self, now_ns: int) -> str:
        """Return why the simulation is slower than chosen; empty while it is not."""
        factor = self.factor(now_ns)
        if factor is None or self.speed is None or self.speed == inf:
            return ""
        if factor < STILL:
            return "stands still"
        return "computer busy" if factor < SLOW * self.speed else ""

    def _is_stale(self, now_ns: int) -> bool:
        return now_ns - self._arrived_ns > STALE_NS


def chosen_speed(text: str) -> float:
    """Return the factor of `--speed`."""
    return inf if text == "max" else float(text)
