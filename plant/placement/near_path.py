"""The shortest way near a given one, for worlds with too many corners to look at all of them.

The search of `plant.placement.shortest_path`, but only over corners close to the given way, seen
from no farther than a few metres; points of the given way itself join what is farther apart.
"""

from typing import Final

import numpy as np

from plant.model.types import Point, World
from plant.placement.shortest_path import (
    TOUCHING_M,
    Array,
    Blocked,
    Mask,
    blocked_by,
    rings,
    search,
    visible_from,
)

NEAR_M: Final = 1.0
"""Corners so near to the way are looked at."""

SIGHT_M: Final = 3.0
EVERY: Final = 3
"""Of the given way every third point is kept."""


def near_path(world: World, way: list[Point], radius_m: float) -> list[Point]:
    """The corners of the shortest way found; the given one itself when none is shorter."""
    every, given = blocked_by(world, radius_m), np.array(way)
    blocked = _only(every, given, SIGHT_M + NEAR_M)
    corners = rings(world, _only(blocked, given, NEAR_M), radius_m)
    corners = corners[_free(corners, blocked)]
    nodes = np.vstack([given[:1], given[-1:], corners, given[EVERY:-1:EVERY]])
    found = search(nodes, lambda eye, to: visible_from(eye, to, _around(eye, blocked)), SIGHT_M)
    return way if found is None else _pulled(found, every)


def _pulled(path: list[Point], blocked: Blocked) -> list[Point]:
    """Without the points that can be left out because one sees past them, however far."""
    points, kept = np.array(path), [0]
    while kept[-1] < len(path) - 1:
        after = kept[-1] + 1
        seen = np.flatnonzero(visible_from(points[kept[-1]], points[after:], blocked))
        kept.append(after + int(seen.max(initial=0)))
    return [path[k] for k in kept]


def _only(blocked: Blocked, points: Array, reach_m: float) -> Blocked:
    """What of it is nearer than that to one of the points."""
    near = np.zeros(len(blocked.centres), dtype=bool)
    near_edges = np.zeros(len(blocked.tails), dtype=bool)
    for point in points:
        near |= np.hypot(*(blocked.centres - point).T) < reach_m
        near_edges |= _edge_distances(blocked, point) < reach_m
    return Blocked(
        blocked.centres[near],
        blocked.radii[near],
        blocked.tails[near_edges],
        blocked.heads[near_edges],
    )


def _edge_distances(blocked: Blocked, point: Array) -> Array:
    along = blocked.heads - blocked.tails
    squares = np.maximum((along * along).sum(axis=1), TOUCHING_M**2)
    share = np.clip(((point - blocked.tails) * along).sum(axis=1) / squares, 0.0, 1.0)
    gaps = blocked.tails + share[:, None] * along - point
    distances: Array = np.hypot(gaps[:, 0], gaps[:, 1])
    return distances


def _free(points: Array, blocked: Blocked) -> Mask:
    """Which points are clear of every disc, and so far of every edge as its ends' discs are."""
    free = np.ones(len(points), dtype=bool)
    for centre, radius_m in zip(blocked.centres, blocked.radii, strict=True):
        free &= np.hypot(*(points - centre).T) >= radius_m - TOUCHING_M
    radius_m = blocked.radii.min(initial=np.inf)
    for index, point in enumerate(points):
        if free[index] and len(blocked.tails):
            free[index] = _edge_distances(blocked, point).min() >= radius_m - TOUCHING_M
    return free


def _around(eye: Array, blocked: Blocked) -> Blocked:
    """What of it can stand in the way of a look of SIGHT_M."""
    return _only(blocked, eye[None, :], SIGHT_M + float(blocked.radii.max(initial=0.0)))
