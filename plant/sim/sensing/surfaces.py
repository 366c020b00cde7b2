"""The surfaces of a scene, and the selection of those that each sonar may see near a pose.

The selection only skips surfaces that cannot matter: rounding in it never changes an echo.
"""

from math import hypot, pi, radians
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from plant.model.scene import Pose, Scene

SONARS: Final = 8
CONE_RAD: Final = radians(22.5)
SLACK_M: Final = 1e-6
"""Added to every selection, far more than its rounding errors."""

NEAR_M: Final = 1.0
"""Surfaces beyond the reach of the ring are looked at again after this way."""

Floats: TypeAlias = npt.NDArray[np.float64]

SeenDisc: TypeAlias = tuple[float, float, float, float, float]
"""Smallest distance from the ring, centre, radius, and its square."""

SeenEdge: TypeAlias = tuple[float, float, float, float, float, float]
"""Smallest distance from the ring, start, end, and length."""


class PoseTolerance(NamedTuple):
    """Largest distance from a pose, and largest turn in either direction (below pi / 3)."""

    way_m: float
    turn_rad: float


class View(NamedTuple):
    """The surfaces that one sonar may see, the nearest first."""

    discs: list[SeenDisc]
    edges: list[SeenEdge]


class Surfaces:
    """Every surface of a scene as a line with a radius: a disc has no length, an edge no radius."""

    def __init__(self, scene: Scene) -> None:
        discs = np.array(scene.discs, dtype=float).reshape(-1, 3)
        edges = np.array(scene.edges, dtype=float).reshape(-1, 4)
        self._discs = len(discs)
        self._starts = np.concatenate([discs[:, :2], edges[:, :2]])
        self._ends = np.concatenate([discs[:, :2], edges[:, 2:]])
        self._spans = self._ends - self._starts
        self._lengths = np.hypot(self._spans[:, 0], self._spans[:, 1])
        self._squares = np.maximum(self._lengths * self._lengths, np.finfo(float).tiny)
        self._radii = np.concatenate([discs[:, 2], np.zeros(len(edges))])
        self._near = np.arange(len(self._radii))
        self._near_at = (np.inf, np.inf)

    def in_sight(self, at: Pose, reach_m: float, drift: PoseTolerance) -> tuple[View, ...]:
        """Return what each sonar may see within reach of a ring, at all poses within `drift`."""
        if hypot(at[0] - self._near_at[0], at[1] - self._near_at[1]) > NEAR_M:
            everything = np.arange(len(self._radii))
            self._near = everything[self._distances_m(at, everything) < reach_m + 2.0 * NEAR_M]
            self._near_at = at[:2]
        slack_m = drift.way_m + SLACK_M
        least_m = self._distances_m(at, self._near) - slack_m
        order = np.argsort(least_m)
        near, least_m = self._near[order], least_m[order]
        seen = self._in_cones(at, near, slack_m, drift.turn_rad)
        seen &= (least_m < reach_m)[:, None]
        return self._views(near, least_m, seen)

    def _distances_m(self, at: Pose, which: npt.NDArray[np.intp]) -> Floats:
        gaps, spans = self._starts[which] - at[:2], self._spans[which]
        shares = -(gaps * spans).sum(axis=1) / self._squares[which]
        gaps += np.minimum(np.maximum(shares, 0.0), 1.0)[:, None] * spans
        away: Floats = np.hypot(gaps[:, 0], gaps[:, 1]) - self._radii[which]
        return away

    def _in_cones(
        self, at: Pose, which: npt.NDArray[np.intp], slack_m: float, turn_rad: float
    ) -> npt.NDArray[np.bool_]:
        """Return, per surface and sonar, whether the sonar may see it.

        It may not if all of the surface is outside of one side of the cone, widened by `turn_rad`,
        or behind the robot, or if it is an edge seen from its hidden side.
        """
        inward = _inward(at[2], turn_rad)
        starts, spans = self._starts[which] - at[:2], self._spans[which]
        inside_m = np.maximum(starts @ inward, (starts + spans) @ inward)
        limits_m = -slack_m - self._radii[which]
        seen: npt.NDArray[np.bool_] = (inside_m > limits_m[:, None]).reshape(-1, 3, SONARS).all(1)
        facing = starts[:, 1] * spans[:, 0] - starts[:, 0] * spans[:, 1]
        seen &= (facing >= -slack_m * self._lengths[which])[:, None]
        return seen

    def _views(
        self, near: npt.NDArray[np.intp], least_m: Floats, seen: npt.NDArray[np.bool_]
    ) -> tuple[View, ...]:
        views = tuple(View([], []) for _ in range(SONARS))
        sonars, rows = seen.T.nonzero()
        table = np.stack([least_m, *self._starts[near].T, *self._ends[near].T]).T.tolist()
        sizes = (self._radii[near] + self._lengths[near]).tolist()
        indices = near.tolist()
        for sonar, row in zip(sonars.tolist(), rows.tolist(), strict=True):
            at_least_m, ax, ay, bx, by = table[row]
            size_m = sizes[row]
            if indices[row] < self._discs:
                views[sonar].discs.append((at_least_m, ax, ay, size_m, size_m * size_m))
            else:
                views[sonar].edges.append((at_least_m, ax, ay, bx, by, size_m))
        return views


def _inward(heading_rad: float, turn_rad: float) -> Floats:
    """Return inward normals of the cones' right sides, of their left sides, and their axes."""
    half_rad = CONE_RAD / 2.0 + turn_rad
    away = np.arange(SONARS) * CONE_RAD + (heading_rad - 3.5 * CONE_RAD)
    towards = np.concatenate([away - half_rad + pi / 2.0, away + half_rad - pi / 2.0, away])
    return np.stack([np.cos(towards), np.sin(towards)])
