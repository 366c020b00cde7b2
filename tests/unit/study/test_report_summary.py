"""Tables of the report: trials, summaries, comparisons and bounds."""

import json
from math import inf, isnan, nan
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import UserError
from study.cli.report import BEGIN, END, block, lines_of, summary_of, update_readme, with_block
from study.intervals import Interval, Proportion, binomial_two_sided
from study.report.build import ReportRequest, family_table
from study.report.comparisons import (
    bounds_of,
    bounds_section,
    comparison,
    comparison_table,
    comparisons,
    figure_table,
    recognition_tables,
    runs_by_pair,
    way_table,
    ways_of,
)
from study.report.page import (
    PageCell,
    PageTable,
    interval,
    number,
    percent,
    probability,
    share,
    text_of,
)
from study.report.summary import HEAD, as_json, numbers, summaries
from study.report.trials import distinct, trials_of
from study.runner.rows import TrialRow
from study.runner.store import SCHEMA, table_of
from tests.support.each import each
from tests.support.studies import (
    COLLIDED,
    GAVE_UP,
    LOST,
    STUCK,
    row,
    study,
    trials,
    without_values,
)
from tests.support.studies import SHUT as REPORT_SHUT

ROOT = Path(__file__).parents[3]
SUMMARY = ROOT / "docs" / "evidence" / "study" / "summary.json"


def test_success_counts_worlds_with_a_path() -> None:
    (found,) = summaries(
        trials(row(), row(**COLLIDED), row(**GAVE_UP), row(**{**REPORT_SHUT, **GAVE_UP}))
    )
    assert (found.success, found.recognised) == (Proportion(1, 3), Proportion(1, 1))
    assert (found.wronged, found.touched) == (Proportion(1, 3), Proportion(1, 4))
    assert (found.contacts, found.own_contacts, found.worlds) == (1, 1, 2)
    assert found.reachable_worlds == 1


def test_lost_and_stuck_are_counted_where_there_is_a_path() -> None:
    ends = row(**LOST), row(**STUCK), row(**{**REPORT_SHUT, **LOST})
    (found,) = summaries(trials(row(), row(seed=1), *ends))
    assert (found.lost, found.stuck) == (Proportion(1, 4), Proportion(1, 4))
    assert found.recognised == Proportion(0, 1)


def test_false_arrivals_and_drives_without_an_end_are_counted() -> None:
    shut = row(**REPORT_SHUT), row(**{**REPORT_SHUT, **GAVE_UP})
    (found,) = summaries(trials(row(), row(outcome="timeout"), *shut))
    assert found.false_arrivals == Proportion(1, 2)
    assert found.timeout == Proportion(1, 2)


def test_scores_are_means_over_worlds_with_a_path() -> None:
    (found,) = summaries(trials(row(), row(**STUCK), row(**{**REPORT_SHUT, **GAVE_UP})))
    assert found.spl == pytest.approx(0.5 * 5.0 / 5.5)
    assert found.score == pytest.approx(0.25)


def test_summary_has_a_row_per_navigator_and_noise() -> None:
    found = as_json(summaries(trials(row(), row(noise="harsh"), row(navigator="bug"))))
    assert [(one["navigator"], one["noise"]) for one in found] == [
        ("bug", "default"),
        ("vgm_memory", "default"),
        ("vgm_memory", "harsh"),
    ]
    assert all(tuple(one) == HEAD for one in found)


def test_numbers_are_unrounded_and_unknown_ones_empty() -> None:
    (found,) = summaries(
        trials(row(path_m=5.4321), row(world="b", **COLLIDED, heading_error_rad=None))
    )
    kept = numbers(found)
    assert (kept["success"], kept["success_of"], kept["ratio_0"]) == (1, 2, 5.4321 / 5.0)
    assert (kept["recognised_of"], kept["recognised_s"]) == (0, None)
    assert (kept["success_low"], kept["success_high"]) == Proportion(1, 2).interval


