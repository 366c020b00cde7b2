"""Findings: properties, their evaluation and monitor, and the committed ones."""

import os
from dataclasses import replace
from functools import cache
from html import escape
from math import inf, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from _pytest.mark.structures import ParameterSet

import study.falsify
from checks.harness.messages import make
from checks.site.findings import renewed
from plant.corpus import generate
from plant.corpus.generate import ADVERSARIAL_MARGIN_M
from plant.model.configuration import body_of
from plant.shortest_path import shortest_path_m
from protocol.outcome import RunOutcome
from protocol.wire.messages import GroundTruth
from protocol.wire.reasons import Reason
from protocol.world import GoalPose, Obstacle, Polyline, World, WorldCircle
from robot.core import states
from robot.core.navigators import proof as proofs
from runtime.errors import UserError
from study.falsify.evaluate import Monitor, Subject, evaluate, kind_of, nearest_thing, sonar_towards
from study.falsify.findings import (
    MAX_SHIFT_M,
    MAX_TURN_RAD,
    Finding,
    SearchProgress,
    finding_of,
    near,
    picture,
    read_finding,
    sentence_of,
)
from study.falsify.properties import (
    ELLIPSE,
    LAPS,
    LETTERS,
    START_UP_S,
    Evaluation,
    both_sides_m,
    scores_of,
    time_limit_s,
    violated_by,
)
from study.falsify.search import Search, SearchBudget
from study.falsify.shrink import walls_in
from study.runner.workers import workers
from study.trial.core_loop import CoreLoop
from tests.support.each import each
from tests.support.plant import plain_world
from tests.support.studies import ARRIVED, STUCK_RUN, evaluation_of, search_of

FINDINGS = Path(__file__).parents[3] / "study" / "falsify" / "worlds"


def finding() -> Finding:
    return read_finding(FINDINGS / "fixed" / "b-wedge-claim.toml")


def test_starts_differ_a_little_and_are_drawn_again_alike() -> None:
    one = finding()
    moved = list(near(one, 20))
    assert moved == list(near(one, 20))
    assert moved[:5] == list(near(one, 5))
    starts = {other.world.start for other in moved}
    assert len(starts) == 20
    for start in starts:
        assert abs(start.x_m - one.world.start.x_m) <= MAX_SHIFT_M
        assert abs(start.y_m - one.world.start.y_m) <= MAX_SHIFT_M
        assert abs(start.heading_rad - one.world.start.heading_rad) <= MAX_TURN_RAD
    assert {other.world.goal for other in moved} == {one.world.goal}
    assert [other.seed for other in moved] == [one.seed + k for k in range(20)]


def test_a_start_without_room_is_drawn_again() -> None:
    one = finding()
    start, radius_m = one.world.start, body_of(one.world).radius_m
    wall_x = start.x_m + radius_m + ADVERSARIAL_MARGIN_M + 0.005  # half of the starts are too near
    wall = Polyline(((wall_x, start.y_m - 0.1), (wall_x, start.y_m + 0.1)), 0.01)
    beside = replace(one, world=replace(one.world, obstacles=(*one.world.obstacles, wall)))
    moved = list(near(beside, 20))
    assert len(moved) == 20
    assert all(other.world.start.x_m < start.x_m + 0.001 for other in moved)


def test_a_start_in_a_wall_is_refused_with_the_way_out() -> None:
    one = finding()
    start = one.world.start
    wall = Polyline(((start.x_m, start.y_m), (start.x_m + 0.01, start.y_m)), 0.01)
    inside = replace(one, world=replace(one.world, obstacles=(wall,)))
    with pytest.raises(UserError, match="no room near its start"):
        list(near(inside, 1))


