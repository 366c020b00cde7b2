"""The surfaces of a scene as arrays of points, and the selection of those visible to a ring.

The points are the centres of discs, the starts and the ends of edges. Those of edges are turned by
a quarter, so that u.point is u x a of a start and -u x b of an end (the letters are those of
`plant.sim.sensing.raycast`).
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

SMALLEST_M2: Final = float_info.min
"""The smallest normal float; divides where an edge has no length."""


class PoseTolerance(NamedTuple):
    """Largest distance from a pose, and largest turn in either direction (below pi / 2)."""

    way_m: float
    turn_rad: float


class Surfaces:
    """Every surface of a scene."""

    def __init__(self, scene: Scene) -> None:
        discs = np.array(scene.discs, dtype=float).reshape(-1, 3)
        edges = np.array(scene.edges, dtype=float).reshape(-1, 4)
        self._centres, self._radii = discs[:, :2], discs[:, 2]
        self._starts, self._ends = edges[:, :2], edges[:, 2:]
        self._spans = self._ends - self._starts
        self._squares = _squares(self._spans)
        self._lengths = np.sqrt(self._squares)
        self._turned_starts, self._turned_ends = _turned(self._starts), -_turned(self._ends)

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
        points = [np.zeros((moving, 2)), self._centres[discs]]
        points += [self._turned_starts[edges], self._turned_ends[edges]]
        radii = np.concatenate([np.ones(moving), self._radii[discs]])
        return ChosenSurfaces(
            np.concatenate(points), self._spans[edges], radii, self._lengths[edges]
        )

    def _discs_in_sight(self, at: Pose, axes: Axes, farthest_m: float, way_m: float) -> Mask:
        gaps = self._centres - at[:2]
        near = np.sqrt(_squares(gaps)) - self._radii < farthest_m
        seen: Mask = near & (_ahead_m(gaps, axes) + self._radii > -way_m)
        return seen

    def _edges_in_sight(self, at: Pose, axes: Axes, farthest_m: float, way_m: float) -> Mask:
        gaps, spans = self._starts - at[:2], self._spans
        along = gaps[:, 0] * spans[:, 0] + gaps[:, 1] * spans[:, 1]
        shares = -along / np.maximum(self._squares, SMALLEST_M2)
        shares = np.minimum(np.maximum(shares, 0.0), 1.0)
        nearest = gaps + shares[:, None] * spans
        near = _squares(nearest) < farthest_m * farthest_m
        ahead_m = np.maximum(_ahead_m(gaps, axes), _ahead_m(self._ends - at[:2], axes))
        seen: Mask = near & (ahead_m > -way_m)
        return seen


class ChosenSurfaces:
    """Points of discs, starts and ends of edges by coordinate; vectors along the edges.

    `squares` are those of the radii. `sizes` are radii, then lengths.
    """

    __slots__ = ("discs", "edges", "points", "sizes", "spans", "squares")

    def __init__(self, points: Floats, spans: Floats, radii: Floats, lengths: Floats) -> None:
        self.points = np.ascontiguousarray(points.T)[:, None, :]
        self.spans = np.ascontiguousarray(spans.T)[:, None, :]
        self.squares = radii * radii
        self.sizes = np.concatenate([radii, lengths])
        self.discs, self.edges = len(radii), len(lengths)

    def place(self, moved: Sequence[Disc]) -> None:
        """Put moving discs at the places reserved for them, the first."""
        for index, (x_m, y_m, radius_m) in enumerate(moved):
            self.points[0, 0, index], self.points[1, 0, index] = x_m, y_m
            self.sizes[index], self.squares[index] = radius_m, radius_m * radius_m


def _squares(vectors: Floats) -> Floats:
    """Return the squared lengths of vectors."""
    x, y = vectors[:, 0], vectors[:, 1]
    squares: Floats = x * x + y * y
    return squares


def _turned(points: Floats) -> Floats:
    """Return points turned by a quarter to the right."""
    return np.stack([points[:, 1], -points[:, 0]], axis=1)


def _extreme_axes(heading_rad: float, turn_rad: float) -> Axes:
    """Return the two extreme headings: a point behind both is behind all between them."""
    return *cos_sin(heading_rad - turn_rad), *cos_sin(heading_rad + turn_rad)


def _ahead_m(gaps: Floats, axes: Axes) -> Floats:
    """Return how far each point is ahead, at the heading at which it is farthest ahead."""
    x, y = gaps[:, 0], gaps[:, 1]
    return np.maximum(x * axes[0] + y * axes[1], x * axes[2] + y * axes[3])