def test_readme_table_has_a_column_per_noise_or_a_dash() -> None:
    found = trials(row(), row(noise="none", navigator="bug"), row(navigator="bug", **COLLIDED))
    lines = lines_of(as_json(summaries(found))).splitlines()
    assert lines[0] == "| navigator | worlds | trials | success %, none | success %, default |"
    assert lines[2] == "| bug | 1 | 1 | 100.0 [20.7, 100.0] | 0.0 [0.0, 79.3] |"
    assert lines[3] == "| vgm_memory | 1 | 1 | - | 100.0 [20.7, 100.0] |"
    assert lines[5].startswith("| navigator | touched something %, default | path / shortest")
    assert lines[7].startswith("| bug | 100.00 | - (-) |")
    assert lines[8].startswith("| vgm_memory | 0.00 | 1.10 (1.10) |")


def test_readme_counts_worlds_and_trials_at_each_noise() -> None:
    rows = [row(noise="none"), *(row(seed=seed, world=f"w{seed % 2}") for seed in range(1500))]
    cells = lines_of(as_json(summaries(trials(*rows)))).splitlines()[2].split(" | ")
    assert cells[1:3] == ["1 to 2", "1 to 1,500"]


def test_readme_shows_false_arrivals_and_hard_worlds() -> None:
    shut = [row(**REPORT_SHUT, noise="harsh"), row(**{**REPORT_SHUT, **GAVE_UP}, noise="harsh")]
    rows = [row(noise="harsh"), *shut, row(family="crowd", **COLLIDED)]
    text = block(summary_of(table_of(rows), ReportRequest()))
    head, values = (line.split(" | ") for line in text.split("\n\n")[1].splitlines()[::2])
    assert values[head.index("reached without a way %, harsh")] == "50.0"
    assert text.splitlines()[-1] == "| crowds | default | 1 | 1 | 0.0 [0.0, 79.3] | 100.00 |"
    assert "clustered by world" in text


def test_older_summary_says_that_its_intervals_are_too_narrow() -> None:
    summary = summary_of(study(), ReportRequest())
    del summary["clustered"]
    for one in summary["rows"]:
        del one["reached without a way %"]
    text = block(summary)
    assert "too narrow" in text
    assert "reached without a way" not in text


def test_readme_table_without_rows_has_a_head() -> None:
    assert [line for line in lines_of([]).splitlines() if line.startswith("| ")] == [
        "| navigator | worlds | trials |",
        "| navigator |",
    ]


def test_block_replaces_only_the_text_between_markers() -> None:
    page = f"# A\n\n{BEGIN}\nold\n{END}\n\nrest\n"
    once = with_block(page, "new")
    assert once == f"# A\n\n{BEGIN}\n\nnew\n\n{END}\n\nrest\n"
    assert with_block(once, "new") == once


@each("page", ["# A\n", f"{END}\n{BEGIN}\n", f"{BEGIN}\n"])
def test_readme_without_markers_is_refused(page: str) -> None:
    with pytest.raises(UserError, match=r"R\.md: the page has no <!-- study:begin -->"):
        with_block(page, "new", "R.md")


def test_update_writes_the_block_of_the_summary(tmp_path: Path) -> None:
    readme, summary = tmp_path / "README.md", tmp_path / "summary.json"
    readme.write_text(f"{BEGIN}\n{END}\n")
    summary.write_text(json.dumps(summary_of(study(), ReportRequest())))
    update_readme(readme, summary)
    assert "66 trials in 11 worlds of 6 families" in readme.read_text()
    summary.unlink()
    with pytest.raises(UserError, match=r"summary\.json: No such file"):
        update_readme(readme, summary)


def test_readme_agrees_with_the_committed_study() -> None:
    found = json.loads(SUMMARY.read_text(encoding="utf-8"))
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    assert with_block(page, block(found)) == page, "sidestep study report ... --readme README.md"


def test_committed_study_is_small() -> None:
    files = [file for file in SUMMARY.parent.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) < 3_000_000


