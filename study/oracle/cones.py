"""The cells around a robot, sorted by bearing, so that each sonar's cone is one slice of them.

The tables are integers. They are made of sums, products, quotients and square roots only, so they
are the same on every machine.
"""

from functools import lru_cache
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from runtime.elementary import Q1, Q2, Q3, Q4, Q5

Ints: TypeAlias = NDArray[np.int64]
Shorts: TypeAlias = NDArray[np.int16]

CELL_MM: Final = 20
REACH_MM: Final = 1500
"""Largest distance of a cell that an echo changes, from the robot's centre."""

SHARES: Final = 2
"""The tables are for robots at the centre of one of SHARES x SHARES parts of a cell."""

CIRCLE: Final = 4096
QUARTER: Final = 1024
CONE: Final = 256
"""Brads: 4096 to the circle, 256 to a cone of 22.5 degrees."""


class Cones(NamedTuple):
    """Cells by bearing, three times round; `first[b + CIRCLE]` is the first one from bearing b.

    `offset` is that of the index, and `distance_mm` is from the robot's centre.
    """

    offset: Ints
    distance_mm: Shorts
    first: list[int]


@lru_cache(maxsize=4 * SHARES * SHARES)
def cones_of(share_x: int, share_y: int, width: int) -> Cones:
    """Return the cells around a robot in one of the parts of its cell, in rows of `width`."""
    reach = REACH_MM // CELL_MM
    side = np.arange(-reach, reach + 1)
    x, y = (each.ravel() for each in np.meshgrid(side, side))
    part_mm = CELL_MM // SHARES
    x_mm = x * CELL_MM + (CELL_MM - part_mm) // 2 - share_x * part_mm
    y_mm = y * CELL_MM + (CELL_MM - part_mm) // 2 - share_y * part_mm
    distance_mm = np.sqrt((x_mm * x_mm + y_mm * y_mm).astype(np.float64)).astype(np.int16)
    near = distance_mm <= REACH_MM
    x, y, distance_mm = x[near], y[near], distance_mm[near]
    bearing = brads(x_mm[near], y_mm[near])
    order = np.argsort(bearing, kind="stable")
    bearing = bearing[order]
    thrice = np.concatenate([bearing - CIRCLE, bearing, bearing + CIRCLE])
    first = np.searchsorted(thrice, np.arange(-CIRCLE, 2 * CIRCLE))
    offset, away_mm = (y * width + x)[order], distance_mm[order]
    return Cones(np.concatenate([offset] * 3), np.concatenate([away_mm] * 3), first.tolist())


def brads(x_mm: Ints, y_mm: Ints) -> Ints:
    """Return bearings from 0 to CIRCLE - 1, as those of `coarse_atan2`."""
    along, across = np.abs(x_mm).astype(np.float64), np.abs(y_mm).astype(np.float64)
    steep = across > along
    tangent = np.where(steep, along, across) / np.maximum(np.maximum(along, across), 1.0)
    z = tangent * tangent
    angle_rad = tangent * (Q1 - z * (Q2 - z * (Q3 - z * (Q4 - z * Q5))))
    bearing = np.floor(angle_rad * (QUARTER / 1.5707963267948966) + 0.5).astype(np.int64)
    bearing = np.where(steep, QUARTER - bearing, bearing)
    bearing = np.where(x_mm < 0, 2 * QUARTER - bearing, bearing)
    return np.where(y_mm < 0, -bearing, bearing) % CIRCLE
