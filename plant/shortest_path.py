"""Shortest path of the robot's disc from start to goal, around everything static.

Visibility graph: every corner and disc, grown by the robot's radius, has a ring of points just
outside it. A* searches the free straight lines between them. The length is exact except for the
rings, which make an arc at most 0.6 % too long.

For worlds with too many corners there is the same search near a given path, restricted to corners
near it and to a visibility range of a few metres. Points of the path connect distant parts.
"""

from collections.abc import Callable
from heapq import heappop, heappush
from math import inf, pi
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.configuration import body_of
from plant.model.geometry import edges, length_m
from protocol.world import Point, World, WorldCircle, WorldPolygon
from runtime.elementary import cos, cos_sin

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Sees: TypeAlias = Callable[[Array, Array], Mask]

RING_POINTS: Final = 24
TOUCHING_M: Final = 1e-6


class Blocked(NamedTuple):
    """The area that the robot's centre must avoid: discs, and segments between disc centres."""

    centres: Array  # (discs, 2)
    radii: Array  # (discs,)
    tails: Array  # (segments, 2)
    heads: Array  # (segments, 2)


def shortest_path_m(world: World) -> float | None:
    """Return the length of the shortest path in metres; None if there is none."""
    return path_length_m(shortest_path(world))


def known_length_m(world: World) -> float | None:
    """Return the length given by the world, else the computed one."""
    if world.reachable is False or world.shortest_path_m is not None:
        return world.shortest_path_m
    return shortest_path_m(world)


def path_length_m(path: list[Point] | None) -> float | None:
    """Return the length of a path in metres."""
    if path is None:
        return None
    return length_m(path)


def shortest_path(world: World) -> list[Point] | None:
    """Return the corners of the shortest path with start and goal; None if there is none."""
    radius_m = body_of(world).radius_m
    blocked = blocked_by(world, radius_m)
    start, goal = (world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m)
    nodes = np.vstack([np.array([start, goal]), _ring_points(world, blocked, radius_m)])
    return search(nodes, lambda eye, targets: visible_from(eye, targets, blocked))


def blocked_by(world: World, radius_m: float) -> Blocked:
    """Return everything static, grown by the robot's radius."""
    discs: dict[tuple[Point, float], None] = {}
    segments: list[tuple[Point, Point]] = []
    for obstacle in world.obstacles:
        if isinstance(obstacle, WorldCircle):
            if not obstacle.path_m:
                discs[(obstacle.x_m, obstacle.y_m), obstacle.radius_m + radius_m] = None
            continue
        solid = isinstance(obstacle, WorldPolygon)
        grown_m = (
            radius_m if isinstance(obstacle, WorldPolygon) else obstacle.thickness_m / 2 + radius_m
        )
        segments += edges(obstacle.points_m, closed=solid)
        discs.update(((point, grown_m), None) for point in obstacle.points_m)
    return Blocked(
        np.array([centre for centre, _ in discs]).reshape(-1, 2),
        np.array([grown_m for _, grown_m in discs]),
        np.array([tail for tail, _ in segments]).reshape(-1, 2),
        np.array([head for _, head in segments]).reshape(-1, 2),
    )


def _ring_points(world: World, blocked: Blocked, radius_m: float) -> Array:
    """Return the points around all discs at which the robot's centre may be."""
    points = rings(world, blocked, radius_m)
    return points[_free(points, world, radius_m)]


def rings(world: World, blocked: Blocked, radius_m: float) -> Array:
    """Return the points just outside every disc that are on the floor, free or not."""
    angles = [(k + 0.5) * (2.0 * pi / RING_POINTS) for k in range(RING_POINTS)]
    ring = np.array([cos_sin(angle) for angle in angles]) / cos(pi / RING_POINTS)
    points = blocked.centres[:, None, :] + blocked.radii[:, None, None] * ring
    points = points.reshape(-1, 2)
    if world.walls:
        low, high = radius_m - TOUCHING_M, np.array(world.size_m) - radius_m + TOUCHING_M
        points = points[((points >= low) & (points <= high)).all(axis=1)]
    return points


