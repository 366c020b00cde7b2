"""Cast all forty rays of a sonar ring at once, as a few operations on small arrays.

Every surface gives each ray a *nearness*, the inverse of the distance from the robot's centre along
the ray, not above zero if they do not meet. The largest value of a ray belongs to the surface that
it hits first. With the ray's direction u and origin o (a disc of centre c and radius r; an edge from
a to b; x the cross product):

- disc: p = u.(c - o), q = |c - o|^2 - r^2, nearness (p + sqrt(p^2 - q)) / q;
- edge: d = u x (a - b), n = (o - a) x (b - a), nearness d / n, if u x (a - o) >= 0 >= u x (b - o).

The early and the late pings are two groups of twenty rays. The points of the surfaces are turned
into the frame of each group, where the directions of the rays are constant. Arrays are indexed by
coordinate (x, y), group, surface and ray. Only element by element operations are used: those that
add up along an axis, products of matrices among them, may round differently on another machine.
"""

from collections.abc import Sequence
from functools import cache
from math import inf, pi, radians
from struct import Struct
from typing import Final

import numpy as np

from plant.model.scene import Disc, Pose, Scene
from plant.sim.sensing.surfaces import ChosenSurfaces, Floats, PoseTolerance, Surfaces
from runtime.elementary import cos, cos_sin

SONARS: Final = 8
RAYS_PER_SONAR: Final = 5
GROUP: Final = SONARS * RAYS_PER_SONAR // 2
CONE_RAD: Final = radians(22.5)
ORDER: Final = (0, 2, 4, 6, 1, 3, 5, 7)
"""Sonars in column order: first the early group, then the late group."""

DRIFT: Final = PoseTolerance(way_m=0.35, turn_rad=radians(30.0))
"""Motion of the robot after which the surfaces in sight are selected again."""

TINY: Final = np.array(1e-12)
"""A constant array: numpy would otherwise create one from a number at every cast."""
TINY.setflags(write=False)
GROUPS: Final = np.arange(2)[:, None]
COLUMNS: Final = np.arange(GROUP)
_AIM: Final = Struct("18d")
"""Origins by kind of point, coordinate and group; cosines by group; sines by coordinate, group."""


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
        self._aimed = np.empty(18)
        self._aim_memory = self._aimed.data
        self._origins = self._aimed[:12].reshape(3, 2, 2, 1)
        self._cosines = self._aimed[12:14].reshape(2, 1)
        self._sines = self._aimed[14:].reshape(2, 2, 1)
        self._nearest = np.empty((2, GROUP))
        self._nearest_of = self._nearest.reshape(SONARS, RAYS_PER_SONAR)

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
        sheet.meet(self._origins, self._cosines, self._sines)
        if self._moving:
            half = self._moving // 2
            sheet.near[1, :half] = 0.0
            sheet.near[0, half : self._moving] = 0.0
        np.maximum.reduce(sheet.near, 1, out=self._nearest, initial=0.0)
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
        """Store position and heading of both groups; edges take positions turned by a quarter."""
        (x0, y0, heading0), (x1, y1, heading1) = early, late
        (c0, s0), (c1, s1) = cos_sin(heading0), cos_sin(heading1)
        # fmt: off
        _AIM.pack_into(
            self._aim_memory, 0,
            x0, x1, y0, y1,
            y0, y1, -x0, -x1,
            -y0, -y1, x0, x1,
            c0, c1,
            s0, s1, -s0, -s1,
        )
        # fmt: on

    def _lose_grazing(self) -> None:
        """Remove the echoes of rays that meet their surface too obliquely."""
        sheet = self._sheet
        if not len(sheet.near):
            return
        rows = sheet.near.argmax(axis=1)
        cosines = sheet.across[GROUPS, rows, COLUMNS] / self._chosen.sizes[rows]
        self._nearest[cosines < self._least_cosine] = 0.0


