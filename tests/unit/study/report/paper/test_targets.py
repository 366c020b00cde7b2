"""Targets are met at the limit, missed just beyond, and not measured without trials."""

from math import nan
from typing import Any

import pytest

from study.report.page import text_of
from study.report.paper.targets import MET, MISSED, UNMEASURED, StudyTarget, target_table, targets
from study.runner.rows import TrialRow
from tests.support.study.report.made import COLLIDED, GAVE_UP, SHUT, STUCK, row, trials


def target(found: list[StudyTarget], what: str, noise: str = "default") -> StudyTarget:
    (one,) = [one for one in found if one.what.startswith(what) and one.noise == noise]
    return one


def many(count: int, bad: int, ending: dict[str, Any], **usual: Any) -> list[TrialRow]:
    """Return `count` trials, of which `bad` end badly."""
    return [row(seed=seed, **{**usual, **(ending if seed < bad else {})}) for seed in range(count)]


@pytest.mark.parametrize(("bad", "verdict"), [(2, MET), (3, MISSED)])
def test_99_percent_of_200_is_198(bad: int, verdict: str) -> None:
    one = target(targets(trials(*many(200, bad, STUCK))), "arrives by its own estimate")
    assert one.verdict == verdict
    assert one.measured.endswith(f"({200 - bad} of 200)")


def test_targets_are_compared_before_rounding() -> None:
    one = target(targets(trials(*many(1000, 11, STUCK))), "arrives by its own estimate")
    assert (one.verdict, one.measured) == (MISSED, "98.90 % (989 of 1000)")


def test_arrival_with_contact_does_not_count() -> None:
    found = targets(trials(*many(10, 1, {"contacts": 1})))
    assert target(found, "arrives by its own estimate").verdict == MISSED
    assert target(found, "trials with a contact, per").measured == "1000.0 (1 of 10)"
    assert target(found, "trials with a contact, by its own").verdict == MET


@pytest.mark.parametrize(("inside", "verdict"), [(92, MISSED), (93, MET), (97, MET), (98, MISSED)])
def test_ellipse_target_has_two_limits(inside: int, verdict: str) -> None:
    rows = many(100, 100 - inside, {"mahalanobis2": 6.0})
    assert target(targets(trials(*rows)), "of these, true position inside").verdict == verdict


def test_ellipse_target_counts_all_arrivals() -> None:
    rows = [row(seed=0), row(seed=1, mahalanobis2=nan), row(seed=2, **STUCK)]
    one = target(targets(trials(*rows)), "of these, true position inside")
    assert one.measured.endswith("(1 of 2)")


@pytest.mark.parametrize(("error_m", "verdict"), [(0.30, MET), (0.31, MISSED)])
def test_position_error_may_equal_its_limit(error_m: float, verdict: str) -> None:
    found = targets(trials(*many(10, 1, {"position_error_m": error_m})))
    assert target(found, "of these, true position error").verdict == verdict


def test_unreachable_goals_have_rate_and_time_targets() -> None:
    seen = [row(seed=seed, time_s=50.0 + seed, **{**SHUT, **GAVE_UP}) for seed in range(20)]
    found = targets(trials(*seen))
    assert target(found, "unreachable goals recognised").verdict == MET
    assert target(found, "time to recognise it").verdict == MET
    found = targets(trials(*seen, row(**SHUT, **STUCK)))
    assert target(found, "unreachable goals recognised").verdict == MISSED


def test_one_reachable_goal_called_unreachable_is_missed() -> None:
    found = targets(trials(*many(500, 1, GAVE_UP)))
    assert target(found, "reachable goals called unreachable").verdict == MISSED


def test_side_change_targets_are_median_and_worst() -> None:
    found = targets(trials(*many(9, 1, {"side_changes": 5})))
    assert target(found, "changes of side per trial, median").verdict == MET
    assert target(found, "changes of side per trial, worst").verdict == MISSED


def test_targets_use_the_own_navigator_only() -> None:
    rows = [row(), row(navigator="vgm", **COLLIDED)]
    assert target(targets(trials(*rows)), "arrives by its own estimate").verdict == MET


def test_grids_have_their_own_target() -> None:
    grid = many(100, 4, STUCK, family="moving_ai_maze", noise="none", world="maze512")
    found = targets(trials(row(noise="none"), *grid))
    assert target(found, "arrives in grid mazes", "none").verdict == MISSED
    assert target(found, "arrives by its own estimate", "none").verdict == MET
    assert target(found, "worlds of the corpus", "all").measured == "1"


@pytest.mark.parametrize(("wall_s", "verdict"), [(8.0, MET), (8.1, MISSED)])
def test_speed_target_is_for_two_workers_in_forests(wall_s: float, verdict: str) -> None:
    rows = [row(family="forest_dense", time_s=3600.0, wall_s=wall_s), row(wall_s=1e9)]
    assert target(targets(trials(*rows)), "simulated hours", "all").verdict == verdict


def test_missing_trials_are_not_measured() -> None:
    found = targets(trials(row(navigator="vgm")))
    assert {one.verdict for one in found} == {UNMEASURED}
    assert {text_of(cells[-1]) for cells in target_table(found).rows} == {UNMEASURED}
    only_none = targets(trials(row(noise="none")))
    assert target(only_none, "arrives by its own estimate", "harsh").verdict == UNMEASURED


def test_table_counts_met_targets() -> None:
    assert "met" in target_table(targets(trials(row()))).caption
