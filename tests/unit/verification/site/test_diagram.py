"""Diagrams of the pages: boxes, arrows, state diagrams and tables instead of crowded ones."""

from xml.etree import ElementTree

import pytest

from checks.site.diagram import MAX_DRAWN, Box, box_diagram, edge, fence, state_diagram
from tests.support.each import each

BOXES = """
title: Two <boxes>
box a "A" "first" at 0 0
box b "B" "second & last" at 1 0
arrow a b "go on"
arrow b a "go back"
"""


def test_boxes_and_arrows_are_drawn() -> None:
    found = ElementTree.fromstring(box_diagram(BOXES))
    assert found.findtext("title") == "Two <boxes>"
    assert len(found.findall("rect")) == 2
    assert len(found.findall("path")) == 2
    words = [element.text for element in found.findall("text")]
    assert words == ["A", "first", "B", "second & last", "go on", "go back"]


def test_unknown_word_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown word 'circle'"):
        box_diagram("circle a")


def test_few_transitions_are_drawn() -> None:
    source = "stateDiagram-v2\n    [*] --> OFF\n    OFF --> ON: press\n    ON --> OFF: press\n"
    found = ElementTree.fromstring(fence(source, "mermaid", "diagram", {}, None))
    assert found.findtext("title") == "States; the first one is OFF"
    assert len(found.findall("rect")) == 2


def test_many_transitions_become_a_table() -> None:
    lines = [f"    A --> S{number}: step {number}" for number in range(MAX_DRAWN + 1)]
    found = ElementTree.fromstring(f"<div>{state_diagram(chr(10).join(lines))}</div>")
    assert len(found.findall("table/thead/tr/th")) == MAX_DRAWN + 3
    assert found.findall("table/tbody/tr/td")[1].text == "step 0"


@each(("towards", "where"), [((100, 0), (12, 0)), ((0, -100), (0, -7)), ((-100, 0), (-12, 0))])
def test_arrow_leaves_a_box_at_its_edge(
    towards: tuple[float, float], where: tuple[float, float]
) -> None:
    assert edge(Box("", "", (0.0, 0.0), (20.0, 10.0)), towards) == pytest.approx(where)
