"""Shortest path near a given one, for worlds with too many corners for the exact search.

This is the search of `plant.placement.shortest_path`, restricted to corners near the given path and
to a visibility range of a few metres. Points of the given path connect distant parts.
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
    dot,
    lengths,
    rings,
    search,
    visible_from,
)

NEAR_M: Final = 1.0
"""Distance from the given path within which corners are used."""

SIGHT_M: Final = 3.0
EVERY: Final = 3
"""Every third point of the given path is kept."""


def near_path(world: World, way: list[Point], radius_m: float) -> list[Point]:
    """Return the corners of the shortest path found; the given path if none is shorter."""
    every, given = blocked_by(world, radius_m), np.array(way)
    blocked = _only(every, given, SIGHT_M + NEAR_M)
    corners = rings(world, _only(blocked, given, NEAR_M), radius_m)
    corners = corners[_free(corners, blocked)]
    nodes = np.vstack([given[:1], given[-1:], corners, given[EVERY:-1:EVERY]])
    found = search(nodes, lambda eye, to: visible_from(eye, to, _around(eye, blocked)), SIGHT_M)
    return way if found is None else _pulled(found, every)


def _pulled(path: list[Point], blocked: Blocked) -> list[Point]:
    """Return a path without the points that a straight line can skip."""
    points, kept = np.array(path), [0]
    while kept[-1] < len(path) - 1:
        after = kept[-1] + 1
        seen = np.flatnonzero(visible_from(points[kept[-1]], points[after:], blocked))
        kept.append(after + int(seen.max(initial=0)))
    return [path[k] for k in kept]


def _only(blocked: Blocked, points: Array, reach_m: float) -> Blocked:
    """Return the parts within a distance of one of the points."""
    near = np.zeros(len(blocked.centres), dtype=bool)
    near_edges = np.zeros(len(blocked.tails), dtype=bool)
    for point in points:
        near |= lengths(blocked.centres - point) < reach_m
        near_edges |= _edge_distances(blocked, point) < reach_m
    return Blocked(
        blocked.centres[near],
        blocked.radii[near],
        blocked.tails[near_edges],
        blocked.heads[near_edges],
    )


def _edge_distances(blocked: Blocked, point: Array) -> Array:
    along = blocked.heads - blocked.tails
    squares = np.maximum(dot(along, along), TOUCHING_M * TOUCHING_M)
    share = np.clip(dot(point - blocked.tails, along) / squares, 0.0, 1.0)
    return lengths(blocked.tails + share[:, None] * along - point)


def _free(points: Array, blocked: Blocked) -> Mask:
    """Return which points are clear of all discs, including those at the ends of edges."""
    free = np.ones(len(points), dtype=bool)
    for centre, radius_m in zip(blocked.centres, blocked.radii, strict=True):
        free &= lengths(points - centre) >= radius_m - TOUCHING_M
    radius_m = blocked.radii.min(initial=np.inf)
    for index, point in enumerate(points):
        if free[index] and len(blocked.tails):
            free[index] = _edge_distances(blocked, point).min() >= radius_m - TOUCHING_M
    return free


def _around(eye: Array, blocked: Blocked) -> Blocked:
    """Return the parts that can block a line of SIGHT_M from a point."""
    return _only(blocked, eye[None, :], SIGHT_M + float(blocked.radii.max(initial=0.0)))
