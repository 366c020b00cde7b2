"""Searches, findings and outcomes of trials for the tests of the falsifier."""

from dataclasses import replace
from functools import cache

from plant.corpus import generate
from protocol.outcome import Outcome
from study.falsify.climb import SearchCandidate, SearchSettings, Violation, climb
from study.falsify.evaluate import Subject
from study.falsify.properties import Evaluation

ARRIVED = Outcome(
    world="w",
    navigator="vgm",
    seed=0,
    noise="none",
    wall_s=0.1,
    outcome="reached",
    reason="",
    time_s=30.0,
    path_m=6.0,
    shortest_path_m=3.0,
    position_error_m=0.01,
    heading_error_rad=None,
    estimated_position_error_m=0.01,
    min_clearance_m=0.2,
    contacts=0,
    own_contacts=0,
    ticks=600,
    missed_ticks=0,
    digest="",
)
STUCK = replace(ARRIVED, outcome="stuck")


SCENES = ("symmetric_trap", "three_walls", "wedge")


def search_of(navigator: str, properties: str = "abc", seed: int = 1) -> SearchSettings:
    """Return a search in scenes of few walls, without noise; the side may follow a colon."""
    name, _, side = navigator.partition(":")
    subject = Subject(navigator=name, side=side or "left", noise="none", detour=20.0)
    return SearchSettings(subject=subject, properties=properties, families=SCENES, seed=seed)


@cache
def first_violation(settings: SearchSettings, most_trials: int) -> Violation:
    """Return the first violation of a search within a number of trials."""
    number = trials = 0
    while trials < most_trials:
        one = climb(settings, number)
        if one.violations:
            return one.violations[0]
        number, trials = number + 1, trials + one.trials
    raise AssertionError(f"no violation in {trials} trials")


@cache
def evaluation_of(kind: str) -> Evaluation:
    """Return an evaluation of a drive that ended blocked, under any kind."""
    return Evaluation(
        world=generate("wedge", 0, 1),
        seed=3,
        kind=kind,
        violated="a",
        scores={},
        outcome=STUCK,
        goal_reason=60,
        avoidances=2,
        side_changes=1,
        mahalanobis2=0.5,
        nearest_goal_m=1.25,
        contact_branch=0,
        moved_late_m=0.0,
    )


def violation_of(letter: str, kind: str) -> Violation:
    """Return a violation in a wedge."""
    candidate = SearchCandidate("wedge", {"seed": 3.0})
    return Violation(letter=letter, candidate=candidate, evaluation=evaluation_of(kind))
