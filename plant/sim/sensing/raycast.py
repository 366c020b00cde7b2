"""Cast all forty rays of a sonar ring at once, as a few products of small matrices.

Rows are surfaces, columns are rays. Every surface gives each ray a *nearness*, the inverse of the
distance from the robot's centre along the ray, not above zero if they do not meet. The largest
value in a column belongs to the surface that the ray hits first. With the ray's direction u and
origin o (a disc of centre c and radius r; an edge from a to b; x the cross product):

- disc: p = u.(c - o), q = |c - o|^2 - r^2, nearness (p + sqrt(p^2 - q)) / q;
- edge: d = u x (a - b), n = (o - a) x (b - a), nearness d / n, if u x (a - o) >= 0 >= u x (b - o).

A library may add up a product of matrices in any order and with any precision. So their factors are
rounded to grids that are coarse enough for every product and every sum to be exact, in any order.
"""

from collections.abc import Sequence
from functools import cache
from math import inf, pi, radians
from struct import Struct
from typing import Final

import numpy as np

from plant.model.scene import Disc, Pose, Scene
from plant.sim.sensing.surfaces import (
    ChosenSurfaces,
    Floats,
    PoseTolerance,
    Surfaces,
    on_grid_m,
)
from runtime.elementary import cos, cos_sin

SONARS: Final = 8
RAYS_PER_SONAR: Final = 5
RAYS: Final = SONARS * RAYS_PER_SONAR
EARLY: Final = RAYS // 2
CONE_RAD: Final = radians(22.5)
ORDER: Final = (0, 2, 4, 6, 1, 3, 5, 7)
"""Sonars in column order: first the early group, then the late group."""

DRIFT: Final = PoseTolerance(way_m=0.35, turn_rad=radians(30.0))
"""Motion of the robot after which the surfaces in sight are selected again."""

GRID: Final = 1.5 * (1 << 26)
"""Added and subtracted again, it rounds cosines and sines to multiples of 2^-26.

A product of two of them has 52 bits, and that of one and a coordinate 51."""

TINY: Final = np.array(1e-12)
"""A constant array: numpy would otherwise create one from a number at every cast."""
TINY.setflags(write=False)
_TURN: Final = Struct("2d16x2d16x16x2d16x2d")
"""A 4 by 4 matrix with the rotation of the early group at its upper left, of the late at its lower
right."""
_AIM: Final = Struct(2 * "4d16x" + 4 * "32x2d")
"""The lower six rows of an 8 by 6 matrix: a block of 2 by 4 at their left, then one of 4 by 2 at
their right."""
_AIM_AT: Final = 2 * 6 * 8


def ray_bearings_rad() -> tuple[float, ...]:
    """Return the bearings of the rays from the heading, by column, evenly spaced over the ring."""
    return tuple(
        (sonar - 3.5) * CONE_RAD + (ray - 2) * CONE_RAD / RAYS_PER_SONAR
        for sonar in ORDER
        for ray in range(RAYS_PER_SONAR)
    )


class Caster:
    """The view of one ring: the surfaces in sight, and the rays that meet them."""

    def __init__(self, scene: Scene, reach_m: float, incidence_limit_rad: float) -> None:
        """Create a caster; `reach_m` is measured from the centre of the robot."""
        self._surfaces = Surfaces(scene)
        self._reach_m = reach_m
        self._least_cosine = cos(incidence_limit_rad) if incidence_limit_rad < pi / 2 else 0.0
        self._moving = 0
        self._chosen_at = (inf, inf, 0.0)
        self._fan = _fan()
        self._turn_matrix = np.zeros((4, 4))
        self._turn_memory = self._turn_matrix.data
        self._aim_matrix = np.zeros((8, 6))
        self._aim_matrix[:2, :4] = (1.0, 0.0, 1.0, 0.0), (0.0, 1.0, 0.0, 1.0)
        self._aim_memory = self._aim_matrix.data
        self._turned = np.concatenate([self._fan, _halves()])
        self._directions = self._turned[:4]
        self._aimed = np.empty((8, RAYS))
        self._rays, self._starts = self._aimed[:4], self._aimed[4:]
        self._nearest = np.empty(RAYS)
        self._nearest_of = self._nearest.reshape(SONARS, RAYS_PER_SONAR)
        self._columns = np.arange(RAYS)

    def cast(
        self, early: Pose, late: Pose, moved: tuple[Sequence[Disc], Sequence[Disc]] = ((), ())
    ) -> list[float]:
        """Return the nearness of each sonar's nearest echo, in `ORDER`; not above zero without one.

        `moved`: positions of the moving discs at the early and at the late ping.
        """
        moving = 2 * len(moved[0])
        if moving != self._moving or self._drifted(late) or self._drifted(early):
            self._choose(late, moving)
        if self._moving:
            self._chosen.place([*moved[0], *moved[1]])
        self._aim(early, late)
        sheet = self._sheet
        sheet.meet(self._rays, self._starts)
        if self._moving:
            half = self._moving // 2
            sheet.near[:half, EARLY:] = 0.0
            sheet.near[half : self._moving, :EARLY] = 0.0
        np.maximum.reduce(sheet.near, 0, out=self._nearest, initial=0.0)
        if self._least_cosine > 0.0:
            self._lose_grazing()
        nearness: list[float] = np.maximum.reduce(self._nearest_of, 1).tolist()
        return nearness

    def _drifted(self, at: Pose) -> bool:
        """Return whether the pose differs too much from that of the chosen surfaces."""
        x_m, y_m, heading_rad = self._chosen_at
        gone_x_m, gone_y_m = at[0] - x_m, at[1] - y_m
        turned_rad = abs(at[2] - heading_rad)
        if turned_rad > pi:
            turned_rad = 2.0 * pi - turned_rad
        gone_m2 = gone_x_m * gone_x_m + gone_y_m * gone_y_m
        return gone_m2 > DRIFT.way_m * DRIFT.way_m or turned_rad > DRIFT.turn_rad

    def _choose(self, at: Pose, moving: int) -> None:
        """Select the surfaces in sight."""
        self._moving = moving
        self._chosen_at = at
        self._chosen = self._surfaces.in_sight(at, self._reach_m, DRIFT, moving)
        self._sheet = RayArrays(self._chosen, self._least_cosine > 0.0)

    def _aim(self, early: Pose, late: Pose) -> None:
        """Rotate the fan of rays to the heading and move it to the robot, per group."""
        (x0, y0, heading0), (x1, y1, heading1) = early, late
        (c0, s0), (c1, s1) = _on_grid(heading0), _on_grid(heading1)
        x0, y0, x1, y1 = on_grid_m(x0), on_grid_m(y0), on_grid_m(x1), on_grid_m(y1)
        # fmt: off
        _TURN.pack_into(self._turn_memory, 0, c0, -s0, s0, c0, c1, -s1, s1, c1)
        _AIM.pack_into(
            self._aim_memory, _AIM_AT,
            -x0, -y0, -x1, -y1,
            -y0, x0, -y1, x1,
            x0, x1, y0, y1, 1.0, 1.0, x0 * x0 + y0 * y0, x1 * x1 + y1 * y1,
        )
        # fmt: on
        directions = self._directions
        self._turn_matrix.dot(self._fan, directions)
        np.add(directions, GRID, directions)
        np.subtract(directions, GRID, directions)
        self._aim_matrix.dot(self._turned, self._aimed)

    def _lose_grazing(self) -> None:
        """Remove the echoes of rays that meet their surface too obliquely."""
        sheet = self._sheet
        if not len(sheet.near):
            return
        rows = sheet.near.argmax(axis=0)
        cosines = sheet.across[rows, self._columns] / self._chosen.sizes[rows]
        self._nearest[cosines < self._least_cosine] = 0.0