@each(
    ("rate", "text"),
    [(0.9999, ">99.9"), (1.0, "100.0"), (0.0001, "<0.1"), (0.0, "0.0"), (nan, "-"), (0.5, "50.0")],
)
def test_percentages_are_never_rounded_to_0_or_100(rate: float, text: str) -> None:
    assert percent(rate) == text


@given(st.floats(), st.floats())
def test_every_number_can_be_formatted(value: float, other: float) -> None:
    for text in (number(value), interval(Interval(value, other)), probability(abs(value))):
        assert text
        assert "inf" not in text.replace("< ", "") or abs(value) == inf


def test_share_of_nothing_is_a_dash() -> None:
    assert share(Proportion(0, 0)) == "-"


def test_success_is_an_arrival_without_contact() -> None:
    failures = row(**STUCK), row(outcome="timeout"), row(**GAVE_UP)
    found = trials(row(), row(**COLLIDED), row(contacts=1), *failures)
    assert found.success.tolist() == [True, False, False, False, False, False]


def test_success_without_a_path_is_to_report_it() -> None:
    arrived, stuck, gave_up = (
        row(**REPORT_SHUT),
        row(**REPORT_SHUT, **STUCK),
        row(**{**REPORT_SHUT, **GAVE_UP}),
    )
    found = trials(arrived, stuck, gave_up)
    assert found.possible.tolist() == [False] * 3
    assert found.success.tolist() == [False, False, True]


def test_older_results_called_an_unreachable_goal_stuck() -> None:
    older = row(**{**REPORT_SHUT, **GAVE_UP, "outcome": "stuck"})
    found = trials(older, row(**REPORT_SHUT, **STUCK))
    assert found.texts("outcome").tolist() == ["unreachable", "stuck"]
    assert found.recognised.tolist() == [True, False]


def test_unknown_reachability_counts_as_reachable() -> None:
    assert trials(row(reachable=None, shortest_path_m=None)).possible.tolist() == [True]


def test_giving_up_after_a_collision_does_not_count() -> None:
    found = trials(row(**{**REPORT_SHUT, **GAVE_UP, **COLLIDED}))
    assert found.gave_up.tolist() == [True]
    assert found.success.tolist() == [False]


def test_ratio_needs_arrival_and_shortest_path() -> None:
    found = trials(row(path_m=6.0), row(shortest_path_m=None), row(**STUCK), row(shortest_path_m=0))
    assert found.ratio[0] == pytest.approx(1.2)
    assert [ratio != ratio for ratio in found.ratio.tolist()] == [False, True, True, True]


def test_identical_drives_count_once() -> None:
    same = {"digest": "d1", "noise": "none"}
    found = trials(row(seed=0, **same), row(seed=1, **same), row(seed=0, digest="d2"))
    assert distinct(found).numbers("seed").tolist() == [0.0, 0.0]
    assert len(distinct(trials(row(digest="d1"), row(digest="d1", navigator="vgm")))) == 2


def test_failed_trials_are_all_kept() -> None:
    failed = {"outcome": "failed", "digest": ""}
    assert len(distinct(trials(row(seed=0, **failed), row(seed=1, **failed)))) == 2


def test_labels_contain_what_the_study_varied() -> None:
    found = trials(
        row(navigator="bug", side="left"),
        row(navigator="bug", side="right"),
        row(navigator="vgm"),
        row(navigator="distbug", calibrated=False),
        row(navigator="distbug", parameters='{"d_obs_m": 0.2}'),
    )
    assert found.labels() == [
        *("bug, left", "bug, right", "vgm"),
        *('distbug, {"d_obs_m": 0.2}, calibrated', "distbug, {}, not calibrated"),
    ]


def test_values_are_in_the_order_of_the_report() -> None:
    found = trials(row(noise="harsh"), row(noise="foggy"), row(noise="none"), row(navigator="bug"))
    assert found.values("noise") == ["none", "default", "harsh", "foggy"]
    assert found.values("navigator") == ["bug", "vgm_memory"]


