"""The observer of contradictions: it believes what is so, and finds each defect of words."""

from typing import Final, NamedTuple

from checks.simulation.contradictions.persons import (
    APP,
    DEFECTS,
    NOTEBOOK,
    UP,
    contradictions_of,
    draw_persons,
    observe,
)
from checks.simulation.hosts.mavlink import GATEWAY
from checks.simulation.hosts.virtual_time import Argument, Event, EventScenario
from tests.support.each import each

SAME_PERSON, OTHER, THIRD = "ada-t1", "bea-t2", "bea-t3"
FIRST, SECOND = "client-255", "client-254"
OUTCOME: Final = "an outcome is of the goal that was asked for"
CODE: Final = "an exit code is of the goal that was asked for"
Deed = tuple[float, str, *tuple[Argument, ...]]


def scenario(*deeds: Deed, seed: int = 1, seconds: int = 14) -> EventScenario:
    """Return a scenario of deeds, each given by its time in s, its verb, program and arguments."""
    given = [Event(round(s * 1e9), verb, tuple(rest), 0) for s, verb, *rest in deeds]
    return EventScenario(seed, seconds * 1_000_000_000, tuple(given))


class Case(NamedTuple):
    """The deeds that show a defect, and the rule that they break."""

    deeds: tuple[Deed, ...]
    rule: str
    seed: int = 1


REPLACED: Final[tuple[Deed, ...]] = (
    (0.5, "up", UP, 33.0, 30.0),
    (4.0, "goto", OTHER, 30.6, 30.3),
)
STATIONS: Final[tuple[Deed, ...]] = (
    (0.2, "gateway", GATEWAY),
    (0.4, "start", FIRST),
    (0.4, "start", SECOND),
    (2.0, "arm", FIRST),
)
IN_APP: Final[tuple[Deed, ...]] = ((0.5, "start", APP), (2.0, "goto", APP, 36.0, 30.0))
IN_NOTEBOOK: Final[tuple[Deed, ...]] = ((0.5, "start", NOTEBOOK),)
CASES: Final[dict[str, Case]] = {
    "c1": Case(REPLACED, OUTCOME),
    "c2": Case(
        (
            *IN_NOTEBOOK,
            (2.0, "goto", NOTEBOOK, 36.0, 30.0),
            (5.0, "then", NOTEBOOK, "goto", 30.4, 30.2),
        ),
        "what stops has a cause",
    ),
    "c3": Case((*IN_APP, (6.0, "hold", OTHER)), "a refusal has a reason"),
    "c4": Case(REPLACED, CODE),
    "c5": Case((*IN_APP, (6.0, "goto", SAME_PERSON, 30.4, 30.2)), "a text is true"),
    "c6": Case((*IN_APP, (6.0, "cut", APP, 5000)), "a text is true", seed=9),
    "c7": Case(
        (*STATIONS, (2.5, "stop", SECOND), (3.0, "arm", FIRST)), "what is acknowledged is so"
    ),
    "c8": Case((*STATIONS, (3.0, "restart", FIRST), (4.2, "arm", FIRST)), "a text is true"),
    "c9": Case(
        (
            *IN_NOTEBOOK,
            (1.5, "mission", NOTEBOOK, 36.0, 30.0),
            (5.0, "drive", SAME_PERSON, 0.2, 0.0, 1.0),
        ),
        "a mission ends as it ended",
    ),
    "c10": Case(
        (*IN_NOTEBOOK, (2.0, "goto", NOTEBOOK, 36.0, 30.0), (5.0, "abort", OTHER)),
        OUTCOME,
    ),
    "c12": Case(
        (
            (1.0, "drive", OTHER, 0.2, 0.0, 4.0),
            (3.0, "drive", THIRD, 0.2, 0.5, 1.0),
        ),
        "a drive by hand ends as it ended",
    ),
    "c13": Case(
        (
            *STATIONS,
            (3.0, "seize", OTHER),
            (3.5, "goto", OTHER, 36.0, 30.0),
            (6.0, "disarm", SECOND, 0),
        ),
        OUTCOME,
    ),
    "c11": Case((*IN_NOTEBOOK, (5.0, "clear", SAME_PERSON)), "what is accepted is so"),
}


