"""What stands under the map."""

from dataclasses import replace

import pytest

from ground.map import Canvas, Scene, View, draw
from ground.map.drawing import LOST, TRUTH, metres, words
from tests.support.ground.map.rooms import ROOM


@pytest.mark.parametrize(
    ("length_m", "said"),
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
def test_a_length_is_said_as_people_say_it(length_m: float, said: str) -> None:
    assert metres(length_m) == said


def test_the_more_important_word_is_kept_when_there_is_little_room() -> None:
    lost = replace(ROOM, live=False, note="replay")
    assert words(lost, 80) == f"{LOST}, {TRUTH}, replay"
    assert words(lost, 20) == f"{LOST}, replay"
    assert words(lost, 8) == LOST
    assert words(lost, 3) == ""


def test_truth_is_only_claimed_of_walls_that_are_drawn() -> None:
    assert words(ROOM, 80) == TRUTH
    assert words(Scene(), 80) == ""
    assert words(replace(ROOM, truth=False), 80) == ""


@pytest.mark.parametrize("m_per_dot", [1e-4, 0.0123, 0.05, 1.0, 1e6])
def test_the_bar_is_as_long_as_it_says(m_per_dot: float) -> None:
    canvas, view = Canvas(100, 8), View(100, 8, 0.0, 0.0, m_per_dot)
    draw(Scene(), view, canvas)
    row = canvas.to_rows()[-1]
    length_m, cells = view.scale_bar(100 // 6)
    assert row.startswith("├" + "─" * (cells - 2) + "┤ " + metres(length_m))
    assert cells * 2 * m_per_dot == pytest.approx(length_m, rel=0.15)


def test_a_map_of_few_rows_has_no_legend() -> None:
    canvas = Canvas(60, 4)
    draw(Scene(live=False), View(60, 4), canvas)
    assert "".join(canvas.to_rows()).strip() == ""
