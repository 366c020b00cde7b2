"""The paper's claims, targets, and figures of other tools."""

import json
from collections.abc import Sequence
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any

import pytest

from robot.core import states
from runtime.errors import UserError
from study.intervals import Proportion
from study.report import drives as paper_runs
from study.report.drives import (
    PLACES,
    TRAPS,
    DrivenTrial,
    PaperRuns,
    Pose,
    deviation_m,
    figure_trials,
    path_ratios,
    remaining_deviation,
    remaining_turn_deg,
    run_paper,
    trap_trials,
)
from study.report.evidence import (
    BOARD,
    MAPS,
    PEOPLE,
    BoardCost,
    BoardTick,
    CrowdResult,
    MapResult,
    MeasuredEvidence,
    read_evidence,
)
from study.report.page import figures_of, text_of
from study.report.paper import (
    CONFIRMED,
    REFUTED,
    UNCLEAR,
    Claim,
    claims,
    claims_table,
    paper_section,
)
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
from study.report.trials import trials_of
from study.runner.rows import TrialRow
from study.runner.store import SCHEMA
from tests.support.each import each
from tests.support.studies import COLLIDED, GAVE_UP, LOST, SHUT, STUCK, drive, floor, row, trials

NONE = trials_of(SCHEMA.empty_table())
DETOUR_FACTOR: Sequence[Pose] = [
    (1.0, 1.0, 0.0),
    (2.0, 1.5, 0.0),
    (2.5, 1.25, 0.0),
    (3.0, 1.0, 0.0),
]
RETURN: Sequence[Pose] = [(1.0, 1.0, 0.0), (2.0, 1.5, 0.0), (2.1, 1.0, 0.0), (3.0, 1.0, 0.0)]
LONG: Sequence[Pose] = [(1.0, 1.0, 0.0), (2.0, 2.5, 0.0), (2.5, 1.75, 0.0), (3.0, 1.0, 0.0)]
BUGS: tuple[dict[str, Any], ...] = (
    {"navigator": "bug", "side": "left"},
    {"navigator": "bug", "side": "right"},
)


def verdict(found: list[Claim], words: str) -> str:
    (one,) = [one for one in found if words in one.statement]
    return one.verdict


def twenty(path: Sequence[Pose], request: dict[str, Any]) -> list[DrivenTrial]:
    return [drive(path, seed=seed, **request) for seed in range(20)]


def runs(bugs: Sequence[Pose], vgm: Sequence[Pose]) -> PaperRuns:
    figures = [one for bug in BUGS for one in twenty(bugs, bug)]
    return PaperRuns((*figures, *twenty(vgm, {"navigator": "vgm"})), ())


def in_family(family: str, good: int, of: int, **request: str) -> list[TrialRow]:
    return [
        row(family=family, world=f"{family}_1_{n:03d}", **request, **({} if n < good else STUCK))
        for n in range(of)
    ]


def test_straight_path_to_the_goal_leaves_half_deviation() -> None:
    assert remaining_deviation(drive(DETOUR_FACTOR)) == pytest.approx(0.5)
    assert remaining_deviation(drive(RETURN)) == pytest.approx(0.0)
    assert deviation_m(drive(DETOUR_FACTOR)) == pytest.approx(0.5)


def test_no_remaining_deviation_without_arrival_or_deviation() -> None:
    assert remaining_deviation(drive([(1.0, 1.0, 0.0), (3.0, 1.05, 0.0)])) is None
    assert remaining_deviation(drive(DETOUR_FACTOR, outcome="stuck")) is None


def test_remaining_turn_counts_from_the_first_aligning_tick() -> None:
    goal = replace(floor(far_m=2.0).goal, heading_rad=0.0)
    world = replace(floor(far_m=2.0), goal=goal)
    path = [(1.0, 1.0, 0.0), (3.0, 1.0, 0.7), (3.0, 1.0, 0.1)]
    branches = [states.TO_GOAL, states.ALIGN, states.ALIGN]
    assert remaining_turn_deg(drive(path, branches, world=world)) == pytest.approx(40.107, abs=1e-3)
    assert remaining_turn_deg(drive(path, branches)) is None
    assert remaining_turn_deg(drive(path, branches, world=world, outcome="timeout")) is None