WORLDS = Path(study.falsify.__file__).parent / "worlds"
OPEN, FIXED, PAPER = (sorted((WORLDS / name).glob("*.toml")) for name in ("open", "fixed", "paper"))
EVERY = [*OPEN, *FIXED, *PAPER]
SLOW = (
    "b-double_spiral-claim",
    "b-hairpin-claim",
    "b-interlocking_spirals-claim",
    "b-island_room-claim",
    "b-island_room-claim-turn",
    "b-nested_boxes-claim",
    "b-nested_rings-claim",
    "b-nested_rings-claim-hop",
    "b-symmetric_trap-claim",
    "b-wedge-claim",
    "b-zigzag-claim-ghost",
    "c-double_spiral-contact-passing",
    "c-double_spiral-contact-passing-robot",
    "c-double_spiral-contact-stopped",
    "c-hairpin-contact-passing",
    "c-interlocking_spirals-contact-passing",
    "c-interlocking_spirals-contact-passing-robot",
    "c-interlocking_spirals-contact-stopped",
    "c-symmetric_trap-contact-passing",
    "c-symmetric_trap-contact-stopped-robot",
    "c-nested_rings-contact-passing-robot",
    "c-tight_door-contact-passing",
)
"""Drives of more than 0.4 s, each of the letter and kind of a quicker one."""


def row_of(file: Path) -> ParameterSet:
    marks = pytest.mark.sweep(len(SLOW)) if file.stem in SLOW else ()
    return pytest.param(file, marks=marks, id=f"{file.parent.name}-{file.stem}")


@each("file", EVERY)
def test_finding_states_its_property_and_its_shortest_way(file: Path) -> None:
    finding = read_finding(file)
    assert finding.letter in LETTERS
    assert finding.sentence.endswith(".")
    length_m = shortest_path_m(finding.world)
    assert (length_m is not None) == finding.world.reachable
    assert length_m == pytest.approx(finding.world.shortest_path_m, abs=2e-3)


def test_every_finding_is_in_a_folder_that_is_tested() -> None:
    assert sorted(WORLDS.rglob("*.toml")) == sorted(EVERY)
    assert set(SLOW) <= {file.stem for file in EVERY}


def test_each_letter_and_kind_has_a_quick_drive() -> None:
    quick, slow = (
        {
            (one.letter, one.kind)
            for one in map(read_finding, EVERY)
            if (one.world.name in SLOW) is which
        }
        for which in (False, True)
    )
    assert slow <= quick


@pytest.mark.parametrize("file", [row_of(file) for file in FIXED])
def test_fixed_finding_does_not_fail_again(file: Path) -> None:
    finding = read_finding(file)
    assert finding.fixed, "the line '# fixed: ' with the subject of the commit is missing"
    assert not set(finding.replay().violated) & {finding.letter, "b", "c"}, finding.sentence


@pytest.mark.parametrize("file", [row_of(file) for file in (*PAPER, *OPEN)])
def test_failing_finding_ends_as_its_file_states(file: Path) -> None:
    stored, now = read_finding(file), renewed(file)
    assert now is not None, "it holds now: move the file to fixed/"
    assert (now.kind, now.sentence, now.world.name) == (stored.kind, stored.sentence, file.stem), (
        "run `python -m checks.site.findings`"
    )
    assert now == stored
    assert f"<title>{escape(stored.sentence)}</title>" in file.with_suffix(".svg").read_text()


@each(("navigator", "side"), [("bug", "left"), ("bug", "right"), ("vgm", "left")])
def test_paper_method_has_a_counterexample_of_three_walls(navigator: str, side: str) -> None:
    subjects = [one.subject for one in map(read_finding, PAPER) if walls_in(one.world) <= 3]
    assert (navigator, side) in {(one.navigator, one.side) for one in subjects}
    assert len(subjects) == len(PAPER)


def test_five_classes_of_failure_are_known() -> None:
    known = {(one.letter, one.world.family, one.kind) for one in map(read_finding, (*OPEN, *FIXED))}
    assert len(known) >= 5


FIXED_WORLDS = Path(__file__).parents[3] / "study" / "falsify" / "worlds" / "fixed"
WALL = Polyline(((2.0, 1.0), (2.0, 3.0)), 0.1)
POST = WorldCircle(x_m=3.0, y_m=3.5, radius_m=0.2)
PERSON = WorldCircle(x_m=1.0, y_m=3.0, radius_m=0.2, path_m=((1.0, 3.0), (3.0, 3.0)), speed_m_s=0.5)


