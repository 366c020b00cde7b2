"""The shortest way near a given one, for worlds with too many corners to look at all of them.

The search of `plant.shortest_path`, but only over corners close to the given way, seen from no
farther than a few metres; points of the given way itself join what is farther apart.
"""

from heapq import heappop, heappush
from typing import Final

import numpy as np

from plant.shortest_path import TOUCHING_M, Array, Blocked, Mask, blocked_by, rings, visible_from
from plant.world_types import Point, World

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
    came_from = _search(nodes, blocked)
    if came_from is None:
        return way
    path = [1]
    while path[-1] != 0:
        path.append(came_from[path[-1]])
    pulled = _pulled(nodes[path[::-1]], every)
    return [(float(x_m), float(y_m)) for x_m, y_m in pulled.tolist()]


def _pulled(path: Array, blocked: Blocked) -> Array:
    """Without the points that can be left out because one sees past them, however far."""
    kept = [0]
    while kept[-1] < len(path) - 1:
        after = kept[-1] + 1
        seen = np.flatnonzero(visible_from(path[kept[-1]], path[after:], blocked))
        kept.append(after + int(seen.max(initial=0)))
    return path[kept]


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


def _search(nodes: Array, blocked: Blocked) -> list[int] | None:
    """A* from node 0 to node 1, looking no farther than SIGHT_M from each node."""
    to_goal = np.hypot(*(nodes - nodes[1]).T)
    cost = np.full(len(nodes), np.inf)
    cost[0] = 0.0
    came_from = [0] * len(nodes)
    open_nodes = [(float(to_goal[0]), 0)]
    done = np.zeros(len(nodes), dtype=bool)
    while open_nodes:
        _, here = heappop(open_nodes)
        if here == 1:
            return came_from
        if done[here]:
            continue
        done[here] = True
        away = np.hypot(*(nodes - nodes[here]).T)
        through = cost[here] + away
        better = np.flatnonzero(~done & (away <= SIGHT_M) & (through < cost))
        seen = better[visible_from(nodes[here], nodes[better], _around(nodes[here], blocked))]
        cost[seen] = through[seen]
        for node in seen.tolist():
            came_from[node] = here
            heappush(open_nodes, (float(cost[node] + to_goal[node]), node))
    return None


def _around(eye: Array, blocked: Blocked) -> Blocked:
    """What of it can stand in the way of a look of SIGHT_M."""
    return _only(blocked, eye[None, :], SIGHT_M + float(blocked.radii.max(initial=0.0)))
