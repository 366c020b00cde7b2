"""Choose how often the screen is drawn."""

from typing import Final, Protocol

from runtime.units import NS_PER_S

SLOW_HZ: Final = 2.0
MAX_DIVISOR: Final = 16
"""Ten frames a second become at least one in 1.6 s."""
RECOVERY_NS: Final = 20 * NS_PER_S
"""After this time without a late frame, the rate is doubled."""
SLACK_NS: Final = 25_000_000


class Drawable(Protocol):
    """A terminal that reports whether it has taken all that was drawn."""

    @property
    def busy(self) -> bool:
        """True while something that was drawn has not been taken."""
        ...


class FrameRate:
    """Lowers the frame rate while the terminal has no focus or is too slow.

    A slow terminal may buffer seconds of drawing, and a key would wait behind that.
    """

    def __init__(self, hz: float) -> None:
        self.hz = hz
        self.focused = True
        self.terminal: Drawable | None = None
        self.divisor = 1
        self._changed_ns = 0
        self._late = False
        self._drawn_ns: int | None = None

    @property
    def period_ns(self) -> int:
        """The time between two frames, in nanoseconds."""
        hz = self.hz / self.divisor
        hz = hz if self.focused else min(hz, SLOW_HZ)
        return round(NS_PER_S / hz) if hz else 0

    def due(self, now_ns: int) -> bool:
        """Return whether to draw now.

        A frame a little early is better than one that is a whole poll late.
        """
        slack_ns = min(self.period_ns // 8, SLACK_NS)
        if self._drawn_ns is not None and now_ns - self._drawn_ns < self.period_ns - slack_ns:
            return False
        if self.terminal is not None and self.terminal.busy:
            self._halve(now_ns)
            return False
        if self.divisor > 1 and now_ns - self._changed_ns > RECOVERY_NS:
            self.divisor, self._changed_ns = self.divisor // 2, now_ns
        self._drawn_ns, self._late = now_ns, False
        return True

    def _halve(self, now_ns: int) -> None:
        """Halve the rate, once for each late frame."""
        if not self._late:
            self._late, self._changed_ns = True, now_ns
            self.divisor = min(2 * self.divisor, MAX_DIVISOR)