def test_table_without_a_column_is_refused() -> None:
    with pytest.raises(UserError, match=r"no column digest; .* run the study again"):
        trials_of(table_of([row()]).drop_columns("digest"))


def test_columns_without_values_are_accepted() -> None:
    found = trials_of(without_values(study()))
    assert len(found) == study().num_rows
    assert not found.inside.any()


def test_empty_table_has_no_labels() -> None:
    found = distinct(trials_of(SCHEMA.empty_table()))
    assert (len(found), found.labels(), found.values("noise")) == (0, [], [])


def test_pairs_share_world_noise_and_seed() -> None:
    some = trials(row(navigator="vgm", seed=0), row(navigator="vgm", seed=1, world="other"))
    others = trials(row(navigator="bug", seed=0, **STUCK), row(navigator="bug", seed=2))
    found = comparison("default", ("vgm", runs_by_pair(some)), ("bug", runs_by_pair(others)))
    assert (found.pairs, found.only_first, found.only_second, found.common) == (1, 1, 0, 0)


def test_ten_more_failed_worlds_are_significant() -> None:
    worlds = [f"box_1_{number:03d}" for number in range(12)]
    rows = [row(navigator="vgm_memory", world=world, path_m=5.0) for world in worlds]
    rows += [row(navigator="bug", world=world, **STUCK) for world in worlds[:10]]
    rows += [row(navigator="bug", world=world, path_m=6.0) for world in worlds[10:]]
    (found,) = comparisons(trials(*rows), "default")
    assert (found.first, found.second) == ("bug", "vgm_memory")
    assert (found.only_first, found.only_second) == (0, 10)
    assert found.p_worlds == binomial_two_sided(0, 10)
    assert found.ratio == pytest.approx(1.2)
    cells = comparison_table([found], "default").rows[0]
    assert text_of(cells[7]) == "**0.0020** second"


def test_sign_test_counts_each_world_once() -> None:
    rows = [row(navigator="vgm", seed=seed) for seed in range(20)]
    rows += [row(navigator="bug", seed=seed, **STUCK) for seed in range(20)]
    (found,) = comparisons(trials(*rows), "default")
    assert (found.only_first, found.only_second, found.worlds) == (0, 20, 1)
    assert (found.worlds_first, found.worlds_second, found.p_worlds) == (0, 1, 1.0)


def test_p_values_are_adjusted_for_three_pairs() -> None:
    rows = [
        row(navigator=navigator, world=f"w{number}", **({} if navigator == "vgm" else STUCK))
        for navigator in ("bug", "vgm", "distbug")
        for number in range(8)
    ]
    found = {(one.first, one.second): one for one in comparisons(trials(*rows), "default")}
    assert found["bug", "vgm"].p_worlds == pytest.approx(3 * binomial_two_sided(0, 8))
    assert found["bug", "distbug"].p_worlds == 1.0


def test_path_is_compared_by_worlds() -> None:
    rows = [row(navigator="vgm", seed=seed, path_m=6.0) for seed in range(20)]
    rows += [row(navigator="bug", seed=seed, path_m=5.0) for seed in range(20)]
    (found,) = comparisons(trials(*rows), "default")
    assert (found.common, found.p_ratio) == (20, 1.0)
    assert found.ratio_interval == (-inf, inf)


def test_navigators_without_pairs_are_not_compared() -> None:
    rows = [row(navigator="vgm", world="here"), row(navigator="bug", world="there")]
    assert comparisons(trials(*rows), "default") == []


def test_family_table_has_heat_or_a_dash() -> None:
    some = trials(
        row(navigator="vgm", family="box", **STUCK),
        row(navigator="bug", family="box"),
        row(navigator="bug", family="maze", world="maze"),
    )
    table = family_table(some, "default")
    assert table.head == ("family", "worlds", "bug", "vgm")
    box, maze = table.rows
    assert box[2:] == (PageCell("100 (1/1)", heat=1.0), PageCell("0 (0/1)", heat=0.0))
    assert maze[2:] == (PageCell("100 (1/1)", heat=1.0), PageCell("-", "none"))


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
