"""Evaluation: kinds of end, what the monitor records, and the sentence of each property."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from plant.corpus import generate
from protocol.outcome import Outcome
from protocol.wire.reasons import Reason
from robot.core import states
from runtime.errors import UserError
from study.falsify.evaluate import Monitor, Subject, evaluate, kind_of
from study.falsify.findings import SearchProgress, finding_of, picture, sentence_of
from study.falsify.properties import LETTERS
from study.falsify.search import Search, SearchBudget
from study.runner.workers import workers
from tests.support.each import each
from tests.unit.study.falsify.examples import evaluation_of, search_of
from tests.unit.study.falsify.outcomes import ARRIVED, STUCK

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
        (STUCK, Reason.UNREACHABLE, watched(), "claim"),
        (STUCK, Reason.LOST, watched(), "lost"),
        (STUCK, Reason.NO_PROGRESS, watched(), "no-progress"),
        (replace(STUCK, outcome="timeout"), 0, watched(0.1), "timeout-still"),
        (replace(STUCK, outcome="timeout"), 0, watched(2.0), "timeout-moving"),
    ],
)
def test_kind_of_end_is_named(outcome: Outcome, reason: int, monitor: Monitor, kind: str) -> None:
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
    collided = replace(STUCK, outcome="collided", own_contacts=1)
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