def world_of(*obstacles: Obstacle) -> World:
    return plain_world("w", (4.0, 4.0), (0.5, 0.5), (3.0, 1.0), *obstacles)


def truth_at(x_m: float, y_m: float, heading_rad: float = 0.0, time_s: float = 0.0) -> GroundTruth:
    return make(
        GroundTruth,
        time_ns=round(time_s * 1e9),
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        contact=1,
    )


@cache
def contact() -> Evaluation:
    """Drive the paper's Bug into the end of a wall that it sees too late."""
    finding = read_finding(FIXED_WORLDS / "c-symmetric_trap-contact-passing.toml")
    subject = replace(finding.subject, navigator="bug")
    return replace(finding, subject=subject, limit_s=30.0).replay()


@cache
def claim() -> Evaluation:
    """Drive round a closed room of 1.5 m by 1.5 m that holds the goal."""
    room = Polyline(((2.0, 1.0), (3.5, 1.0), (3.5, 2.5), (2.0, 2.5), (2.0, 1.0)), 0.1)
    world = replace(world_of(room), goal=GoalPose(x_m=2.75, y_m=1.75), reachable=False)
    subject = Subject(navigator="vgm_memory", side="left", noise="none", detour=20.0)
    return evaluate(subject, world, 0, 400.0)


@each(
    ("truth", "name", "bearing_rad"),
    [
        (truth_at(1.8, 2.0), "wall 1", 0.0),
        (truth_at(1.8, 2.0, pi / 2.0), "wall 1", -pi / 2.0),
        (truth_at(2.0, 0.8), "the end of wall 1", pi / 2.0),
        (truth_at(3.3, 3.5), "post 2", -pi),
        (truth_at(1.3, 3.0), "person 3", -pi),
        (truth_at(3.5, 3.0, time_s=4.0), "person 3", -pi),
        (truth_at(0.1, 2.0), "the outer wall", -pi),
    ],
)
def test_nearest_thing_has_name_and_bearing(
    truth: GroundTruth, name: str, bearing_rad: float
) -> None:
    found = nearest_thing(world_of(WALL, POST, PERSON), truth)
    assert found[0] == name
    assert found[1] == pytest.approx(bearing_rad)


def test_closed_wall_has_no_end() -> None:
    closed = Polyline(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 1.0)))
    assert nearest_thing(world_of(closed), truth_at(0.9, 1.0))[0] == "wall 1"


def test_no_sonar_points_behind_the_robot() -> None:
    assert [sonar_towards(bearing_rad) for bearing_rad in (-1.5, 0.1, 1.5)] == [0, 4, 7]
    assert sonar_towards(1.6) is sonar_towards(pi) is None


def test_contact_has_speed_and_last_echo() -> None:
    found = contact().contact
    assert found is not None
    assert found.touched == "the end of wall 1"
    assert 0.05 < found.speed_m_s <= 0.5
    assert found.is_in_view
    assert found.range_m is not None
    assert 0.0 < found.range_m < inf
    assert found.age_s is not None
    assert 0.05 <= found.age_s < 1.0  # a tick before the contact, or earlier
    sentence = sentence_of("c", "bug", contact())
    assert f"bug touches the end of wall 1 at {found.speed_m_s:.2f} m/s" in sentence
    assert f"last measured {found.range_m:.2f} m, {found.age_s:.2f} s before" in sentence


def test_contact_out_of_view_is_told_from_one_without_echo() -> None:
    made = contact().contact
    assert made is not None
    behind = replace(contact(), contact=made._replace(is_in_view=False))
    assert "where no sonar points" in sentence_of("c", "bug", behind)
    silent = replace(contact(), contact=made._replace(range_m=None, age_s=None))
    assert "had measured no echo" in sentence_of("c", "bug", silent)
    assert "touches something" in sentence_of("c", "bug", replace(contact(), contact=None))


