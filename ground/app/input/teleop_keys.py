"""Drive by keys or a gamepad in MANUAL mode: hold them to drive, release them to stop."""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.app.app_interface import AppInterface
from ground.app.input.gamepad import CENTRED, Gamepad
from ground.app.panels.aged import live
from protocol.topics import STATUS
from protocol.wire.enums import Mode
from runtime.units import NS_PER_MS

SETTLE_NS: Final = 1_500_000_000
"""The time that the robot may take to enter MANUAL."""
FIRST_NS: Final = 600 * NS_PER_MS
"""The first press lasts longer than the 250 to 500 ms before a keyboard repeats."""
AGAIN_NS: Final = 200 * NS_PER_MS
"""A keyboard repeats a press every 30 to 50 ms."""
FAST: Final = (0.25, 1.2)
SLOW: Final = (0.08, 0.5)
"""Speed in m/s and yaw rate in rad/s."""
WAYS: Final[Mapping[str, tuple[int, int]]] = MappingProxyType(
    {"forward": (1, 0), "back": (-1, 0), "left": (0, 1), "right": (0, -1)}
)


class TeleopKeys:
    """Sends teleop commands while `held` is True."""

    def __init__(self, interface: AppInterface) -> None:
        self._interface = interface
        self._keys = DeadManSwitch()
        self._since_ns = 0
        self._gamepad: Gamepad | None = None
        self.held = False

    @property
    def has_gamepad(self) -> bool:
        """True while a gamepad can drive, too."""
        return self._gamepad is not None and self._gamepad.is_there

    def actions(self) -> Mapping[str, Callable[[], None]]:
        """Return the actions of teleop by id."""
        return {
            f"teleop-{way}{end}": partial(self.push, way, slow=slow)
            for way in WAYS
            for end, slow in (("", False), ("-slow", True))
        }

    def take(self) -> bool:
        """Start teleop. Return False, with the reason in the log, when it is refused."""
        self.held = self._interface.commands.begin_teleop()
        self._keys, self._since_ns = DeadManSwitch(), self._interface.station.now_ns
        if self.held:
            self._gamepad = Gamepad()
        return self.held

    def push(self, way: str, *, slow: bool) -> None:
        """Handle a press of a direction key."""
        if self.held:
            self._keys.press(way, self._interface.station.now_ns, slow=slow)

    def poll(self) -> bool:
        """Send the present command; return False when teleop has ended."""
        if self._is_preempted():
            self.drop()
        if self.held:
            self._interface.commands.steer(*self._twist())
        return self.held

    def _twist(self) -> "Twist":
        """Return the command of the gamepad while its stick is held, else that of the keys."""
        stick = CENTRED if self._gamepad is None else self._gamepad.poll()
        if stick == CENTRED:
            return self._keys.twist(self._interface.station.now_ns)
        return Twist(stick.ahead * FAST[0], stick.left * FAST[1])

    def drop(self) -> None:
        """Stop the robot and end teleop."""
        self.held = False
        if self._gamepad is not None:
            self._gamepad.close()
        self._interface.commands.end_teleop()

    def _is_preempted(self) -> bool:
        """Return whether the robot has left MANUAL.

        It was stopped or disarmed, or another client commanded it.
        """
        station = self._interface.station
        status = live(station.seen(STATUS))
        settled = station.now_ns - self._since_ns > SETTLE_NS
        return settled and (status is None or status.mode != Mode.MANUAL)


class Twist(NamedTuple):
    """A speed in m/s and a yaw rate in rad/s."""

    speed_m_s: float
    yaw_rate_rad_s: float


STILL: Final = Twist(0.0, 0.0)


class DeadManSwitch:
    """Holds one direction for speed and one for turning, each until its time is over."""

    def __init__(self) -> None:
        self._until_ns = [0, 0]
        self._signs = [0, 0]
        self._slow = False

    def press(self, way: str, now_ns: int, *, slow: bool = False) -> None:
        """Handle a press or its repetition; the opposite direction replaces the old one at once."""
        self._slow = slow
        for axis, sign in enumerate(WAYS[way]):
            if not sign:
                continue
            held = now_ns < self._until_ns[axis] and self._signs[axis] == sign
            self._signs[axis] = sign
            end_ns = now_ns + (AGAIN_NS if held else FIRST_NS)
            self._until_ns[axis] = max(end_ns, self._until_ns[axis]) if held else end_ns

    def twist(self, now_ns: int) -> Twist:
        """Return the present command; zero when no key is held."""
        speed, turn = SLOW if self._slow else FAST
        ahead, round = (
            sign if now_ns < until_ns else 0
            for sign, until_ns in zip(self._signs, self._until_ns, strict=True)
        )
        return Twist(ahead * speed, round * turn)
