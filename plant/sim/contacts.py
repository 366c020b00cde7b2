"""Contacts of robots with what they touch: sequential impulses, without bounce and friction.

The method is that of Chipmunk and Box2D. It is written out here, in operations that are rounded in
the same way on every machine, because a trajectory depends on it to the last bit; a compiled
library depends on its compiler and on the processor.
"""

from collections.abc import Sequence
from typing import Final

ITERATIONS: Final = 10
SLOP_M: Final = 1e-4
"""A contact keeps this overlap, so that it lasts."""


class Disc:
    """A robot or a moving obstacle: position, velocity, and the velocity that undoes an overlap.

    Only a `free` one is moved by contacts.
    """

    __slots__ = ("free", "push_x_m_s", "push_y_m_s", "radius_m", "x_m", "x_m_s", "y_m", "y_m_s")

    def __init__(self, x_m: float, y_m: float, radius_m: float, *, free: bool) -> None:
        self.x_m, self.y_m, self.radius_m, self.free = x_m, y_m, radius_m, free
        self.x_m_s = self.y_m_s = self.push_x_m_s = self.push_y_m_s = 0.0

    def move(self, span_s: float) -> None:
        """Move for a time; an overlap is undone once."""
        self.x_m += (self.x_m_s + self.push_x_m_s) * span_s
        self.y_m += (self.y_m_s + self.push_y_m_s) * span_s
        self.push_x_m_s = self.push_y_m_s = 0.0


class Contact:
    """An overlap of a robot and another disc; x, y is the unit vector from the robot to it."""

    __slots__ = ("_apart_m_s", "_impulse", "_push", "_share", "other", "robot", "x", "y")

    def __init__(
        self, robot: Disc, other: Disc, direction: tuple[float, float], apart_m_s: float
    ) -> None:
        """Create a contact; `apart_m_s` is the speed that undoes the overlap in one step."""
        self.robot, self.other = robot, other
        self.x, self.y = direction
        self._apart_m_s = apart_m_s
        self._share = 0.5 if other.free else 1.0
        self._impulse = self._push = 0.0

    def solve(self) -> None:
        """Change both velocities so that the discs come no nearer and lose their overlap."""
        robot, other, x, y = self.robot, self.other, self.x, self.y
        closing_m_s = (robot.push_x_m_s - other.push_x_m_s) * x
        closing_m_s += (robot.push_y_m_s - other.push_y_m_s) * y
        push = max(0.0, self._push + (self._apart_m_s + closing_m_s) * self._share)
        change, self._push = push - self._push, push
        robot.push_x_m_s -= change * x
        robot.push_y_m_s -= change * y
        if other.free:
            other.push_x_m_s += change * x
            other.push_y_m_s += change * y
        closing_m_s = (robot.x_m_s - other.x_m_s) * x + (robot.y_m_s - other.y_m_s) * y
        impulse = max(0.0, self._impulse + closing_m_s * self._share)
        change, self._impulse = impulse - self._impulse, impulse
        robot.x_m_s -= change * x
        robot.y_m_s -= change * y
        if other.free:
            other.x_m_s += change * x
            other.y_m_s += change * y


def solve(contacts: Sequence[Contact]) -> None:
    """Solve all contacts of a step together."""
    for _ in range(ITERATIONS):
        for contact in contacts:
            contact.solve()
