"""Test the scale bar and the legend below the map."""

from dataclasses import replace

import pytest

from ground.map.canvas import Canvas
from ground.map.drawing import NOT_LIVE, TRUTH, draw, legend_text, length_text
from ground.map.scene import MapScene
from ground.map.view import View
from tests.support.ground.map.rooms import ROOM


@pytest.mark.parametrize(
    ("length_m", "text"),
    [
        (0.0005, "0.5 mm"),
        (0.002, "2 mm"),
        (0.02, "2 cm"),
        (0.5, "50 cm"),
        (1.0, "1 m"),
        (20.0, "20 m"),
        (5000.0, "5 km"),
    ],
)
def test_length_is_shown_in_a_fitting_unit(length_m: float, text: str) -> None:
    assert length_text(length_m) == text


def test_legend_keeps_the_most_important_parts() -> None:
    lost = replace(ROOM, live=False, note="replay")
    assert legend_text(lost, 80) == f"{NOT_LIVE}, {TRUTH}, replay"
    assert legend_text(lost, 20) == f"{NOT_LIVE}, replay"
    assert legend_text(lost, 8) == NOT_LIVE
    assert legend_text(lost, 3) == ""


def test_legend_names_truth_only_with_walls_drawn() -> None:
    assert legend_text(ROOM, 80) == TRUTH
    assert legend_text(MapScene(), 80) == ""
    assert legend_text(replace(ROOM, truth=False), 80) == ""


@pytest.mark.parametrize("m_per_dot", [1e-4, 0.0123, 0.05, 1.0, 1e6])
def test_scale_bar_has_its_stated_length(m_per_dot: float) -> None:
    canvas, view = Canvas(100, 8), View(100, 8, 0.0, 0.0, m_per_dot)
    draw(MapScene(), view, canvas)
    row = canvas.to_rows()[-1]
    length_m, cells = view.scale_bar(100 // 6)
    assert row.startswith("├" + "─" * (cells - 2) + "┤ " + length_text(length_m))
    assert cells * 2 * m_per_dot == pytest.approx(length_m, rel=0.15)


def test_a_map_of_few_rows_has_no_legend() -> None:
    canvas = Canvas(60, 4)
    draw(MapScene(live=False), View(60, 4), canvas)
    assert "".join(canvas.to_rows()).strip() == ""
