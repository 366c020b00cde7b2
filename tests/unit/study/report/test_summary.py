"""The summary by navigator and noise, and the README's table."""

import json
from math import inf, nan
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import UserError
from study.cli.report import BEGIN, END, block, lines_of, summary_of, update_readme, with_block
from study.intervals import Interval, Share
from study.report.build import ReportRequest
from study.report.page import interval, number, percent, probability, share
from study.report.summary import HEAD, as_json, numbers, summaries
from tests.support.each import each
from tests.support.study.report.made import COLLIDED, GAVE_UP, LOST, SHUT, STUCK, row, study, trials

ROOT = Path(__file__).parents[4]
SUMMARY = ROOT / "docs" / "evidence" / "study" / "summary.json"


def test_success_counts_worlds_with_a_path() -> None:
    (found,) = summaries(trials(row(), row(**COLLIDED), row(**GAVE_UP), row(**{**SHUT, **GAVE_UP})))
    assert (found.success, found.recognised) == (Share(1, 3), Share(1, 1))
    assert (found.wronged, found.touched) == (Share(1, 3), Share(1, 4))
    assert (found.contacts, found.own_contacts, found.worlds) == (1, 1, 2)


def test_lost_and_stuck_are_counted_where_there_is_a_path() -> None:
    ends = row(**LOST), row(**STUCK), row(**{**SHUT, **LOST})
    (found,) = summaries(trials(row(), row(seed=1), *ends))
    assert (found.lost, found.stuck) == (Share(1, 4), Share(1, 4))
    assert found.recognised == Share(0, 1)


def test_scores_are_means_over_worlds_with_a_path() -> None:
    (found,) = summaries(trials(row(), row(**STUCK), row(**{**SHUT, **GAVE_UP})))
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
    (found,) = summaries(trials(row(path_m=5.4321), row(**COLLIDED, heading_error_rad=None)))
    kept = numbers(found)
    assert (kept["success"], kept["success_of"], kept["ratio_0"]) == (1, 2, 5.4321 / 5.0)
    assert (kept["recognised_of"], kept["recognised_s"]) == (0, None)
    assert (kept["success_low"], kept["success_high"]) == Share(1, 2).interval


def test_readme_table_has_a_column_per_noise_or_a_dash() -> None:
    found = trials(row(), row(noise="none", navigator="bug"), row(navigator="bug", **COLLIDED))
    lines = lines_of(as_json(summaries(found))).splitlines()
    assert lines[0].startswith("| navigator | success %, none | success %, default | touched")
    assert lines[2].startswith("| bug | 100.0 [20.7, 100.0] | 0.0 [0.0, 79.3] | 100.00 |")
    assert lines[3].startswith("| vgm_memory | - | 100.0 [20.7, 100.0] | 0.00 | 1.10 (1.10) |")


def test_readme_table_without_rows_has_a_head() -> None:
    assert len(lines_of([]).splitlines()) == 2


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
    assert share(Share(0, 0)) == "-"
