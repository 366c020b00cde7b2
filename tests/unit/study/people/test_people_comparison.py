"""Sums over trials among people, their intervals, and the tables of the page."""

import json
from math import inf, isclose, pi

import pytest

from study.people.__main__ import BEGIN, END, to_json, with_tables
from study.people.comparison import (
    CrowdComparison,
    contact_table,
    navigator_table,
    origin_table,
    pooled,
)
from study.people.crowd_trial import CrowdTrial, Stay, TrialSeries, WorldResult, run_world
from study.people.encounters import Exposure, PersonContact
from tests.support.each import each

BUG, MEMORY = "bug:right", "vgm_memory:left"
SERIES = TrialSeries("crowd", "default", 5, 4, (BUG, MEMORY))
HOUR_TICKS = 72_000
EXPOSURE = Exposure(HOUR_TICKS, HOUR_TICKS, HOUR_TICKS // 10, HOUR_TICKS // 20, 1.5)


def contact(
    bearing_rad: float, speed_m_s: float, yaw_rad_s: float, tracked_s: float, person_m_s: float
) -> PersonContact:
    return PersonContact(1.0, 0, bearing_rad, speed_m_s, yaw_rad_s, tracked_s, person_m_s)


def trial(touched: bool, standing: float, own: int = 0, *contacts: PersonContact) -> CrowdTrial:
    return CrowdTrial(not touched, touched, own, standing, EXPOSURE, contacts)


def result(*trials: CrowdTrial, blocked: bool = False) -> WorldResult:
    stays = (Stay(EXPOSURE, True), Stay(EXPOSURE, False))
    return WorldResult({BUG: trials, MEMORY: trials}, blocked, stays, None if blocked else EXPOSURE)


def comparison(*results: WorldResult) -> CrowdComparison:
    return CrowdComparison((SERIES,), MEMORY, results)


def test_comparison_counts_trials_and_rates() -> None:
    found = comparison(
        result(trial(True, 0.5, 1)),
        result(trial(False, 0.25)),
        result(trial(False, 0.25)),
        result(trial(False, 0.0), blocked=True),
    )
    assert (found.arrived.count, found.touched.count, found.own.count) == (3, 1, 1)
    assert (found.blocked.count, found.blocked.of) == (1, 4)
    assert found.standing == 0.25
    assert found.excess == 0.125
    assert found.own_rate.per_hour == 0.25
    assert isclose(found.nearness.intruded_s_per_min, 6.0)
    assert isclose(found.nearness.soon_share, 0.05)


@each(("touched", "verdict"), [(0, "met"), (10, "not decided"), (40, "missed")])
def test_verdict_needs_the_whole_interval_on_one_side(touched: int, verdict: str) -> None:
    results = [result(trial(number < touched, 0.3)) for number in range(100)]
    assert comparison(*results).verdict == verdict


def test_repeated_trials_of_a_world_are_one_sample() -> None:
    single = [result(trial(touched, 0.5)) for touched in (True, False) * 20]
    repeated = [result(*[trial(touched, 0.5)] * 4) for touched in (True, False) * 20]
    low, high = comparison(*single).excess_interval
    assert low < comparison(*single).excess < high
    assert comparison(*repeated).excess_interval == (low, high)
    few_low, few_high = comparison(*repeated).touched.interval
    assert comparison(*repeated).touched_interval.low < few_low
    assert comparison(*repeated).touched_interval.high > few_high


def test_pooled_comparison_has_the_worlds_of_both() -> None:
    one, other = comparison(result(trial(True, 0.5))), comparison(result(trial(False, 0.1)))
    both = pooled(one, other)
    assert (both.touched.count, len(both.results)) == (1, 2)
    assert isclose(both.standing, 0.3)
    assert "| seed of the worlds | 5 and 5 |" in contact_table([both])


def test_tables_have_equal_columns_in_every_row() -> None:
    found = comparison(result(trial(True, 0.5)), result(trial(False, 0.5), blocked=True))
    rows = [CrowdComparison((SERIES,), BUG, found.results), found]
    for table in (contact_table(rows), navigator_table(rows), origin_table(rows)):
        lines = table.splitlines()
        assert len({line.count("|") for line in lines}) == 1
    names = [line.split(" | ")[0] for line in navigator_table(rows).splitlines()[2:]]
    assert names == ["| bug, right", "| vgm_memory", "| standing robot", "| omniscient robot"]


def test_origin_table_sorts_contacts_by_bearing_motion_and_track() -> None:
    found = comparison(
        result(trial(True, 0.5, 0, contact(pi, 0.3, 0.0, 0.0, 0.31))),
        result(trial(True, 0.5, 0, contact(-0.6 * pi, 0.0, -1.0, 3.0, 0.29))),
        result(trial(True, 0.5, 1, contact(-0.1, 0.2, 0.0, inf, 0.4))),
        result(trial(True, 0.5, 0, contact(1.0, 0.0, 0.0, 6.5, 0.1))),
    )
    cells = [line.strip("| ").split(" | ")[2:] for line in origin_table([found]).splitlines()[2:]]
    assert cells == [
        ["2", "0", "1", "1", "0", "1", "1", "0", "1"],
        ["1", "0", "0", "0", "1", "0", "0", "1", "0"],
        ["1", "1", "1", "0", "0", "0", "0", "1", "1"],
        ["4", "1", "2", "1", "1", "1", "1", "2", "2"],
    ]


def test_page_keeps_its_text_and_gets_new_tables() -> None:
    marks = BEGIN.format("contacts") + "old\n" + END.format("contacts")
    page = with_tables(f"before\n{marks}after\n", {"contacts": "new\n"})
    assert page.startswith("before\n")
    assert page.endswith("after\n")
    assert "new" in page
    assert "old" not in page
    assert with_tables(page, {"contacts": "new\n"}) == page


def test_page_without_marks_is_refused() -> None:
    with pytest.raises(ValueError, match=r"has no <!-- begin: python -m study\.people, contacts"):
        with_tables("text\n", {"contacts": "new\n"})


def test_json_counts_the_baselines_per_trial() -> None:
    series = SERIES._replace(repeats=2)
    results = (
        result(trial(True, 0.75, 1), trial(False, 0.75), blocked=True),
        result(trial(False, 0.25), trial(False, 0.25)),
    )
    found = CrowdComparison((series,), MEMORY, results)
    (counts,) = json.loads(to_json([found], []))["crowds"]
    assert counts == {
        "family": "crowd",
        "navigator": "vgm_memory",
        "noise": "default",
        "seed": 5,
        "trials": 4,
        "touched": 1,
        "own": 1,
        "standing_touched": 2,
        "omniscient_touched": 2,
    }


def test_world_is_driven_by_each_navigator_with_its_baselines() -> None:
    series = TrialSeries("crowd", "none", 7, 1, ("bug2:left", MEMORY), is_exposed=True)
    found = run_world(series, 0)
    assert [len(trials) for trials in found.trials.values()] == [1, 1]
    (one,) = found.trials[MEMORY]
    assert one.arrived != one.touched
    assert found.blocked == (found.route is None)
    longest_s = max(one.exposure.time_s for one in found.stays)
    assert isclose(longest_s, one.exposure.time_s, abs_tol=0.06)
