"""Pairs of navigators: pairing, the better one, and adjusted p-values."""

import pytest

from study.intervals import mcnemar
from study.report.build import family_table
from study.report.comparisons import comparison, comparison_table, comparisons, runs_by_pair
from study.report.page import PageCell, text_of
from tests.support.study.report.made import STUCK, row, trials


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
    assert found.p_success == mcnemar(0, 10) == found.p_worlds
    assert found.ratio == pytest.approx(1.2)
    cells = comparison_table([found], "default").rows[0]
    assert text_of(cells[5]) == "**0.0020** second"


def test_sign_test_counts_each_world_once() -> None:
    rows = [row(navigator="vgm", seed=seed) for seed in range(20)]
    rows += [row(navigator="bug", seed=seed, **STUCK) for seed in range(20)]
    (found,) = comparisons(trials(*rows), "default")
    assert found.p_success < 1e-5
    assert (found.worlds_first, found.worlds_second, found.p_worlds) == (0, 1, 1.0)


def test_p_values_are_adjusted_for_three_pairs() -> None:
    rows = [
        row(navigator=navigator, world=f"w{number}", **({} if navigator == "vgm" else STUCK))
        for navigator in ("bug", "vgm", "distbug")
        for number in range(8)
    ]
    found = {(one.first, one.second): one for one in comparisons(trials(*rows), "default")}
    assert found["bug", "vgm"].p_success == pytest.approx(3 * mcnemar(0, 8))
    assert found["bug", "distbug"].p_success == 1.0


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
