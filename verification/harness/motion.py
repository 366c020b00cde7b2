"""What a robot did after a fault, from where it truly was: when it stood, how far it came."""

from collections.abc import Sequence
from itertools import pairwise
from math import hypot
from typing import Final, NamedTuple

from protocol.wire.messages import GroundTruth
from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S

PERIOD_S: Final = PERIOD_NS / NS_PER_S
STILL_M_S: Final = 0.001
STILL_RAD_S: Final = 0.01
HOLDS: Final = 8
"""Truths at rest in a row, until it is said to stand."""


class Seen(NamedTuple):
    """One truth, `at_s` after the fault. Its speed is that of the period which it ends."""

    at_s: float
    truth: GroundTruth

    @property
    def still(self) -> bool:
        truth = self.truth
        return abs(truth.speed_m_s) < STILL_M_S and abs(truth.yaw_rate_rad_s) < STILL_RAD_S


def standing_from(seen: Sequence[Seen]) -> int | None:
    """Which is the first of the truths at rest; None when it never stood for long."""
    row = 0
    for index, one in enumerate(seen):
        row = row + 1 if one.still else 0
        if row == HOLDS:
            return index - HOLDS + 1
    return None


def stood_s(seen: Sequence[Seen]) -> float | None:
    """When its wheels stood: at the latest at the begin of the first period without motion."""
    first = standing_from(seen)
    return None if first is None else max(0.0, seen[first].at_s - PERIOD_S)


def distance_m(seen: Sequence[Seen]) -> float:
    """Its way after the fault, until it stood."""
    first = standing_from(seen)
    way = seen if first is None else seen[: first + 1]
    return sum(
        hypot(b.truth.x_m - a.truth.x_m, b.truth.y_m - a.truth.y_m) for a, b in pairwise(way)
    )


def moved_again(seen: Sequence[Seen]) -> bool:
    """Did it move after it had stood?"""
    first = standing_from(seen)
    return first is not None and any(not one.still for one in seen[first:])


def contacts(seen: Sequence[Seen]) -> int:
    """How often it began to touch something."""
    touches = [False, *(one.truth.contact != 0 for one in seen)]
    return sum(now and not before for before, now in pairwise(touches))


def touched_s(seen: Sequence[Seen]) -> float | None:
    """From the first contact until it stood; None without one, and when it drove on for good."""
    for index, one in enumerate(seen):
        if one.truth.contact:
            stood = stood_s(seen[index:])
            return None if stood is None else stood - one.at_s
    return None