def test_claim_has_the_last_lap_and_the_doubt() -> None:
    result = claim()
    assert result.kind == "claim"
    assert result.lap is not None
    # The way round the room at a few centimetres from it is longer than its four sides.
    assert 6.0 < result.lap.length_m < 1.5 * 6.0
    assert result.outcome.doubt_m is not None
    assert (
        f"with a lap of {result.lap.length_m:.1f} m with no gap in the chain of echoes and a"
        f" position doubt of {result.outcome.doubt_m:.2f} m"
    ) in sentence_of("b", "vgm_memory", result)


def test_gaps_of_a_lap_are_counted_until_the_next_mark() -> None:
    monitor, proof = Monitor(), proofs.Proof()
    onboard = cast("CoreLoop", SimpleNamespace(state=SimpleNamespace(memory=holder_of(proof))))
    hop = (proofs.WAITING, proofs.HOPPED)
    for way_mm, gap in enumerate((proofs.NO_GAP, *hop, proofs.HOPPED, *hop), 1):
        proof.way_mm, proof.gap = way_mm, gap
        monitor._watch_lap(onboard)
    assert monitor.lap == (0.006, 2)
    proof.way_mm, proof.gap = 2, proofs.NO_GAP
    monitor._watch_lap(onboard)
    assert monitor.lap == (0.002, 0)


def test_navigator_without_proofs_has_no_lap() -> None:
    assert contact().lap is None


def holder_of(proof: proofs.Proof) -> Any:
    return SimpleNamespace(proof=proof)


SUBJECT = Subject(navigator="vgm_memory", side="left", noise="none", detour=20.0)


def watched(moved_m: float = 0.0, branch: int = states.NO_BRANCH) -> Monitor:
    monitor = Monitor()
    monitor.places = [(0.0, 0.0), (moved_m, 0.0)]
    monitor.contact_branch = branch
    return monitor


@each(
    ("outcome", "reason", "monitor", "kind"),
    [
        (ARRIVED, Reason.NONE, watched(), "reached"),
        (STUCK_RUN, Reason.UNREACHABLE, watched(), "claim"),
        (STUCK_RUN, Reason.LOST, watched(), "lost"),
        (STUCK_RUN, Reason.NO_PROGRESS, watched(), "no-progress"),
        (replace(STUCK_RUN, outcome="timeout"), 0, watched(0.1), "timeout-still"),
        (replace(STUCK_RUN, outcome="timeout"), 0, watched(2.0), "timeout-moving"),
    ],
)
def test_kind_of_end_is_named(
    outcome: RunOutcome, reason: int, monitor: Monitor, kind: str
) -> None:
    assert kind_of(outcome, reason, monitor) == kind


@each(
    ("branch", "kind"),
    [
        (states.TO_GOAL, "contact-to-goal"),
        (states.PASS_RIGHT, "contact-passing"),
        (states.NO_BRANCH, "contact-stopped"),
    ],
)
def test_contact_is_named_by_the_branch_before_it(branch: int, kind: str) -> None:
    collided = replace(STUCK_RUN, outcome="collided", own_contacts=1)
    assert kind_of(collided, Reason.BUMPER, watched(0.0, branch)) == kind


def test_evaluation_of_an_easy_world_violates_nothing() -> None:
    world = generate("wedge", 1, 1)
    result = evaluate(SUBJECT, replace(world, obstacles=()), 0, 120.0)
    assert result.kind == "reached"
    assert result.violated == ""
    assert result.nearest_goal_m < 0.3
    assert result.mahalanobis2 < 23.0


@each("letter", LETTERS)
def test_sentence_names_navigator_and_numbers(letter: str) -> None:
    sentence = sentence_of(letter, "vgm", evaluation_of("blocked"))
    assert "vgm" in sentence
    assert "6.0 m" in sentence
    assert sentence.endswith(".")
    assert sentence.count(". ") == 0


def test_picture_has_the_walls_and_the_way() -> None:
    finding = finding_of(SUBJECT, "a", evaluation_of("blocked"), 5.0, "found")
    drawn = picture(finding)
    assert drawn.startswith("<svg")
    assert drawn.count('class="solid"') >= 2
    assert "way l-vgm_memory" in drawn


