"""Read a gamepad by Linux's joystick device: its left stick counts while a shoulder button is held.

The device needs no library. An event has a time (ms), a value, a kind and a number; those that only
tell the state at the opening are marked. The numbers are those of the drivers for Xbox and
PlayStation gamepads: axes 0 and 1 are the left stick, buttons 4 and 5 are L1 and R1.
"""

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from struct import Struct
from typing import Final, NamedTuple

EVENT: Final = Struct("<IhBB")
MAX_BYTES: Final = 256 * EVENT.size
BUTTON: Final = 0x01
AXIS: Final = 0x02
AT_OPENING: Final = 0x80
SHOULDERS: Final = (4, 5)
ACROSS: Final = 0
ALONG: Final = 1
FULL: Final = 32767.0
DEAD_ZONE: Final = 0.1
"""A stick that is let go rests within this share of its way."""
DEVICES: Final = Path("/dev/input")


class Stick(NamedTuple):
    """The shares of the greatest speed and turn, -1 to 1; forward and left are positive."""

    ahead: float
    left: float


CENTRED: Final = Stick(0.0, 0.0)


def gamepads() -> list[Path]:
    """Return the devices, the first one first."""
    return sorted(DEVICES.glob("js*"))


class Gamepad:
    """The first of these devices that can be read, if there is one; it is read without waiting."""

    def __init__(self, devices: Iterable[Path] | None = None) -> None:
        self._held: set[int] = set()
        self._axes: dict[int, float] = {}
        self._device: int | None = None
        for path in gamepads() if devices is None else devices:
            with suppress(OSError):
                self._device = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
                return

    @property
    def is_there(self) -> bool:
        """True until it is unplugged or closed."""
        return self._device is not None

    def poll(self) -> Stick:
        """Return where the stick is now; centred unless a shoulder button is held."""
        self._read()
        return self._stick() if self._held else CENTRED

    def close(self) -> None:
        """Let go of it."""
        if self._device is not None:
            os.close(self._device)
        self._device, self._held = None, set()

    def _stick(self) -> Stick:
        ahead, left = (-self._axes.get(axis, 0.0) for axis in (ALONG, ACROSS))
        return Stick(*(0.0 if abs(one) < DEAD_ZONE else one for one in (ahead, left)))

    def _read(self) -> None:
        if self._device is None:
            return
        try:
            data = os.read(self._device, MAX_BYTES)
        except BlockingIOError:
            return
        except OSError:  # it was unplugged
            data = b""
        if not data:
            self.close()
        for _, value, kind, number in EVENT.iter_unpack(
            data[: len(data) // EVENT.size * EVENT.size]
        ):
            self._take(kind, number, value)

    def _take(self, kind: int, number: int, value: int) -> None:
        """Note an event; a button that was held before must be let go and pressed again."""
        if kind & ~AT_OPENING == AXIS:
            self._axes[number] = max(-1.0, min(1.0, value / FULL))
        elif kind & ~AT_OPENING == BUTTON and number in SHOULDERS:
            if not value:
                self._held.discard(number)
            elif not kind & AT_OPENING:
                self._held.add(number)
