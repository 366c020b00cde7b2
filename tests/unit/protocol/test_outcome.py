"""Evaluation of a run; every way of running prints the same keys."""

import json
import re
from dataclasses import replace
from math import pi

import pytest

from protocol.outcome import (
    OUTCOMES,
    RunEnd,
    RunOutcome,
    RunSettings,
    WireGoal,
    detail_of,
    end_of,
    evaluated,
    goal_end,
)
from protocol.wire.enums import GoalState
from protocol.wire.messages import RunScore
from protocol.wire.reasons import Reason, reason_text
from tests.support.each import each

KEYS = [
    "world",
    "navigator",
    "seed",
    "noise",
    "wall_s",
    "outcome",
    "reason",
    "time_s",
    "path_m",
    "shortest_path_m",
    "position_error_m",
    "heading_error_rad",
    "estimated_position_error_m",
    "min_clearance_m",
    "contacts",
    "own_contacts",
    "ticks",
    "missed_ticks",
    "digest",
    "doubt_m",
]


def touches(contacts: int, own_contacts: int) -> RunScore:
    return RunScore(
        time_ns=20_000_000_000,
        ticks=400,
        contacts=contacts,
        own_contacts=own_contacts,
        x_m=5.03,
        y_m=2.04,
        heading_rad=-pi + 0.01,
        path_m=4.9,
        min_clearance_m=0.11,
        digest=tuple(range(32)),
    )


def end(state: int, reason: int = 0, doubt_m: float | None = None) -> RunEnd:
    return RunEnd(
        goal_state=state,
        goal_reason=reason,
        time_s=20.0,
        estimate_x_m=5.03,
        estimate_y_m=2.04,
        wall_s=0.05,
        doubt_m=doubt_m,
    )


def run(heading_rad: float | None = pi, contacts: int = 0, own_contacts: int = 0) -> RunOutcome:
    asked = RunSettings(
        world="box",
        navigator="vgm",
        seed=7,
        noise="default",
        goal_x_m=5.0,
        goal_y_m=2.0,
        goal_heading_rad=heading_rad,
        wire_goal=WireGoal(5000, 2000, 0, 0, 50, 52360),
        shortest_path_m=4.4,
        timeout_s=60.0,
    )
    ended = end(GoalState.REACHED, doubt_m=0.12)
    return evaluated(asked, ended, touches(contacts, own_contacts))


def test_outcome_keys_and_their_order_are_fixed() -> None:
    assert list(run().as_json()) == KEYS
    assert json.loads(json.dumps(run().as_json()))["digest"].startswith("000102")


def test_errors_compare_truth_and_estimate_with_the_goal() -> None:
    outcome = run()
    assert outcome.position_error_m == pytest.approx(0.05)
    assert outcome.estimated_position_error_m == pytest.approx(0.05)
    assert outcome.heading_error_rad == pytest.approx(0.01)  # across the seam, not 2 pi


def test_a_free_heading_has_no_error() -> None:
    assert run(heading_rad=None).heading_error_rad is None
    assert "deg" not in run(heading_rad=None).text()


def test_text_begins_with_the_outcome_and_is_short() -> None:
    lines = run().text().splitlines()
    assert re.match(r"reached the goal of \w+ with \w+ in [\d.]+ s\Z", lines[0])
    assert lines[2].endswith(" 0.050 m and 0.6 deg")
    assert max(map(len, lines[1:-1])) <= 40
    assert lines[-1].endswith(run().digest)
    touched = run(contacts=2, own_contacts=1).text().splitlines()
    assert touched[0].startswith("collided in ")
    assert touched[0].endswith(": touched something 2 times; reached")
    assert touched[4].endswith("contacts 2 (1 own)")


def test_own_contact_makes_a_collision_even_at_the_goal() -> None:
    outcome = run(contacts=2, own_contacts=1)
    assert (outcome.outcome, outcome.reached) == ("collided", False)
    assert outcome.reason == "touched something 2 times; reached"


def test_being_run_into_counts_as_contact_not_collision() -> None:
    outcome = run(contacts=2)
    assert (outcome.outcome, outcome.contacts, outcome.own_contacts) == ("reached", 2, 0)
    assert outcome.reason == "ok; was touched 2 times"
    bumped = end_of(touches(1, 0), end(GoalState.ABORTED, Reason.BUMPER), 60.0)
    assert bumped == ("aborted", "bumper contact; was touched once")
    late = end_of(touches(1, 0), end(GoalState.DRIVING), 60.0)
    assert late == ("timeout", "not there after 60 s; was touched once")


@each(
    ("state", "reason", "outcome", "words"),
    [
        (GoalState.REACHED, Reason.NONE, "reached", "ok"),
        (GoalState.STUCK, Reason.BLOCKED, "stuck", "has not moved although it tries to"),
        (GoalState.STUCK, Reason.NO_PROGRESS, "stuck", "has come no closer for too long"),
        (GoalState.STUCK, Reason.UNREACHABLE, "unreachable", reason_text(Reason.UNREACHABLE)),
        (GoalState.ABORTED, Reason.SCAN_LOST, "aborted", "no fresh sonar scan for 250 ms"),
        (GoalState.AVOIDING, Reason.NONE, "timeout", "not there after 60 s"),
        (GoalState.REFUSED, Reason.NOT_ARMED, "aborted", "not armed: arm first"),
    ],
)
def test_each_end_state_has_an_outcome_and_a_reason(
    state: GoalState, reason: Reason, outcome: str, words: str
) -> None:
    assert end_of(touches(0, 0), end(state, reason), 60.0) == (outcome, words)
    assert goal_end(state, reason) in (outcome, None)


@each(("doubt_m", "words"), [(0.424, "0.42 m"), (None, "unknown")])
def test_lost_outcome_ends_with_the_doubt(doubt_m: float | None, words: str) -> None:
    outcome, reason = end_of(touches(0, 0), end(GoalState.STUCK, Reason.LOST, doubt_m), 60.0)
    assert outcome == "lost"
    assert reason == f"{reason_text(Reason.LOST)}; position doubt {words}"


def test_headline_names_the_outcome_once() -> None:
    assert detail_of("lost", "lost: found no way") == "found no way"
    assert detail_of("stuck", "has not moved") == "has not moved"
    found = replace(run(), outcome="unreachable", reason=reason_text(Reason.UNREACHABLE))
    assert found.text().splitlines()[0].count("unreachable") == 1


def test_only_a_stuck_goal_makes_a_claim() -> None:
    states = [state for state in GoalState if goal_end(state, Reason.LOST) == "lost"]
    assert states == [GoalState.STUCK]
    assert goal_end(99, Reason.LOST) is None


def test_any_state_gives_one_of_the_outcomes() -> None:
    ends = {
        end_of(touches(1, own), end(state, reason), 1.0)[0]
        for state in GoalState
        for reason in Reason
        for own in (0, 1)
    }
    assert ends == set(OUTCOMES)


def test_bump_that_stopped_the_robot_names_both_causes() -> None:
    assert end_of(touches(1, 1), end(GoalState.ABORTED, Reason.BUMPER), 60.0) == (
        "collided",
        "touched something once; bumper contact",
    )