def test_death_of_a_worker_is_an_error_with_advice(tmp_path: Path) -> None:
    search = Search(search_of("vgm"), tmp_path, SearchProgress(), lambda: 0.0)
    with workers(1, None) as pool:
        search.running[pool.executor.submit(os._exit, 1)] = "class"
        steps = search.run(pool, SearchBudget(trials=0))
        with pytest.raises(UserError, match="a worker process died"):
            list(steps)


def test_workers_end_with_their_context() -> None:
    with workers(1, None) as pool:
        number = pool.executor.submit(os.getpid).result()
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


WORLD = plain_world("w", (4.0, 3.0), (1.0, 1.0), (3.0, 1.0), shortest_path_m=3.0, reachable=True)


@each(
    ("outcome", "reason", "reachable", "letters"),
    [
        (ARRIVED, Reason.NONE, True, ""),
        (STUCK_RUN, Reason.BLOCKED, True, "a"),
        (STUCK_RUN, Reason.LOST, True, "a"),
        (replace(ARRIVED, outcome="timeout"), Reason.NONE, True, "a"),
        (STUCK_RUN, Reason.UNREACHABLE, True, "b"),
        (STUCK_RUN, Reason.UNREACHABLE, False, ""),
        (replace(ARRIVED, outcome="collided", own_contacts=1), Reason.NONE, True, "c"),
        (replace(ARRIVED, contacts=1), Reason.NONE, True, ""),
        (replace(ARRIVED, path_m=31.0), Reason.NONE, True, "e"),
        (STUCK_RUN, Reason.LOST, False, "f"),
        (replace(ARRIVED, outcome="timeout"), Reason.NONE, False, "f"),
    ],
)
def test_end_of_a_trial_violates_its_property(
    outcome: RunOutcome, reason: int, reachable: bool, letters: str
) -> None:
    assert violated_by(outcome, reason, 1.0, 10.0, reachable=reachable) == letters


def test_error_outside_the_ellipse_violates_d() -> None:
    assert violated_by(ARRIVED, 0, ELLIPSE * 0.99, 10.0, reachable=True) == ""
    assert violated_by(ARRIVED, 0, ELLIPSE * 1.01, 10.0, reachable=True) == "d"


def test_every_property_has_a_score() -> None:
    for reachable in (True, False):
        scores = scores_of(ARRIVED, 2.0, 60.0, reachable=reachable)
        assert "".join(sorted(scores)) == LETTERS
    assert scores_of(ARRIVED, 2.0, 60.0, reachable=True)["a"] == 0.5
    assert scores_of(ARRIVED, 2.0, 60.0, reachable=True)["e"] == 2.0
    assert scores_of(ARRIVED, 2.0, 60.0, reachable=False)["a"] == float("-inf")


def test_nearer_wall_has_a_higher_score() -> None:
    near, far = (
        scores_of(replace(ARRIVED, min_clearance_m=m), 2.0, 60.0, reachable=True)["c"]
        for m in (0.01, 0.1)
    )
    assert near > far


def test_both_sides_of_walls_count() -> None:
    wall = Polyline(((1.0, 2.0), (2.0, 2.0)))
    post = WorldCircle(x_m=3.0, y_m=2.0, radius_m=0.5)
    assert both_sides_m(WORLD) == 14.0
    assert both_sides_m(replace(WORLD, obstacles=(wall, post))) == pytest.approx(
        16.0 + 3.14159, abs=1e-4
    )


def test_time_limit_grows_with_way_and_slowness() -> None:
    assert time_limit_s(WORLD) == round(START_UP_S + 25.0 * 3.0 / 0.3)
    slow = replace(WORLD, robot={"max_speed_m_s": 0.15})
    assert time_limit_s(slow) == round(START_UP_S + 25.0 * 3.0 / 0.15)


def test_time_limit_without_a_way_is_of_laps() -> None:
    sealed = replace(WORLD, shortest_path_m=None, reachable=False)
    assert time_limit_s(sealed) == round(START_UP_S + LAPS * 14.0 / 0.3)
