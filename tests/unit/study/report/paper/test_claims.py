"""The paper's claims: each rule can confirm, refute and leave open."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from robot.core import states
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
from study.report.page import figures_of
from study.report.paper import (
    CONFIRMED,
    REFUTED,
    UNCLEAR,
    Claim,
    claims,
    claims_table,
    paper_section,
)
from study.report.trials import trials_of
from study.runner.rows import TrialRow
from study.runner.store import SCHEMA
from tests.support.each import each
from tests.support.study.made import floor
from tests.support.study.report.made import COLLIDED, STUCK, drive, row, trials

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