def test_return_rule_confirms_and_refutes() -> None:
    returned = "vgm returns to the original path"
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, RETURN)), returned) == CONFIRMED
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, DETOUR_FACTOR)), returned) == REFUTED
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, RETURN)), "bug does not return") == CONFIRMED
    assert verdict(claims(NONE, runs(RETURN, RETURN)), "bug does not return") == REFUTED


def test_path_length_rule_confirms_and_refutes() -> None:
    assert verdict(claims(NONE, runs(LONG, DETOUR_FACTOR)), "not proper") == CONFIRMED
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, LONG)), "not proper") == REFUTED
    assert path_ratios(runs(LONG, LONG), "bug, left", "vgm") == [1.0] * 20


def test_disagreeing_sides_of_bug_are_unclear() -> None:
    figures = [*twenty(LONG, BUGS[0]), *twenty(DETOUR_FACTOR, BUGS[1])]
    found = PaperRuns((*figures, *twenty(DETOUR_FACTOR, {"navigator": "vgm"})), ())
    assert verdict(claims(NONE, found), "not proper") == UNCLEAR


@each(("good", "of", "wanted"), [(120, 120, CONFIRMED), (50, 50, UNCLEAR), (60, 120, REFUTED)])
def test_always_needs_100_trials_without_exception(good: int, of: int, wanted: str) -> None:
    rows = in_family("u_trap", good, of, navigator="vgm")
    found = claims(trials(*rows), PaperRuns())
    assert verdict(found, "whatever the shape") == wanted
    assert verdict(found, "any reachable goal") == wanted


def test_one_failure_in_thousands_is_unclear() -> None:
    rows = in_family("box", 1999, 2000, navigator="vgm")
    assert verdict(claims(trials(*rows), PaperRuns()), "any reachable goal") == UNCLEAR


def test_counterexamples_are_listed_with_their_id() -> None:
    rows = in_family("u_trap", 0, 20, navigator="vgm")
    (found,) = [
        one for one in claims(trials(*rows), PaperRuns()) if "whatever the shape" in one.statement
    ]  # fmt: skip
    assert found.verdict == REFUTED
    assert f"u_trap_1_000 default seed 0 (`{rows[0].trial_id[:12]}`)" in found.shown


def test_never_is_refuted_by_arrivals() -> None:
    statement = "never reaches the goal"
    sides = ("left", "right")
    never = [one for s in sides for one in in_family("corner", 0, 100, navigator="bug", side=s)]
    often = [one for s in sides for one in in_family("corner", 50, 60, navigator="bug", side=s)]
    assert verdict(claims(trials(*never), PaperRuns()), statement) == CONFIRMED
    assert verdict(claims(trials(*often), PaperRuns()), statement) == REFUTED


def test_collision_counts_against_never_colliding() -> None:
    rows = [row(navigator="vgm", world=f"w{n}", **COLLIDED) for n in range(10)]
    assert verdict(claims(trials(*rows), PaperRuns()), "without colliding") == REFUTED


def test_dominance_is_decided_by_worlds_on_both_sides() -> None:
    vgm = in_family("box", 20, 20, navigator="vgm", side="left")
    bugs = [in_family("box", 5, 20, navigator="bug", side=side) for side in ("left", "right")]
    assert verdict(claims(trials(*vgm, *bugs[0], *bugs[1]), PaperRuns()), "dominant") == CONFIRMED
    assert verdict(claims(trials(*vgm, *bugs[0]), PaperRuns()), "dominant") == UNCLEAR
    swapped = [in_family("box", 20, 20, navigator="bug", side=side) for side in ("left", "right")]
    worse = in_family("box", 5, 20, navigator="vgm", side="left")
    assert (
        verdict(claims(trials(*worse, *swapped[0], *swapped[1]), PaperRuns()), "dominant")
        == REFUTED
    )


