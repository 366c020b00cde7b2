"""Measures of a robot's reaction to a fault, from its true motion."""

from collections.abc import Sequence
from itertools import pairwise
from math import hypot
from typing import Final, NamedTuple

from protocol.wire.messages import GroundTruth
from runtime.units import PERIOD_S

STILL_M_S: Final = 0.001
STILL_RAD_S: Final = 0.01
HOLDS: Final = 8
"""A robot has stopped when so many samples in a row are still."""


class Seen(NamedTuple):
    """A true state, `at_s` after the fault; its speed is that of the period that it ends."""

    at_s: float
    truth: GroundTruth

    @property
    def still(self) -> bool:
        """True if the robot did not move."""
        return is_still(self.truth)


def is_still(truth: GroundTruth) -> bool:
    """Return whether a robot neither drives nor turns."""
    return abs(truth.speed_m_s) < STILL_M_S and abs(truth.yaw_rate_rad_s) < STILL_RAD_S


def standing_from(seen: Sequence[Seen]) -> int | None:
    """Return the index of the first sample at rest; None if the robot never stopped."""
    row = 0
    for index, one in enumerate(seen):
        row = row + 1 if one.still else 0
        if row == HOLDS:
            return index - HOLDS + 1
    return None


def stood_s(seen: Sequence[Seen]) -> float | None:
    """Return when the wheels stopped: the beginning of the first period without motion."""
    first = standing_from(seen)
    return None if first is None else max(0.0, seen[first].at_s - PERIOD_S)


def distance_m(seen: Sequence[Seen]) -> float:
    """Return the length of the path from the fault until the robot stopped."""
    first = standing_from(seen)
    way = seen if first is None else seen[: first + 1]
    return sum(
        hypot(b.truth.x_m - a.truth.x_m, b.truth.y_m - a.truth.y_m) for a, b in pairwise(way)
    )


def moved_again(seen: Sequence[Seen]) -> bool:
    """Return whether the robot moved after it had stopped."""
    first = standing_from(seen)
    return first is not None and any(not one.still for one in seen[first:])


def contacts(seen: Sequence[Seen]) -> int:
    """Return how many contacts began."""
    touches = [False, *(one.truth.contact != 0 for one in seen)]
    return sum(now and not before for before, now in pairwise(touches))


def touched_s(seen: Sequence[Seen]) -> float | None:
    """Return the time from the first contact until the robot stopped; None without either."""
    for index, one in enumerate(seen):
        if one.truth.contact:
            stood = stood_s(seen[index:])
            return None if stood is None else stood - one.at_s
    return None