@each("defect", DEFECTS)
def test_defect_of_words_that_is_put_back_is_found(defect: str) -> None:
    case = CASES[defect]
    drawn = scenario(*case.deeds, seed=case.seed)
    assert not contradictions_of(drawn)
    found = {one.invariant for one in contradictions_of(drawn, defect)}
    assert case.rule in found


@each("seed", range(8))
def test_first_seeds_hold_no_contradiction(seed: int) -> None:
    assert not contradictions_of(draw_persons(seed))


FALSE_ONCE: Final[dict[str, tuple[Deed, ...]]] = {
    "nobody is in command any more": (
        (0.3, "start", APP),
        (3.0, "goto", OTHER, 31.4, 29.8),
        (6.0, "cancel", OTHER),
    ),
    "a drive by hand is over while its line is cut": (
        (0.3, "start", APP),
        (2.0, "drive", APP, 0.2, 0.0, 2.0),
        (3.9, "cut", APP, 6000),
    ),
    "an own stop is shown while another one is pressed": (
        (0.3, "start", APP),
        (3.0, "estop", APP),
        (4.01, "estop", APP),
    ),
    "the goal of up is refused": (
        (0.2, "gateway", GATEWAY),
        (0.4, "start", FIRST),
        (0.9, "up", UP, 29.7, 30.3),
        (1.02, "arm", FIRST),
    ),
    "a goal is replaced in the tick of its acceptance": (
        (0.3, "start", NOTEBOOK),
        (1.341, "limited", NOTEBOOK, 36.0, 30.89, 3.0),
        (1.388, "goto", SAME_PERSON, 31.41, 29.98),
        (1.668, "goto", NOTEBOOK, 30.32, 30.77),
    ),
    "the goal of up is replaced in the tick of its acceptance": (
        (0.3, "start", NOTEBOOK),
        (0.875, "goto", NOTEBOOK, 29.74, 29.56),
        (0.897, "up", UP, 30.31, 29.96),
    ),
    "the person has seized the lease since": (
        (0.3, "start", NOTEBOOK),
        (3.952, "take", NOTEBOOK),
        (4.953, "release", OTHER),
        (5.46, "seize", OTHER),
    ),
    "the robot is heard again while its goal is aborted": (
        (0.3, "start", NOTEBOOK),
        (2.97, "goto", NOTEBOOK, 31.01, 29.36),
        (5.331, "cut", NOTEBOOK, 3000),
    ),
    "the goal is reached while nothing is heard": (
        (0.3, "start", NOTEBOOK),
        (8.318, "goto", NOTEBOOK, 30.08, 29.75),
        (11.23, "cut", NOTEBOOK, 3000),
    ),
}
"""Words that the observer has found to be false, each by its fewest deeds."""


@each("what", FALSE_ONCE)
def test_words_that_were_false_are_true(what: str) -> None:
    assert not contradictions_of(scenario(*FALSE_ONCE[what], seconds=18))


def test_truth_of_one_person_holds_no_contradiction() -> None:
    result = observe(
        scenario(
            (0.5, "start", NOTEBOOK),
            (0.5, "start", APP),
            (1.5, "goto", NOTEBOOK, 30.4, 30.0),
            (8.0, "hold", OTHER),
        )
    )
    assert result.violation is None
    said = result.coverage.reached
    assert said["GoalEnded"] == said["Recorded"] == said["Accepted"] == 1
    assert said["LeaseView"] > 1


def test_run_of_persons_is_the_same_again() -> None:
    assert observe(draw_persons(3)).digest == observe(draw_persons(3)).digest