def test_every_claim_is_unclear_without_trials() -> None:
    found = claims(NONE, PaperRuns())
    assert {one.verdict for one in found} == {UNCLEAR}
    assert len(claims_table(found).rows) == len(found) == 10


def test_figure_trials_cover_every_noise_level() -> None:
    found = figure_trials(3)
    assert len(found) == len(PLACES) * 4 * (1 + 3 * 3)
    assert {one.world.name for one in found} == set(PLACES.values())
    assert {one.navigator for one in trap_trials(1)} == {"bug", "vgm"}
    assert {one.world.name for one in trap_trials(1)} == set(TRAPS)


def test_paper_figures_show_every_drive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(paper_runs, "TRAPS", ())
    found = run_paper(1, seeds=1)
    assert len(found.figures) == len(PLACES) * 4 * 4
    section = paper_section(NONE, found)
    assert [part.title for part in section.parts] == ["Claims", "Figures 11, 12 and 13"]
    drawn = [one.drawing.title for one in figures_of([section])]
    assert [title.partition(":")[0] for title in drawn] == [
        *("Figure 11 redone", "Figure 12 redone", "Figure 13 redone"),
    ]
    assert run_paper(1, seeds=0) == PaperRuns()


CROWD: dict[str, Any] = {
    "family": "crowd",
    "navigator": "vgm_memory",
    "noise": "default",
    "seed": 7,
    "trials": 1000,
    "touched": 125,
    "own": 0,
    "standing_touched": 311,
    "omniscient_touched": 0,
}
GRIDS: dict[str, Any] = {
    "maps": "Moving AI",
    "scale": 1.0,
    "noise": "default",
    "trials": 492,
    "arrived": 479,
    "touched": 0,
    "unreachable": 0,
    "lost": 10,
    "other": 3,
    "score": 0.417,
    "score_low": 0.41,
    "score_high": 0.424,
}


def judged(evidence: MeasuredEvidence, what: str, noise: str) -> StudyTarget:
    """Return the only target with this beginning at this noise level."""
    found = targets(trials(row()), evidence)
    (one,) = [one for one in found if one.what.startswith(what) and one.noise == noise]
    return one


@each(("touched", "verdict"), [(155, MET), (156, MISSED)])
def test_contacts_may_be_half_of_the_standing_robot_s(touched: int, verdict: str) -> None:
    evidence = MeasuredEvidence(crowds=(CrowdResult(**{**CROWD, "touched": touched}),))
    one = judged(evidence, "crowds: trials with any contact", "default")
    assert one.verdict == verdict


def test_contacts_over_the_standing_robot_s_have_an_interval() -> None:
    evidence = MeasuredEvidence(crowds=(CrowdResult(**CROWD),))
    one = judged(evidence, "crowds: trials with any contact", "default")
    assert (one.measured, one.interval) == ("0.40 x (125 against 311 of 1000)", "[0.33, 0.49]")


def test_other_crowds_and_navigators_do_not_count() -> None:
    others = ({"family": "crowd_hasty"}, {"navigator": "vgm"})
    evidence = MeasuredEvidence(crowds=tuple(CrowdResult(**{**CROWD, **one}) for one in others))
    assert judged(evidence, "crowds: trials with any contact", "all").verdict == ELSEWHERE


def test_published_grid_maps_have_arrivals_and_wrong_claims() -> None:
    calm = {"noise": "none", "arrived": 492, "lost": 0, "other": 0}
    evidence = MeasuredEvidence(maps=(MapResult(**{**GRIDS, **calm}), MapResult(**GRIDS)))
    what = "arrives on published grid maps"
    assert judged(evidence, what, "none").verdict == MET
    noisy = judged(evidence, what, "default")
    assert (noisy.measured, noisy.verdict) == ("97.36 % (479 of 492)", MISSED)
    claims = "reachable goals called unreachable, published grid maps"
    assert judged(evidence, claims, "default").interval == "≤ 60.70"


