"""The surfaces of a scene, and the selection of those that each sonar may see near a pose.

The selection only skips surfaces that cannot matter: rounding in it never changes an echo.
"""

from math import floor, pi, radians, sqrt
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from plant.model.scene import Disc, Edge, Pose, Scene
from runtime.elementary import cos_sin

SONARS: Final = 8
CONE_RAD: Final = radians(22.5)
HALF_TURN_RAD: Final = pi
FULL_TURN_RAD: Final = 2.0 * pi
SLACK_M: Final = 1e-6
"""Added to every selection, far more than its rounding errors."""

BEARING_ERROR_RAD: Final = 0.006
"""Largest error of `rough_bearing_rad`."""

NEAR_M: Final = 1.0
"""Surfaces of the whole scene are looked at again after this way."""

LEAST_M2: Final = 1e-300
"""Keeps the division by the square of a length of zero possible."""

SeenDisc: TypeAlias = tuple[float, float, float, float, float]
"""Smallest distance from the ring, centre, radius, and its square."""

SeenEdge: TypeAlias = tuple[float, float, float, float, float, float]
"""Smallest distance from the ring, start, end, and length."""

View: TypeAlias = tuple[list[SeenDisc], list[SeenEdge]]
"""What one sonar may see, the nearest first."""


class PoseTolerance(NamedTuple):
    """Largest distance from a pose, and largest turn in either direction."""

    way_m: float
    turn_rad: float


