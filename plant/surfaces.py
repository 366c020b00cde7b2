"""The surfaces of a scene as rows of matrices, and of them those within reach of a ring.

A row times a ray's (ux, uy, -u.o, -u x o) gives p of a disc, u x (a - o) or -u x (b - o) of an
edge; a row times its origin's (ox, oy, 1, |o|^2) gives q of a disc, n of an edge. The letters are
those of `plant.raycast`.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from plant.scene import Disc, Scene

Floats: TypeAlias = npt.NDArray[np.float64]


class Surfaces:
    """Every surface of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._discs = np.array(scene.discs, dtype=float).reshape(-1, 3)
        self._edges = np.array(scene.edges, dtype=float).reshape(-1, 4)
        self._disc_rays, self._disc_origins = _disc_rows(self._discs)
        self._edge_rays, self._edge_origins = _edge_rows(self._edges)
        spans = self._edges[:, 2:] - self._edges[:, :2]
        self._lengths = np.hypot(spans[:, 0], spans[:, 1])

    def within(self, x_m: float, y_m: float, reach_m: float, moving: int) -> "Chosen":
        """Those nearer to a point than the reach, after `moving` rows left free for discs."""
        point = np.array([x_m, y_m])
        away = np.hypot(*(self._discs[:, :2] - point).T) - self._discs[:, 2]
        discs = np.flatnonzero(away < reach_m)
        edges = np.flatnonzero(_edge_distances(self._edges, point) < reach_m)
        free = np.tile((0.0, 0.0, 1.0, 0.0), (moving, 1))
        return Chosen(
            np.concatenate([free, self._disc_rays[discs], *self._edge_rays[:, edges]]),
            np.concatenate([free, self._disc_origins[discs], self._edge_origins[edges]]),
            np.concatenate([np.ones(moving), self._discs[discs, 2], self._lengths[edges]]),
            moving + len(discs),
        )


class Chosen:
    """Rows for the rays (discs, starts of edges, ends of edges) and for their origins."""

    __slots__ = ("discs", "edges", "origin_rows", "ray_rows", "sizes")

    def __init__(self, ray_rows: Floats, origin_rows: Floats, sizes: Floats, discs: int) -> None:
        self.ray_rows = ray_rows
        self.origin_rows = origin_rows
        self.sizes = sizes
        self.discs = discs
        self.edges = len(sizes) - discs

    def place(self, moved: Sequence[Disc]) -> None:
        """Put moving discs into the rows left free for them."""
        rows = slice(len(moved))
        self.ray_rows[rows, :2] = [disc[:2] for disc in moved]
        self.origin_rows[rows] = [
            (-2.0 * x, -2.0 * y, x * x + y * y - radius * radius, 1.0) for x, y, radius in moved
        ]
        self.sizes[rows] = [disc[2] for disc in moved]


def _disc_rows(discs: Floats) -> tuple[Floats, Floats]:
    x, y, radius = discs.T
    one, none = np.ones(len(discs)), np.zeros(len(discs))
    rays = np.stack([x, y, one, none], axis=1)
    return rays, np.stack([-2.0 * x, -2.0 * y, x * x + y * y - radius * radius, one], axis=1)


def _edge_rows(edges: Floats) -> tuple[Floats, Floats]:
    ax, ay, bx, by = edges.T
    one, none = np.ones(len(edges)), np.zeros(len(edges))
    starts = np.stack([ay, -ax, none, one], axis=1)
    ends = np.stack([-by, bx, none, -one], axis=1)
    origins = np.stack([by - ay, ax - bx, ay * (bx - ax) - ax * (by - ay), none], axis=1)
    return np.stack([starts, ends]), origins


def _edge_distances(edges: Floats, point: Floats) -> Floats:
    start, along = edges[:, :2], edges[:, 2:] - edges[:, :2]
    squares = np.maximum((along * along).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(((point - start) * along).sum(axis=1) / squares, 0.0, 1.0)
    gaps = start + share[:, None] * along - point
    distances: Floats = np.hypot(gaps[:, 0], gaps[:, 1])
    return distances