class RayArrays:
    """Preallocated arrays for the intersection of the chosen surfaces with the rays.

    `near` is the nearness, above zero only where they meet. `across` is the length of a chosen
    surface times the cosine of the ray's incidence, computed only if needed.
    """

    __slots__ = (
        *("across", "near", "_chosen", "_d", "_edges", "_inverse", "_meets_discs", "_meets_edges"),
        *("_meets", "_met", "_n", "_near_discs", "_near_edges", "_q", "_roots", "_towards"),
    )

    def __init__(self, chosen: ChosenSurfaces, keep_across: bool) -> None:
        discs, edges, rows = chosen.discs, chosen.edges, chosen.discs + chosen.edges
        self._chosen = chosen
        self._met = np.empty((discs + 2 * edges, RAYS))
        self._towards = self._met[:discs]
        self._edges = self._met[discs:rows], self._met[rows:]
        self._inverse = np.empty((rows, RAYS))
        self._q, self._n = self._inverse[:discs], self._inverse[discs:]
        self.across = np.empty((rows, RAYS))
        self._roots, self._d = self.across[:discs], self.across[discs:]
        self.near = np.empty((rows, RAYS)) if keep_across else self.across
        self._near_discs, self._near_edges = self.near[:discs], self.near[discs:]
        self._meets = np.empty((rows, RAYS))
        self._meets_discs, self._meets_edges = self._meets[:discs], self._meets[discs:]

    def meet(self, rays: Floats, starts: Floats) -> None:
        """Compute the nearness of every surface to every ray."""
        chosen, near, inverse = self._chosen, self.near, self._inverse
        chosen.ray_rows.dot(rays, self._met)
        chosen.origin_rows.dot(starts, inverse)
        if chosen.discs:
            self._meet_discs()
        if chosen.edges:
            self._meet_edges()
        np.maximum(inverse, TINY, out=inverse)
        np.divide(near, inverse, near)
        np.copysign(near, self._meets, near)

    def _meet_discs(self) -> None:
        towards, roots = self._towards, self._roots
        np.multiply(towards, towards, roots)
        np.subtract(roots, self._q, roots)
        np.minimum(roots, towards, out=self._meets_discs)
        np.abs(roots, roots)
        np.sqrt(roots, roots)
        np.add(towards, roots, self._near_discs)

    def _meet_edges(self) -> None:
        (begins, ends), meets = self._edges, self._meets_edges
        np.add(begins, ends, self._d)
        np.minimum(begins, ends, out=meets)
        np.minimum(meets, self._n, out=meets)
        if self.near is not self.across:
            self._near_edges[:] = self._d


@cache
def _fan() -> Floats:
    """Return cosines and sines of the bearings, two rows per group, 0 in the other's columns."""
    cosines, sines = np.array([_on_grid(bearing_rad) for bearing_rad in ray_bearings_rad()]).T
    early, late = _halves()
    fan = np.array([cosines * early, sines * early, cosines * late, sines * late])
    fan.setflags(write=False)
    return fan


def _halves() -> Floats:
    """Return the columns of the early and of the late group as ones."""
    return np.array([np.arange(RAYS) < EARLY, np.arange(RAYS) >= EARLY], dtype=float)


def _on_grid(angle_rad: float) -> tuple[float, float]:
    """Return the rounded cosine and sine of an angle."""
    cosine, sine = cos_sin(angle_rad)
    return (cosine + GRID) - GRID, (sine + GRID) - GRID
