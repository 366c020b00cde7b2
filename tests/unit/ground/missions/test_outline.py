"""Corners make a fence when its sides touch nothing but their neighbours."""

from hypothesis import given

from ground.missions.mission import Polygon, fault_of
from tests.support.each import each
from tests.support.ground.missions.made_up import polygons


@each(
    ("corners", "why"),
    [
        ([], "has 0 corners"),
        (
            [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)],
            "corner 1 and the next one are",
        ),
        ([(0.0, 0.0), (1.0, 0.0), (0.0, 0.0002), (0.0, 0.0)], "corner 2 and the next one"),
        ([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], "encloses nothing"),
        ([(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)], "side 0 and side 2 cross"),
    ],
)
def test_what_encloses_nothing_is_no_fence(corners: list[tuple[float, float]], why: str) -> None:
    assert why in fault_of(corners)


@given(polygons())
def test_corners_in_order_round_a_place_are_a_fence(polygon: Polygon) -> None:
    assert fault_of(polygon.corners) == ""
    assert fault_of(polygon.corners[::-1]) == ""
