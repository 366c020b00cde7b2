"""The surfaces of a scene as rows of matrices, and the selection of those visible to a ring.

A row times a ray's (ux, uy, -u.o, -u x o) gives p of a disc, u x (a - o) or -u x (b - o) of an
edge. A row times its origin's (ox, oy, 1, |o|^2) gives q of a disc, n of an edge. The letters are
those of `plant.sim.sensing.raycast`.

Coordinates are rounded to a grid of 2^-17 m (8 micrometres) within 256 m, so that no product of
matrices has to round; see `raycast`.
"""

from collections.abc import Sequence
from sys import float_info
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from plant.model.scene import Disc, Pose, Scene
from runtime.elementary import cos_sin

Floats: TypeAlias = npt.NDArray[np.float64]
Mask: TypeAlias = npt.NDArray[np.bool_]
Axes: TypeAlias = tuple[float, float, float, float]
"""Cosine and sine of the rightmost heading, then of the leftmost."""

FARTHEST_M: Final = 256.0
GRID_M: Final = 1.5 * (1 << 35)
"""Added and subtracted again, it rounds to multiples of 2^-17."""


class PoseTolerance(NamedTuple):
    """Largest distance from a pose, and largest turn in either direction (below pi / 2)."""

    way_m: float
    turn_rad: float


class Surfaces:
    """Every surface of a scene."""

    def __init__(self, scene: Scene) -> None:
        discs = _rounded(np.array(scene.discs, dtype=float).reshape(-1, 3))
        edges = _rounded(np.array(scene.edges, dtype=float).reshape(-1, 4))
        self._centres, self._radii = discs[:, :2], discs[:, 2]
        self._starts, self._ends = edges[:, :2], edges[:, 2:]
        self._spans = self._ends - self._starts
        self._squares = _squares(self._spans)
        self._lengths = np.sqrt(self._squares)
        self._disc_rays, self._disc_origins = _disc_rows(discs)
        self._start_rays, self._end_rays, self._edge_origins = _edge_rows(edges)

    def in_sight(
        self, at: Pose, reach_m: float, drift: PoseTolerance, moving: int
    ) -> "ChosenSurfaces":
        """Return the surfaces within reach of a ring and not all behind it.

        The selection holds for poses within `drift`. The first `moving` rows are left free for
        moving discs.
        """
        axes = _extreme_axes(at[2], drift.turn_rad)
        farthest_m = reach_m + drift.way_m
        discs = np.flatnonzero(self._discs_in_sight(at, axes, farthest_m, drift.way_m))
        edges = np.flatnonzero(self._edges_in_sight(at, axes, farthest_m, drift.way_m))
        free = np.zeros((moving, 4))
        free[:, 2] = 1.0
        return ChosenSurfaces(
            np.concatenate(
                [free, self._disc_rays[discs], self._start_rays[edges], self._end_rays[edges]]
            ),
            np.concatenate([free, self._disc_origins[discs], self._edge_origins[edges]]),
            np.concatenate([np.ones(moving), self._radii[discs], self._lengths[edges]]),
            moving + len(discs),
        )

    def _discs_in_sight(self, at: Pose, axes: Axes, farthest_m: float, way_m: float) -> Mask:
        gaps = self._centres - at[:2]
        near = np.sqrt(_squares(gaps)) - self._radii < farthest_m
        seen: Mask = near & (_ahead_m(gaps, axes) + self._radii > -way_m)
        return seen

    def _edges_in_sight(self, at: Pose, axes: Axes, farthest_m: float, way_m: float) -> Mask:
        gaps, spans = self._starts - at[:2], self._spans
        along = gaps[:, 0] * spans[:, 0] + gaps[:, 1] * spans[:, 1]
        shares = -along / np.maximum(self._squares, float_info.min)
        shares = np.minimum(np.maximum(shares, 0.0), 1.0)
        nearest = gaps + shares[:, None] * spans
        near = _squares(nearest) < farthest_m * farthest_m
        ahead_m = np.maximum(_ahead_m(gaps, axes), _ahead_m(self._ends - at[:2], axes))
        seen: Mask = near & (ahead_m > -way_m)
        return seen


class ChosenSurfaces:
    """Rows for the rays (discs, starts of edges, ends of edges) and for their origins."""

    __slots__ = ("discs", "edges", "origin_rows", "ray_rows", "sizes")

    def __init__(self, ray_rows: Floats, origin_rows: Floats, sizes: Floats, discs: int) -> None:
        self.ray_rows = ray_rows
        self.origin_rows = origin_rows
        self.sizes = sizes
        self.discs = discs
        self.edges = len(sizes) - discs

    def place(self, moved: Sequence[Disc]) -> None:
        """Put moving discs into the rows reserved for them."""
        rows = slice(len(moved))
        discs = [(on_grid_m(x), on_grid_m(y), on_grid_m(radius)) for x, y, radius in moved]
        self.ray_rows[rows, :2] = [disc[:2] for disc in discs]
        self.origin_rows[rows] = [
            (-2.0 * x, -2.0 * y, x * x + y * y - radius * radius, 1.0) for x, y, radius in discs
        ]
        self.sizes[rows] = [disc[2] for disc in discs]


def _disc_rows(discs: Floats) -> tuple[Floats, Floats]:
    x, y, radius = discs.T
    one, none = np.ones(len(discs)), np.zeros(len(discs))
    rays = np.stack([x, y, one, none], axis=1)
    return rays, np.stack([-2.0 * x, -2.0 * y, x * x + y * y - radius * radius, one], axis=1)


def _edge_rows(edges: Floats) -> tuple[Floats, Floats, Floats]:
    ax, ay, bx, by = edges.T
    one, none = np.ones(len(edges)), np.zeros(len(edges))
    starts = np.stack([ay, -ax, none, one], axis=1)
    ends = np.stack([-by, bx, none, -one], axis=1)
    origins = np.stack([by - ay, ax - bx, ay * (bx - ax) - ax * (by - ay), none], axis=1)
    return starts, ends, origins


def on_grid_m(coordinate_m: float) -> float:
    """Return the nearest coordinate on the grid."""
    if coordinate_m > FARTHEST_M:
        return FARTHEST_M
    if not coordinate_m > -FARTHEST_M:
        return -FARTHEST_M
    return (coordinate_m + GRID_M) - GRID_M


def _rounded(coordinates_m: Floats) -> Floats:
    """Return the nearest coordinates on the grid."""
    rounded_m: Floats = (coordinates_m + GRID_M) - GRID_M
    return rounded_m


def _squares(vectors: Floats) -> Floats:
    """Return the squared lengths of vectors."""
    x, y = vectors[:, 0], vectors[:, 1]
    squares: Floats = x * x + y * y
    return squares


def _extreme_axes(heading_rad: float, turn_rad: float) -> Axes:
    """Return the two extreme headings: a point behind both is behind all between them."""
    return *cos_sin(heading_rad - turn_rad), *cos_sin(heading_rad + turn_rad)


def _ahead_m(gaps: Floats, axes: Axes) -> Floats:
    """Return how far each point is ahead, at the heading at which it is farthest ahead."""
    x, y = gaps[:, 0], gaps[:, 1]
    return np.maximum(x * axes[0] + y * axes[1], x * axes[2] + y * axes[3])
