"""Targets are met at the limit, missed just beyond, and not measured without trials."""

from math import nan
from typing import Any

import pytest

from study.intervals import Share
from study.report.page import text_of
from study.report.targets import (
    ELSEWHERE,
    MET,
    MISSED,
    UNMEASURED,
    StudyTarget,
    bounded,
    target_table,
    targets,
)
from study.runner.rows import TrialRow
from tests.support.each import each
from tests.support.study.report.made import COLLIDED, GAVE_UP, LOST, SHUT, STUCK, row, trials


def target(found: list[StudyTarget], what: str, noise: str = "default") -> StudyTarget:
    (one,) = [one for one in found if one.what.startswith(what) and one.noise == noise]
    return one


def many(count: int, bad: int, ending: dict[str, Any], **usual: Any) -> list[TrialRow]:
    """Return `count` trials, of which `bad` end badly."""
    return [row(seed=seed, **{**usual, **(ending if seed < bad else {})}) for seed in range(count)]


@each(("bad", "verdict"), [(3, MET), (4, MISSED)])
def test_99_7_percent_of_1000_is_997(bad: int, verdict: str) -> None:
    one = target(targets(trials(*many(1000, bad, STUCK))), "arrives by its own estimate")
    assert one.verdict == verdict
    assert one.measured.endswith(f"({1000 - bad} of 1000)")


def test_targets_are_compared_before_rounding() -> None:
    one = target(targets(trials(*many(1000, 11, STUCK))), "arrives by its own estimate")
    assert (one.verdict, one.measured) == (MISSED, "98.90 % (989 of 1000)")


def test_arrival_with_contact_does_not_count() -> None:
    found = targets(trials(*many(10, 1, {"contacts": 1})))
    assert target(found, "arrives by its own estimate").verdict == MISSED
    assert target(found, "trials with a contact, per").measured == "1000.0 (1 of 10)"
    assert target(found, "trials with a contact, by its own").verdict == MET


@each(("inside", "verdict"), [(92, MISSED), (93, MET), (97, MET), (98, MISSED)])
def test_ellipse_target_has_two_limits(inside: int, verdict: str) -> None:
    rows = many(100, 100 - inside, {"mahalanobis2": 6.0})
    assert target(targets(trials(*rows)), "of these, true position inside").verdict == verdict


def test_ellipse_target_counts_all_arrivals() -> None:
    rows = [row(seed=0), row(seed=1, mahalanobis2=nan), row(seed=2, **STUCK)]
    one = target(targets(trials(*rows)), "of these, true position inside")
    assert one.measured.endswith("(1 of 2)")


@each(("error_m", "verdict"), [(0.30, MET), (0.31, MISSED)])
def test_position_error_may_equal_its_limit(error_m: float, verdict: str) -> None:
    found = targets(trials(*many(10, 1, {"position_error_m": error_m})))
    assert target(found, "of these, true position error").verdict == verdict


def test_unreachable_goals_have_rate_and_lap_targets() -> None:
    seen = [row(seed=seed, time_s=50.0 + seed, **{**SHUT, **GAVE_UP}) for seed in range(20)]
    found = targets(trials(*seen))
    assert target(found, "unreachable goals recognised").verdict == MET
    laps = target(found, "time to recognise it over that of one lap, median")
    assert float(laps.measured) == pytest.approx(59.5 * 0.3 / 12.0, abs=1e-3)
    assert laps.verdict == MET
    late = target(found, "time to recognise it over that of one lap, 90th")
    assert late.verdict == MISSED
    found = targets(trials(*seen, row(**{**SHUT, **LOST})))
    assert target(found, "unreachable goals recognised").verdict == MISSED


def test_one_wrong_claim_in_the_corpus_is_missed() -> None:
    one = target(
        targets(trials(*many(500, 1, GAVE_UP))), "reachable goals called unreachable, corpus", "all"
    )
    assert (one.measured, one.verdict) == ("20.00 (1 of 500)", MISSED)


@each(("runs", "verdict"), [(29_955, MISSED), (29_956, MET)])
def test_no_wrong_claim_needs_enough_trials_for_its_bound(runs: int, verdict: str) -> None:
    found = bounded("claims", "all", Share(0, runs), 0.1, 1.0)
    assert (found.verdict, found.interval) == (verdict, "≤ 1.00")


def test_wrong_claims_are_counted_in_grid_maps_but_not_apart() -> None:
    rows = [row(family="grid_maze", **GAVE_UP), row(family="comb", noise="none", **GAVE_UP)]
    found = targets(trials(row(), *rows))
    corpus = target(found, "reachable goals called unreachable, corpus", "all")
    fooled = target(found, "reachable goals called unreachable, adversarial", "none")
    assert corpus.measured == "5000.00 (1 of 2)"
    assert fooled.measured == "10000.00 (1 of 1)"