def _free(points: Array, world: World, radius_m: float) -> Mask:
    free = np.ones(len(points), dtype=bool)
    for obstacle in world.obstacles:
        if isinstance(obstacle, WorldCircle):
            if not obstacle.path_m:
                centre = np.array([obstacle.x_m, obstacle.y_m])
                gap = lengths(points - centre) - obstacle.radius_m
                free &= gap >= radius_m - TOUCHING_M
            continue
        solid = isinstance(obstacle, WorldPolygon)
        grown_m = (
            radius_m if isinstance(obstacle, WorldPolygon) else obstacle.thickness_m / 2 + radius_m
        )
        for a, b in edges(obstacle.points_m, closed=solid):
            free &= _from_segment(points, np.array(a), np.array(b)) >= grown_m - TOUCHING_M
    return free


def _from_segment(points: Array, a: Array, b: Array) -> Array:
    along = b - a
    square = np.maximum(dot(along, along), TOUCHING_M * TOUCHING_M)
    share = np.clip(dot(points - a, along) / square, 0.0, 1.0)
    return lengths(points - a - share[:, None] * along)


def lengths(vectors: Array) -> Array:
    """Return the lengths of vectors."""
    distances: Array = np.sqrt(dot(vectors, vectors))
    return distances


def dot(vectors: Array, others: Array) -> Array:
    """Return scalar products; a library may round those it adds up in another way elsewhere."""
    products: Array = vectors[..., 0] * others[..., 0] + vectors[..., 1] * others[..., 1]
    return products


def search(nodes: Array, sees: Sees, sight_m: float = inf) -> list[Point] | None:
    """Search by A* from the first node to the second, with lines of at most `sight_m`.

    `sees` returns which targets a straight line from an eye reaches. Returns the corners of the
    shortest path with both ends; None if the second node is unreachable.
    """
    to_goal = lengths(nodes - nodes[1])
    cost = np.full(len(nodes), np.inf)
    cost[0] = 0.0
    came_from = [0] * len(nodes)
    open_nodes = [(float(to_goal[0]), 0)]
    done = np.zeros(len(nodes), dtype=bool)
    while open_nodes:
        _, here = heappop(open_nodes)
        if here == 1:
            return _way(nodes, came_from)
        if done[here]:
            continue
        done[here] = True
        away = lengths(nodes - nodes[here])
        through = cost[here] + away
        promising = ~done & (away <= sight_m) & (through < cost) & (through + to_goal < cost[1])
        better = np.flatnonzero(promising)
        seen = better[sees(nodes[here], nodes[better])]
        cost[seen] = through[seen]
        for node in seen.tolist():
            came_from[node] = here
            heappush(open_nodes, (float(cost[node] + to_goal[node]), node))
    return None


def _way(nodes: Array, came_from: list[int]) -> list[Point]:
    path = [1]
    while path[-1] != 0:
        path.append(came_from[path[-1]])
    return [(float(x_m), float(y_m)) for x_m, y_m in nodes[path[::-1]].tolist()]


def visible_from(eye: Array, targets: Array, blocked: Blocked) -> Mask:
    """Return which targets a straight line reaches; eye and targets themselves must be free."""
    way = targets - eye
    length2 = np.maximum(dot(way, way), 1e-18)[:, None]
    offset = blocked.centres - eye
    along = dot(way[:, None, :], offset)
    share = np.clip(along / length2, 0.0, 1.0)
    distance2 = dot(offset, offset) + share * (share * length2 - 2.0 * along)
    least = blocked.radii - TOUCHING_M
    visible: Mask = np.all(distance2 >= least * least, axis=1)
    if len(blocked.tails):
        visible &= ~_crosses(eye, targets, blocked).any(axis=1)
    return visible


def _crosses(eye: Array, targets: Array, blocked: Blocked) -> Mask:
    """Return, for each target and segment, whether the line of sight crosses the segment."""
    way = targets - eye
    tail, head = blocked.tails - eye, blocked.heads - eye
    along = head - tail
    tail_side = np.outer(way[:, 0], tail[:, 1]) - np.outer(way[:, 1], tail[:, 0])
    head_side = np.outer(way[:, 0], head[:, 1]) - np.outer(way[:, 1], head[:, 0])
    eye_side = along[:, 1] * tail[:, 0] - along[:, 0] * tail[:, 1]
    target_side = eye_side + np.outer(way[:, 1], along[:, 0]) - np.outer(way[:, 0], along[:, 1])
    crossed: Mask = (tail_side * head_side < 0.0) & (eye_side * target_side < 0.0)
    return crossed


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
    corners = corners[_free_of_discs(corners, blocked)]
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


def _free_of_discs(points: Array, blocked: Blocked) -> Mask:
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