class Surfaces:
    """Every surface of a scene, and those near the robot."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        discs = np.array(scene.discs, dtype=float).reshape(-1, 3)
        edges = np.array(scene.edges, dtype=float).reshape(-1, 4)
        starts = np.concatenate([discs[:, :2], edges[:, :2]])
        ends = np.concatenate([discs[:, :2], edges[:, 2:]])
        self._x, self._y = starts.T
        self._along_x, self._along_y = (ends - starts).T
        squares = self._along_x * self._along_x + self._along_y * self._along_y
        self._squares = np.maximum(squares, LEAST_M2)
        self._radii = np.concatenate([discs[:, 2], np.zeros(len(edges))])
        self._near_at = (np.inf, np.inf)
        self._discs: list[Disc] = []
        self._edges: list[Edge] = []

    def in_sight(self, at: Pose, reach_m: float, drift: PoseTolerance) -> list[View]:
        """Return what each sonar may see within reach of a ring, at all poses within `drift`."""
        dx, dy = at[0] - self._near_at[0], at[1] - self._near_at[1]
        if not dx * dx + dy * dy <= NEAR_M * NEAR_M:
            self._look_around(at, reach_m)
        views: list[View] = [([], []) for _ in range(SONARS)]
        way_m, turn_rad = drift.way_m + SLACK_M, drift.turn_rad + BEARING_ERROR_RAD
        add_discs(views, self._discs, at, reach_m, way_m, turn_rad)
        add_edges(views, self._edges, at, reach_m, way_m, turn_rad)
        for seen_discs, seen_edges in views:
            seen_discs.sort()
            seen_edges.sort()
        return views

    def _look_around(self, at: Pose, reach_m: float) -> None:
        """Select the surfaces near the robot; with numpy, because a map may have thousands."""
        x, y, along_x, along_y = self._x - at[0], self._y - at[1], self._along_x, self._along_y
        shares = -(x * along_x + y * along_y) / self._squares
        shares = np.minimum(np.maximum(shares, 0.0), 1.0)
        x, y = x + shares * along_x, y + shares * along_y
        near = np.sqrt(x * x + y * y) - self._radii < reach_m + 2.0 * NEAR_M
        chosen: list[int] = np.flatnonzero(near).tolist()
        discs, edges = self._scene
        self._discs = [discs[i] for i in chosen if i < len(discs)]
        self._edges = [edges[i - len(discs)] for i in chosen if i >= len(discs)]
        self._near_at = at[:2]


def add_discs(
    views: list[View], discs: list[Disc], at: Pose, reach_m: float, way_m: float, turn_rad: float
) -> None:
    """Add to each view the discs that its sonar may see."""
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    for centre_x, centre_y, radius_m in discs:
        dx, dy = centre_x - x_m, centre_y - y_m
        away_m, wide_m = sqrt(dx * dx + dy * dy), radius_m + way_m
        if away_m - wide_m >= reach_m:
            continue
        seen = (away_m - wide_m, centre_x, centre_y, radius_m, radius_m * radius_m)
        bearing_rad = rough_bearing_rad(dx * cosine + dy * sine, dy * cosine - dx * sine)
        half_rad = half_width_rad(wide_m, away_m) + turn_rad
        for sonar in sonars_between(bearing_rad - half_rad, bearing_rad + half_rad):
            views[sonar][0].append(seen)


def add_edges(
    views: list[View], edges: list[Edge], at: Pose, reach_m: float, way_m: float, turn_rad: float
) -> None:
    """Add to each view the edges that its sonar may see, from their visible side."""
    x_m, y_m, heading_rad = at
    cosine, sine = cos_sin(heading_rad)
    for start_x, start_y, end_x, end_y in edges:
        ax, ay, bx, by = start_x - x_m, start_y - y_m, end_x - x_m, end_y - y_m
        span_x, span_y = bx - ax, by - ay
        square_m2 = span_x * span_x + span_y * span_y
        length_m = sqrt(square_m2)
        if ay * span_x - ax * span_y < -way_m * length_m:
            continue
        share = -(ax * span_x + ay * span_y) / square_m2 if square_m2 > 0.0 else 0.0
        share = 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
        foot_x, foot_y = ax + share * span_x, ay + share * span_y
        least_m = sqrt(foot_x * foot_x + foot_y * foot_y) - way_m
        if least_m >= reach_m:
            continue
        left_rad, right_rad = FULL_TURN_RAD, 0.0
        if least_m > 0.0:
            left_rad = rough_bearing_rad(ax * cosine + ay * sine, ay * cosine - ax * sine)
            right_rad = rough_bearing_rad(bx * cosine + by * sine, by * cosine - bx * sine)
            if left_rad < right_rad:
                left_rad += FULL_TURN_RAD
            left_rad += half_width_rad(way_m, sqrt(ax * ax + ay * ay)) + turn_rad
            right_rad -= half_width_rad(way_m, sqrt(bx * bx + by * by)) + turn_rad
        for sonar in sonars_between(right_rad, left_rad):
            views[sonar][1].append((least_m, start_x, start_y, end_x, end_y, length_m))


def sonars_between(right_rad: float, left_rad: float) -> list[int]:
    """Return the sonars whose cones reach into a sector, given from right to left."""
    first, last = floor(right_rad / CONE_RAD) + 4, floor(left_rad / CONE_RAD) + 4
    if last > first + 15:
        last = first + 15
    return [cone & 7 for cone in range(first, last + 1) if cone & 8 == 0]


def half_width_rad(wide_m: float, away_m: float) -> float:
    """Return at least half the angle of a disc at a distance: x + 0.571 x^3 is above asin x."""
    if wide_m >= away_m:
        return HALF_TURN_RAD
    x = wide_m / away_m
    return x + 0.571 * x * x * x


def rough_bearing_rad(along: float, aside: float) -> float:
    """Return the direction of a point within `BEARING_ERROR_RAD`."""
    size, across = (along if along >= 0.0 else -along), (aside if aside >= 0.0 else -aside)
    if size >= across:
        x = across / size if size > 0.0 else 0.0
        angle_rad = x * (0.97239411 - 0.19194795 * x * x)
    else:
        x = size / across
        angle_rad = 0.5 * HALF_TURN_RAD - x * (0.97239411 - 0.19194795 * x * x)
    if along < 0.0:
        angle_rad = HALF_TURN_RAD - angle_rad
    return angle_rad if aside >= 0.0 else -angle_rad