class RayArrays:
    """Preallocated arrays for the intersection of the chosen surfaces with the rays.

    `near` is the nearness, above zero only where they meet. `across` is the length of a chosen
    surface times the cosine of the ray's incidence, computed only if needed.
    """

    __slots__ = (
        *("across", "near", "_chosen", "_crossed", "_d", "_edges", "_inverse", "_kinds", "_meets"),
        *("_meets_discs", "_meets_edges", "_met", "_n", "_near_discs", "_near_edges", "_points"),
        *("_products", "_q", "_roots", "_swapped", "_towards", "_turned"),
    )

    def __init__(self, chosen: ChosenSurfaces, keep_across: bool) -> None:
        discs, edges, rows = chosen.discs, chosen.edges, chosen.discs + chosen.edges
        points = discs + 2 * edges
        self._chosen = chosen
        self._kinds = slice(discs), slice(discs, rows), slice(rows, points)
        self._points, self._turned = np.empty((2, 2, points)), np.empty((2, 2, points))
        self._swapped, self._products = np.empty((2, 2, points)), np.empty((2, 2, rows))
        self._met, self._crossed = np.empty((2, points, GROUP)), np.empty((2, points, GROUP))
        self._towards = self._met[:, :discs]
        self._edges = self._met[:, discs:rows], self._met[:, rows:]
        self._inverse = np.empty((2, rows))
        self._q, self._n = self._inverse[:, :discs], self._inverse[:, discs:]
        self.across = np.empty((2, rows, GROUP))
        self._roots, self._d = self.across[:, :discs], self.across[:, discs:]
        self.near = np.empty((2, rows, GROUP)) if keep_across else self.across
        self._near_discs, self._near_edges = self.near[:, :discs], self.near[:, discs:]
        self._meets = np.empty((2, rows, GROUP))
        self._meets_discs, self._meets_edges = self._meets[:, :discs], self._meets[:, discs:]

    def meet(self, origins: Floats, cosines: Floats, sines: Floats) -> None:
        """Compute the nearness of every surface to every ray."""
        self._turn(origins, cosines, sines)
        met, crossed, turned, (along, across) = self._met, self._crossed, self._turned, _fan()
        np.multiply(turned[0, :, :, None], along, met)
        np.multiply(turned[1, :, :, None], across, crossed)
        np.add(met, crossed, met)
        near, inverse = self.near, self._inverse
        if self._chosen.discs:
            self._meet_discs()
        if self._chosen.edges:
            self._meet_edges()
        np.maximum(inverse, TINY, out=inverse)
        np.divide(near, inverse[:, :, None], near)
        np.copysign(near, self._meets, near)

    def _turn(self, origins: Floats, cosines: Floats, sines: Floats) -> None:
        """Compute the points in the frame of each group, and what depends on no ray."""
        chosen, points, turned, swapped = self._chosen, self._points, self._turned, self._swapped
        for kind, origin in zip(self._kinds, origins, strict=True):
            np.subtract(chosen.points[:, :, kind], origin, points[:, :, kind])
        np.multiply(points, cosines, turned)
        np.multiply(points[::-1], sines, swapped)
        np.add(turned, swapped, turned)
        products, discs = self._products, chosen.discs
        here = points[:, :, : products.shape[2]]
        np.multiply(here[:, :, :discs], here[:, :, :discs], products[:, :, :discs])
        np.multiply(here[:, :, discs:], chosen.spans, products[:, :, discs:])
        np.add(products[0], products[1], self._inverse)
        np.subtract(self._q, chosen.squares, self._q)

    def _meet_discs(self) -> None:
        towards, roots = self._towards, self._roots
        np.multiply(towards, towards, roots)
        np.subtract(roots, self._q[:, :, None], roots)
        np.minimum(roots, towards, out=self._meets_discs)
        np.abs(roots, roots)
        np.sqrt(roots, roots)
        np.add(towards, roots, self._near_discs)

    def _meet_edges(self) -> None:
        (begins, ends), meets = self._edges, self._meets_edges
        np.add(begins, ends, self._d)
        np.minimum(begins, ends, out=meets)
        np.minimum(meets, self._n[:, :, None], out=meets)
        if self.near is not self.across:
            self._near_edges[:] = self._d


@cache
def _fan() -> tuple[Floats, Floats]:
    """Return cosines and sines of the bearings from the heading, by group and ray."""
    pairs = [cos_sin(bearing_rad) for bearing_rad in ray_bearings_rad()]
    fan = np.array(pairs).reshape(2, 1, GROUP, 2)
    fan.setflags(write=False)
    return fan[..., 0].copy(), fan[..., 1].copy()