def test_each_noise_level_shows_the_bound_of_its_wrong_claims() -> None:
    rows = [*many(3, 0, {}, noise="none"), *many(2, 1, GAVE_UP, noise="harsh")]
    found = targets(trials(*rows))
    what = "reachable goals called unreachable, corpus"
    calm, harsh = target(found, what, "none"), target(found, what, "harsh")
    assert (calm.measured, calm.interval, calm.verdict) == ("0.00 (0 of 3)", "≤ 6315.97", MET)
    assert (harsh.measured, harsh.interval, harsh.verdict) == (
        "5000.00 (1 of 2)", "≤ 9746.79", MISSED,
    )  # fmt: skip
    assert target(found, what, "all").interval == "≤ 6574.08"
    assert target(found, what, "lossy").verdict == UNMEASURED


def test_adversarial_claims_show_the_exact_bound() -> None:
    rows = many(193, 0, {}, family="comb", noise="none")
    one = target(targets(trials(*rows)), "reachable goals called unreachable, adv", "none")
    assert (one.interval, one.verdict) == ("≤ 154.02", MET)


def test_side_change_targets_are_median_and_worst() -> None:
    found = targets(trials(*many(9, 1, {"side_changes": 7})))
    assert target(found, "changes of side per trial, median").verdict == MET
    assert target(found, "changes of side per trial, worst").verdict == MISSED


def test_targets_use_the_own_navigator_only() -> None:
    rows = [row(), row(navigator="vgm", **COLLIDED)]
    assert target(targets(trials(*rows)), "arrives by its own estimate").verdict == MET


@each(("noise", "verdict"), [("none", MISSED), ("default", MET)])
def test_grids_have_their_own_targets(noise: str, verdict: str) -> None:
    grid = many(100, 1, STUCK, family="moving_ai_maze", noise=noise, world="maze512")
    found = targets(trials(row(noise=noise), *grid))
    assert target(found, "arrives on generated grid maps", noise).verdict == verdict
    assert target(found, "arrives by its own estimate", noise).verdict == MET
    assert target(found, "worlds of the corpus", "all").measured == "1"


def test_thin_walls_have_a_row_for_each_thickness() -> None:
    thin = {"family": "thin", "noise": "lossy"}
    rows = [row(**thin, seed=seed, thinnest_wall_m=0.002) for seed in range(49)]
    rows += [row(**thin, seed=seed, thinnest_wall_m=0.01, **STUCK) for seed in range(1)]
    found = targets(trials(row(noise="lossy"), *rows))
    assert target(found, "arrives among thin walls", "lossy").verdict == MET
    assert target(found, "arrives among walls of 2 mm", "lossy").verdict == MET
    assert target(found, "arrives among walls of 10 mm", "lossy").verdict == MISSED
    assert target(found, "arrives by its own estimate", "lossy").measured.endswith("(1 of 1)")


def test_crowds_are_judged_by_the_robot_s_own_contacts() -> None:
    rows = [*many(300, 1, {"contacts": 1}, family="crowd"), row(family="crowd_hasty", **COLLIDED)]
    found = targets(trials(*rows))
    assert target(found, "crowds: trials with a contact by its own").verdict == MET


def test_published_score_has_a_target_in_clutter() -> None:
    rows = many(10, 1, STUCK, family="forest_dense", time_s=34.0)
    found = targets(trials(*rows))
    forests = target(found, "published score (at most 0.5), forests")
    assert (forests.measured, forests.verdict) == ("0.441", MISSED)


def test_long_path_near_that_of_the_planner_is_met() -> None:
    own = [row(seed=seed, path_m=7.0) for seed in range(5)]
    planner = [row(seed=seed, path_m=6.5, navigator="oracle_grid") for seed in range(5)]
    what = "path over shortest path, median"
    assert target(targets(trials(*own)), what).verdict == MISSED
    near = target(targets(trials(*own, *planner)), what)
    assert (near.measured, near.verdict) == ("1.4, 1.077 x that of `oracle_grid`", MET)
    far = [row(seed=seed, path_m=6.0, navigator="oracle_grid") for seed in range(5)]
    assert target(targets(trials(*own, *far)), what).verdict == MISSED
    unpaired = [row(seed=9, path_m=6.9, navigator="oracle_grid")]
    assert target(targets(trials(*own, *unpaired)), what).verdict == MISSED


@each(("wall_s", "verdict"), [(8.0, MET), (8.1, MISSED)])
def test_speed_target_is_for_two_workers_in_forests(wall_s: float, verdict: str) -> None:
    rows = [row(family="forest_dense", time_s=3600.0, wall_s=wall_s), row(wall_s=1e9)]
    assert target(targets(trials(*rows)), "simulated hours", "all").verdict == verdict


def test_missing_trials_are_not_measured() -> None:
    found = targets(trials(row(navigator="vgm")))
    assert {one.verdict for one in found} == {UNMEASURED, ELSEWHERE}
    assert {text_of(cells[-1]) for cells in target_table(found).rows} == {UNMEASURED, ELSEWHERE}
    only_none = targets(trials(row(noise="none")))
    assert target(only_none, "arrives by its own estimate", "harsh").verdict == UNMEASURED


def test_table_counts_met_targets() -> None:
    assert "met" in target_table(targets(trials(row()))).caption
