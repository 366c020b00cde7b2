"""The paper's claims: the same rule confirms, refutes or leaves open, whatever the trials are."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from robot.core import states
from study.report.charts.drives import Drive, Pose
from study.report.page import figures_of
from study.report.paper import runs as paper_runs
from study.report.paper.claims import CONFIRMED, REFUTED, UNCLEAR, Claim, claims
from study.report.paper.runs import (
    PLACES,
    TRAPS,
    Runs,
    deviation_m,
    figure_trials,
    left_of_deviation,
    run_paper,
    trap_trials,
    turn_left_deg,
    ways,
)
from study.report.paper.section import claims_table, paper_section
from study.report.trials import trials_of
from study.runner.rows import SCHEMA, TrialRow
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
    (one,) = [one for one in found if words in one.says]
    return one.verdict


def twenty(path: Sequence[Pose], asked: dict[str, Any]) -> list[Drive]:
    return [drive(path, seed=seed, **asked) for seed in range(20)]


def runs(bugs: Sequence[Pose], vgm: Sequence[Pose]) -> Runs:
    figures = [one for bug in BUGS for one in twenty(bugs, bug)]
    return Runs((*figures, *twenty(vgm, {"navigator": "vgm"})), ())


def in_family(family: str, good: int, of: int, **asked: str) -> list[TrialRow]:
    return [
        row(family=family, world=f"{family}_1_{n:03d}", **asked, **({} if n < good else STUCK))
        for n in range(of)
    ]


def test_heading_straight_for_the_goal_leaves_half_of_the_deviation_half_way() -> None:
    assert left_of_deviation(drive(DETOUR_FACTOR)) == pytest.approx(0.5)
    assert left_of_deviation(drive(RETURN)) == pytest.approx(0.0)
    assert deviation_m(drive(DETOUR_FACTOR)) == pytest.approx(0.5)


def test_who_never_deviated_or_never_arrived_has_nothing_to_return_from() -> None:
    assert left_of_deviation(drive([(1.0, 1.0, 0.0), (3.0, 1.05, 0.0)])) is None
    assert left_of_deviation(drive(DETOUR_FACTOR, outcome="stuck")) is None


def test_what_is_left_to_turn_is_counted_from_when_it_only_aligns() -> None:
    goal = replace(floor(far_m=2.0).goal, heading_rad=0.0)
    world = replace(floor(far_m=2.0), goal=goal)
    path = [(1.0, 1.0, 0.0), (3.0, 1.0, 0.7), (3.0, 1.0, 0.1)]
    branches = [states.TO_GOAL, states.ALIGN, states.ALIGN]
    assert turn_left_deg(drive(path, branches, world=world)) == pytest.approx(40.107, abs=1e-3)
    assert turn_left_deg(drive(path, branches)) is None
    assert turn_left_deg(drive(path, branches, world=world, outcome="timeout")) is None


def test_the_same_rule_confirms_and_refutes_a_return_to_the_path() -> None:
    returned = "vgm returns to the original path"
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, RETURN)), returned) == CONFIRMED
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, DETOUR_FACTOR)), returned) == REFUTED
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, RETURN)), "bug does not return") == CONFIRMED
    assert verdict(claims(NONE, runs(RETURN, RETURN)), "bug does not return") == REFUTED


def test_a_longer_way_of_bug_is_confirmed_and_a_shorter_refuted() -> None:
    assert verdict(claims(NONE, runs(LONG, DETOUR_FACTOR)), "not proper") == CONFIRMED
    assert verdict(claims(NONE, runs(DETOUR_FACTOR, LONG)), "not proper") == REFUTED
    assert ways(runs(LONG, LONG), "bug, left", "vgm") == [1.0] * 20


def test_where_the_sides_of_bug_disagree_nothing_is_clear() -> None:
    figures = [*twenty(LONG, BUGS[0]), *twenty(DETOUR_FACTOR, BUGS[1])]
    found = Runs((*figures, *twenty(DETOUR_FACTOR, {"navigator": "vgm"})), ())
    assert verdict(claims(NONE, found), "not proper") == UNCLEAR


@pytest.mark.parametrize(
    ("good", "of", "wanted"), [(120, 120, CONFIRMED), (50, 50, UNCLEAR), (60, 120, REFUTED)]
)
def test_always_needs_a_hundred_trials_without_exception(good: int, of: int, wanted: str) -> None:
    rows = in_family("u_trap", good, of, navigator="vgm")
    found = claims(trials(*rows), Runs())
    assert verdict(found, "whatever the shape") == wanted
    assert verdict(found, "any reachable goal") == wanted


def test_one_failure_in_thousands_neither_confirms_nor_refutes_always() -> None:
    rows = in_family("box", 1999, 2000, navigator="vgm")
    assert verdict(claims(trials(*rows), Runs()), "any reachable goal") == UNCLEAR


def test_what_refutes_is_named_with_world_noise_seed_and_id() -> None:
    rows = in_family("u_trap", 0, 20, navigator="vgm")
    (found,) = [
        one for one in claims(trials(*rows), Runs()) if "whatever the shape" in one.says
    ]  # fmt: skip
    assert found.verdict == REFUTED
    assert f"u_trap_1_000 default seed 0 (`{rows[0].trial_id[:12]}`)" in found.shown


def test_never_is_refuted_by_arrivals_and_confirmed_by_their_absence() -> None:
    said = "never reaches the goal"
    sides = ("left", "right")
    never = [one for s in sides for one in in_family("corner", 0, 100, navigator="bug", side=s)]
    often = [one for s in sides for one in in_family("corner", 50, 60, navigator="bug", side=s)]
    assert verdict(claims(trials(*never), Runs()), said) == CONFIRMED
    assert verdict(claims(trials(*often), Runs()), said) == REFUTED


def test_a_collision_speaks_against_never_colliding() -> None:
    rows = [row(navigator="vgm", world=f"w{n}", **COLLIDED) for n in range(10)]
    assert verdict(claims(trials(*rows), Runs()), "without colliding") == REFUTED


def test_who_dominates_is_decided_by_worlds_against_both_sides() -> None:
    vgm = in_family("box", 20, 20, navigator="vgm", side="left")
    bugs = [in_family("box", 5, 20, navigator="bug", side=side) for side in ("left", "right")]
    assert verdict(claims(trials(*vgm, *bugs[0], *bugs[1]), Runs()), "dominant") == CONFIRMED
    assert verdict(claims(trials(*vgm, *bugs[0]), Runs()), "dominant") == UNCLEAR
    swapped = [in_family("box", 20, 20, navigator="bug", side=side) for side in ("left", "right")]
    worse = in_family("box", 5, 20, navigator="vgm", side="left")
    assert verdict(claims(trials(*worse, *swapped[0], *swapped[1]), Runs()), "dominant") == REFUTED


def test_without_any_trial_every_claim_is_unclear() -> None:
    found = claims(NONE, Runs())
    assert {one.verdict for one in found} == {UNCLEAR}
    assert len(claims_table(found).rows) == len(found) == 10


def test_the_papers_places_are_driven_at_every_noise_and_once_without() -> None:
    found = figure_trials(3)
    assert len(found) == len(PLACES) * 4 * (1 + 3 * 3)
    assert {one.world.name for one in found} == set(PLACES.values())
    assert {one.navigator for one in trap_trials(1)} == {"bug", "vgm"}
    assert {one.world.name for one in trap_trials(1)} == set(TRAPS)


def test_the_papers_figures_are_redone_and_shown_with_every_drive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(paper_runs, "TRAPS", ())
    found = run_paper(1, seeds=1)
    assert len(found.figures) == len(PLACES) * 4 * 4
    section = paper_section(NONE, found)
    assert [part.title for part in section.parts] == ["Claims", "Figures 11, 12 and 13"]
    drawn = [one.drawing.says for one in figures_of([section])]
    assert [says.partition(":")[0] for says in drawn] == [
        *("Figure 11 redone", "Figure 12 redone", "Figure 13 redone"),
    ]
    assert run_paper(1, seeds=0) == Runs()
