"""Test the scale bar and the legend below the map."""

from dataclasses import replace

import pytest

from ground.map.canvas import Canvas
from ground.map.drawing import NOT_LIVE, draw, legend, length_text
from ground.map.scene import MapScene
from ground.map.view import View
from tests.support.each import each
from tests.support.ground.map.rooms import EVERYTHING, ROOM


@each(
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


def words_of(scene: MapScene, room: int) -> list[str]:
    return [words for words, _ in legend(scene, room)]


def test_legend_keeps_the_most_important_parts() -> None:
    lost = replace(ROOM, live=False, note="replay")
    assert words_of(lost, 80)[:3] == [NOT_LIVE, "replay", "◎ goal"]
    assert words_of(lost, 20) == [NOT_LIVE, "replay"]
    assert words_of(lost, 8) == [NOT_LIVE]
    assert words_of(lost, 3) == []


def test_legend_names_what_is_on_the_map() -> None:
    assert "─ truth" in words_of(ROOM, 80)
    assert words_of(MapScene(), 80) == []
    assert "─ truth" not in words_of(replace(ROOM, truth=False), 80)
    assert "H/L hit/leave" in words_of(replace(ROOM, hits=((1.0, 1.0),)), 80)
    assert "○ true robot" in words_of(replace(ROOM, true_robot=ROOM.robot), 80)


def test_legend_names_the_mark_of_a_dead_sonar_only_with_one() -> None:
    assert "× dead" in words_of(ROOM, 80)
    assert "× dead" not in words_of(replace(ROOM, ranges_m=(1.0,) * 8), 80)
    assert "× dead" not in words_of(replace(ROOM, live=False), 80)


def test_legend_in_ascii_is_ascii() -> None:
    assert all(words.isascii() for words, _ in legend(EVERYTHING, 200, ascii_only=True))


@each("m_per_dot", [1e-4, 0.0123, 0.05, 1.0, 1e6])
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
