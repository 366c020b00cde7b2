"""Goals given up are counted apart: wrong claims with a bound, lost, stuck, and the laps."""

from math import isnan

import pytest

from study.intervals import Share
from study.report.page import text_of
from study.report.summary import given_up, given_up_table
from tests.support.study.report.made import GAVE_UP, LOST, SHUT, STUCK, row, trials


def test_three_ends_are_counted_apart() -> None:
    open_rows = [row(), row(**GAVE_UP), row(**LOST), row(**{**LOST, "doubt_m": 0.2}), row(**STUCK)]
    shut_rows = [row(**{**SHUT, **end}) for end in (GAVE_UP, LOST, STUCK)]
    (found,) = given_up(trials(*open_rows, *shut_rows))
    assert (found.wronged, found.recognised) == (Share(1, 5), Share(1, 3))
    assert found.ended == (Share(2, 5), Share(1, 5))
    assert found.ended_shut == (Share(1, 3), Share(1, 3))
    assert found.doubt_m == 0.42


def test_laps_are_times_at_top_speed_round_the_boundary() -> None:
    shut = {**SHUT, **GAVE_UP, "lap_m": 6.0}
    (found,) = given_up(trials(*(row(**shut, seed=n, time_s=20.0 * (n + 1)) for n in range(3))))
    assert found.laps == pytest.approx((2.0, 2.8))
    assert found.time_s == pytest.approx((40.0, 56.0))


def test_unknown_lap_gives_no_figure() -> None:
    (found,) = given_up(trials(row(**{**SHUT, **GAVE_UP, "lap_m": None})))
    assert all(map(isnan, found.laps))


def test_zero_wrong_claims_have_a_bound() -> None:
    table = given_up_table(trials(*(row(seed=seed) for seed in range(100))))
    cells = [text_of(cell) for cell in table.rows[0]]
    called = table.head.index("called unreachable")
    assert cells[called : called + 2] == ["0", "295.13"]


def test_row_without_trials_of_a_kind_has_dashes() -> None:
    (cells,) = given_up_table(trials(row(**{**SHUT, **GAVE_UP}))).rows
    assert [text_of(cell) for cell in cells].count("-") == 5
