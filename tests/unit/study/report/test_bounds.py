"""Both bounds of a trial, and the section that compares them."""

from math import isnan
from typing import Any

import pytest

from study.report.comparisons import (
    bounds_of,
    bounds_section,
    figure_table,
    recognition_tables,
    way_table,
    ways_of,
)
from study.report.page import PageTable, text_of
from study.runner.rows import TrialRow
from tests.support.each import each
from tests.support.study.report.made import GAVE_UP, STUCK, row, trials

SHUT: dict[str, Any] = {
    "family": "unreachable",
    "reachable": False,
    "shortest_path_m": None,
    **GAVE_UP,
}


def both(world: str, own_m: float, planner_m: float, **more: Any) -> list[TrialRow]:
    return [
        row(world=world, path_m=own_m, **more),
        row(world=world, path_m=planner_m, navigator="oracle_grid", **more),
    ]


def test_each_trial_has_both_bounds() -> None:
    some = trials(*both("a", 7.0, 6.0), row(world="b", path_m=9.0))
    found = bounds_of(some)
    assert [one.shortest_m for one in found] == [5.0, 5.0, 5.0]
    assert [one.planner_m for one in found[:2]] == [6.0, 6.0]
    assert isnan(found[2].planner_m)
    assert all(isnan(one.planner_s) for one in found)


def test_bound_of_time_needs_a_recognised_goal() -> None:
    some = trials(
        row(world="a", time_s=90.0, **SHUT),
        row(world="a", time_s=30.0, navigator="oracle_grid", **SHUT),
        row(world="b", time_s=90.0, **SHUT),
        row(world="b", time_s=30.0, navigator="oracle_grid", **{**SHUT, "outcome": "timeout"}),
    )
    assert [one.planner_s for one in bounds_of(some)][:2] == [30.0, 30.0]
    assert all(isnan(one.planner_s) for one in bounds_of(some)[2:])


def test_only_pairs_that_both_arrive_are_compared() -> None:
    failed = row(world="b", navigator="oracle_grid", **STUCK)
    ways = ways_of(trials(*both("a", 7.5, 6.0), row(world="b", path_m=9.0), failed))
    assert ways.own.tolist() == [1.5]
    assert ways.excess.tolist() == pytest.approx([1.25])


@each(
    ("own_m", "planner_m", "verdict"),
    [(5.4, 5.0, "met"), (6.2, 5.5, "met"), (6.2, 5.0, "missed")],
)
def test_figure_is_met_by_itself_or_near_the_planner(
    own_m: float, planner_m: float, verdict: str
) -> None:
    table = figure_table(trials(*both("a", own_m, planner_m)), "default")
    assert text_of(table.rows[0][-1]) == verdict


def test_figure_without_pairs_is_not_measured() -> None:
    some = trials(row(world="a"), row(world="b", navigator="oracle_grid"))
    assert text_of(figure_table(some, "default").rows[0][-1]) == "not measured"


def test_table_has_families_and_all_together() -> None:
    some = trials(*both("a", 7.5, 6.0, family="box"), *both("b", 10.0, 5.0, family="maze"))
    names = [text_of(cells[0]) for cells in way_table(some, "default").rows]
    assert names == ["box", "maze", "all"]
    assert text_of(way_table(some, "default").rows[1][4]) == "2.00"


def test_times_to_recognise_are_compared() -> None:
    some = trials(
        row(world="a", time_s=90.0, **SHUT),
        row(world="a", time_s=30.0, navigator="oracle_grid", **SHUT),
    )
    (table,) = recognition_tables(some, "default")
    assert [text_of(cell) for cell in table.rows[0][1:4]] == ["1", "1", "1"]
    assert text_of(table.rows[0][-1]) == "3.00"
    assert list(recognition_tables(trials(*both("a", 7.0, 6.0)), "default")) == []


def test_section_needs_both_navigators() -> None:
    assert bounds_section(trials(row())) is None
    section = bounds_section(trials(*both("a", 7.0, 6.0)))
    assert section is not None
    assert sum(isinstance(block, PageTable) for block in section.blocks) == 2