@each(("score", "verdict"), [(0.48, MET), (0.4799, MISSED)])
def test_each_scale_of_the_cylinders_has_a_score(score: float, verdict: str) -> None:
    barn = {**GRIDS, "maps": "BARN", "noise": "none", "score": score}
    evidence = MeasuredEvidence(
        maps=tuple(MapResult(**{**barn, "scale": each}) for each in (1.0, 0.75))
    )
    small = judged(evidence, "published score (at most 0.5), BARN x 0.75", "none")
    assert (small.interval, small.verdict) == ("[0.410, 0.424]", verdict)
    assert judged(evidence, "published score (at most 0.5), BARN x 1,", "none").verdict == verdict


def test_score_without_an_interval_is_judged_by_its_mean() -> None:
    unknown = {"maps": "BARN", "score": 0.5, "score_low": None, "score_high": None}
    evidence = MeasuredEvidence(maps=(MapResult(**{**GRIDS, **unknown}),))
    one = judged(evidence, "published score (at most 0.5), BARN", "default")
    assert (one.interval, one.verdict) == ("-", MET)


@each(
    ("worst_ms", "state_bytes", "verdicts"),
    [(25.0, 4096, (MET, MET)), (25.1, 4097, (MISSED, MISSED))],
)
def test_worst_step_and_state_are_limits(
    worst_ms: float, state_bytes: int, verdicts: tuple[str, str]
) -> None:
    other = BoardTick("bug1", 49.0)
    cost = BoardCost(
        [BoardTick("vgm_memory", 3.0), other],
        [BoardTick("vgm_memory", worst_ms)],
        {"vgm_memory": state_bytes},
    )
    step = judged(MeasuredEvidence(board=cost), "modelled worst step", "all")
    state = judged(MeasuredEvidence(board=cost), "memory of the navigator", "all")
    assert (step.verdict, state.verdict) == verdicts
    assert step.interval == "worst of 2 drives"


def test_missing_figures_name_their_page(tmp_path: Path) -> None:
    assert read_evidence(None) == read_evidence(tmp_path) == MeasuredEvidence()
    found = targets(trials(row()), read_evidence(tmp_path))
    pages = {one.measured for one in found if one.verdict == ELSEWHERE}
    assert pages == {
        "docs/evidence/people.md",
        "docs/evidence/microcontroller.md",
        "docs/evidence/published-maps.md",
    }


def test_files_are_read_and_unknown_columns_left_out(tmp_path: Path) -> None:
    (tmp_path / PEOPLE).write_text(json.dumps({"crowds": [CROWD]}))
    (tmp_path / MAPS).write_text(json.dumps({"maps": [GRIDS]}))
    (tmp_path / BOARD).parent.mkdir()
    tick = {"navigator": "vgm_memory", "whole_ms": 21.7, "stack": 3420}
    (tmp_path / BOARD).write_text(json.dumps({"drives": [tick], "noise": "default"}))
    assert read_evidence(tmp_path) == MeasuredEvidence(
        (CrowdResult(**CROWD),),
        (MapResult(**GRIDS),),
        BoardCost([BoardTick("vgm_memory", 21.7)]),
    )


@pytest.mark.parametrize("text", ["{", '{"crowds": [{"family": "crowd"}]}', '{"crowds": 3}'])
def test_file_of_another_form_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / PEOPLE).write_text(text)
    with pytest.raises(UserError, match=r"people\.json: "):
        read_evidence(tmp_path)


def test_missing_directory_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"--evidence .*nowhere: no such directory"):
        read_evidence(tmp_path / "nowhere")


def target(found: list[StudyTarget], what: str, noise: str = "default") -> StudyTarget:
    (one,) = [one for one in found if one.what.startswith(what) and one.noise == noise]
    return one


def many(count: int, bad: int, ending: dict[str, Any], **usual: Any) -> list[TrialRow]:
    """Return `count` trials, each in a world of its own, of which `bad` end badly."""
    return [
        row(**{"world": f"w{number}", **usual, **(ending if number < bad else {})})
        for number in range(count)
    ]


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
    found = bounded("claims", "all", Proportion(0, runs), 0.1, 1.0)
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
