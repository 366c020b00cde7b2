"""Position in a recording, stopped or moving at a speed, which also serves as a clock."""

from typing import Final

from runtime.clock import Clock
from runtime.units import NS_PER_S

SLOWEST: Final = 0.0625
FASTEST: Final = 64.0


class Timeline:
    """`position_ns` counts from the first frame; `now_ns` is the same instant in UTC."""

    def __init__(self, clock: Clock, start_ns: int, duration_ns: int) -> None:
        self._clock = clock
        self._start_ns = start_ns
        self.duration_ns = duration_ns
        self.speed = 1.0
        self.playing = False
        self._anchor_ns = 0
        self._since_ns = 0

    @property
    def position_ns(self) -> int:
        """Position in ns; playing stops at the end."""
        if not self.playing:
            return self._anchor_ns
        passed_ns = self._clock.now_ns() - self._since_ns
        position_ns = self.clamped(self._anchor_ns + round(passed_ns * self.speed))
        if position_ns >= self.duration_ns:
            self._anchor_ns, self.playing = self.duration_ns, False
        return position_ns

    @property
    def position_s(self) -> float:
        """Position in s."""
        return self.position_ns / NS_PER_S

    def play(self, speed: float | None = None) -> None:
        """Play from the present position; the speed is limited to the supported range."""
        self.move_to(self.position_ns)
        if speed is not None:
            self.speed = min(max(speed, SLOWEST), FASTEST)
        self.playing = True

    def pause(self) -> None:
        """Stop at the present position."""
        self.move_to(self.position_ns)
        self.playing = False

    def move_to(self, position_ns: int) -> None:
        """Move to a position in ns."""
        self._anchor_ns = self.clamped(position_ns)
        self._since_ns = self._clock.now_ns()

    def clamped(self, position_ns: int) -> int:
        """Return the nearest position inside the recording."""
        return min(max(position_ns, 0), self.duration_ns)

    def now_ns(self) -> int:
        """Return the position in UTC."""
        return self._start_ns + self.position_ns

    def cpu_ns(self) -> int:
        """Return the processor time of the real clock."""
        return self._clock.cpu_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at once: a recording is polled."""
