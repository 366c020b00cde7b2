"""The cells around a robot by bearing."""

import numpy as np

from runtime.elementary import atan2
from study.oracle.grid_map import CELL_MM, CIRCLE, QUARTER, REACH_MM, brads, cones_of
from tests.support.each import each

WIDTH = 1000


def test_bearings_equal_the_arc_tangent() -> None:
    x_mm, y_mm = (each.ravel() for each in np.mgrid[-300:301:37, -300:301:41])
    found = brads(x_mm, y_mm).tolist()
    for x, y, bearing in zip(x_mm.tolist(), y_mm.tolist(), found, strict=True):
        expected = atan2(float(y), float(x)) * QUARTER / (3.141592653589793 / 2.0)
        assert abs((bearing - expected + CIRCLE / 2) % CIRCLE - CIRCLE / 2) < 0.6


@each("heading", [0, QUARTER, 3 * QUARTER])
def test_cone_is_one_slice_of_cells(heading: int) -> None:
    cones = cones_of(0, 0, WIDTH)
    first = heading + CIRCLE
    cells = cones.offset[cones.first[first - 128] : cones.first[first + 128]]
    along = {0: 1, QUARTER: WIDTH, 3 * QUARTER: -WIDTH}[heading]
    reach = REACH_MM // CELL_MM - 1
    assert {along * k for k in range(3, reach)} <= set(cells.tolist())
    assert not {-along * k for k in range(3, reach)} & set(cells.tolist())


def test_every_cell_in_reach_is_in_a_circle_once() -> None:
    cones = cones_of(1, 0, WIDTH)
    circle = cones.offset[cones.first[CIRCLE] : cones.first[2 * CIRCLE - 1]].tolist()
    assert len(circle) == len(set(circle))
    assert abs(len(circle) - 3.1416 * (REACH_MM / CELL_MM) ** 2) < 400
    assert int(cones.distance_mm.max()) <= REACH_MM
