"""The mode: the robot's own mode, the newest command, and the mode that clients receive."""

from types import MappingProxyType
from typing import Final, NamedTuple

from gateways.mavlink.port import Snapshot
from protocol.wire.enums import Mode
from runtime.units import NS_PER_MS

CROSSING_NS: Final = 300 * NS_PER_MS
"""A status sent before a command may arrive up to this time after its answer."""


BY_NUMBER: Final = MappingProxyType({int(mode): mode for mode in Mode})


class Shown(NamedTuple):
    """The number that clients receive while the robot is in a mode."""

    mode: Mode
    number: int


class Modes:
    """Reads the robot's mode, and keeps the number that clients receive instead of it."""

    def __init__(self) -> None:
        self._now_ns = 0
        self._status: Mode | None = None
        self._commanded: Mode | None = None
        self._until_ns = 0
        self._shown: Shown | None = None
        self._next: Shown | None = None

    @property
    def mode(self) -> Mode | None:
        """The robot's mode, or the one that it has just accepted; None without telemetry."""
        return self._status if self._commanded is None else self._commanded

    @property
    def number(self) -> int | None:
        """The mode that clients receive; None without telemetry."""
        return self.number_of(self.mode)

    def number_of(self, mode: Mode | None) -> int | None:
        """Return the number that clients receive for a mode of the robot."""
        if mode is None:
            return None
        for shown in (self._shown, self._next):
            if shown is not None and shown.mode == mode:
                return shown.number
        return int(mode)

    def accepted(self, mode: Mode, number: int | None = None) -> None:
        """Store a mode that the robot has accepted, and the number that clients receive for it."""
        self._next = None if number is None else Shown(mode, number)
        if self._status == mode:
            self._shown = self._next
        if self._status != mode or self._commanded is not None:
            self._commanded, self._until_ns = mode, self._now_ns + CROSSING_NS

    def show(self, mode: Mode, number: int) -> None:
        """Send clients this number if the robot passes through a mode before the next one."""
        self._next = Shown(mode, number)

    def show_own(self) -> None:
        """Send clients the robot's own mode again."""
        self._shown = self._next = None

    def due(self, snapshot: Snapshot) -> None:
        """Read the robot's status."""
        self._now_ns = snapshot.now_ns
        status = snapshot.status
        self._status = None if status is None else BY_NUMBER.get(status.mode)
        if self._commanded is not None:
            if self._status != self._commanded and self._now_ns < self._until_ns:
                return
            self._commanded, self._shown, self._next = None, self._next, None
        if self._shown is not None and self._shown.mode != self._status:
            self._shown = None
