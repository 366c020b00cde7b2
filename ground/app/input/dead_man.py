"""Teleop by keys: a terminal tells no release, so what is not pressed again ends by itself."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from runtime.units import NS_PER_MS

FIRST_NS: Final = 600 * NS_PER_MS
"""A keyboard begins to repeat after 250 to 500 ms: the first press lasts longer than that."""
AGAIN_NS: Final = 200 * NS_PER_MS
"""A repeated press comes every 30 to 50 ms."""
FAST: Final = (0.25, 1.2)
SLOW: Final = (0.08, 0.5)
"""m/s and rad/s."""


class Twist(NamedTuple):
    speed_m_s: float
    yaw_rate_rad_s: float


STILL: Final = Twist(0.0, 0.0)
WAYS: Final[Mapping[str, tuple[int, int]]] = MappingProxyType(
    {"forward": (1, 0), "back": (-1, 0), "left": (0, 1), "right": (0, -1)}
)


class DeadMan:
    """Holds one way for speed and one for turning, each until its time is out."""

    def __init__(self) -> None:
        self._until_ns = [0, 0]
        self._signs = [0, 0]
        self._slow = False

    def press(self, way: str, now_ns: int, *, slow: bool = False) -> None:
        """A key was pressed, or has repeated; the opposite one stops at once."""
        self._slow = slow
        for axis, sign in enumerate(WAYS[way]):
            if not sign:
                continue
            held = now_ns < self._until_ns[axis] and self._signs[axis] == sign
            self._signs[axis] = sign
            end_ns = now_ns + (AGAIN_NS if held else FIRST_NS)
            self._until_ns[axis] = max(end_ns, self._until_ns[axis]) if held else end_ns

    def twist(self, now_ns: int) -> Twist:
        """What to drive now; still when nothing is held."""
        speed, turn = SLOW if self._slow else FAST
        ahead, round = (
            sign if now_ns < until_ns else 0
            for sign, until_ns in zip(self._signs, self._until_ns, strict=True)
        )
        return Twist(ahead * speed, round * turn)

    def release(self) -> None:
        """Still, at once."""
        self._until_ns = [0, 0]
