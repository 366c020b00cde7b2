"""Evaluation of a run; every way of running prints the same keys."""

import json
import re
from math import pi

import pytest

from protocol.outcome import OUTCOMES, Outcome, RunEnd, RunSettings, end_of, evaluated
from protocol.wire.enums import GoalState
from protocol.wire.goal import WireGoal
from protocol.wire.messages import RunScore
from protocol.wire.reasons import Reason

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


def run(heading_rad: float | None = pi, contacts: int = 0, own_contacts: int = 0) -> Outcome:
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
    ended = RunEnd(
        goal_state=GoalState.REACHED,
        goal_reason=0,
        time_s=20.0,
        estimate_x_m=5.03,
        estimate_y_m=2.04,
        wall_s=0.05,
    )
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
    bumped = end_of(touches(1, 0), GoalState.ABORTED, Reason.BUMPER, 60.0)
    assert bumped == ("aborted", "bumper contact; was touched once")
    late = end_of(touches(1, 0), GoalState.DRIVING, Reason.NONE, 60.0)
    assert late == ("timeout", "not there after 60 s; was touched once")


@pytest.mark.parametrize(
    ("state", "reason", "end", "words"),
    [
        (GoalState.REACHED, Reason.NONE, "reached", "ok"),
        (GoalState.STUCK, Reason.BLOCKED, "stuck", "has not moved although it tries to"),
        (GoalState.ABORTED, Reason.SCAN_LOST, "aborted", "no fresh sonar scan for 250 ms"),
        (GoalState.AVOIDING, Reason.NONE, "timeout", "not there after 60 s"),
        (GoalState.REFUSED, Reason.NOT_ARMED, "aborted", "not armed: arm first"),
    ],
)
def test_each_end_state_has_an_outcome_and_a_reason(
    state: GoalState, reason: Reason, end: str, words: str
) -> None:
    assert end_of(touches(0, 0), state, reason, 60.0) == (end, words)


def test_any_state_gives_one_of_five_outcomes() -> None:
    ends = {end_of(touches(1, own), state, 0, 1.0)[0] for state in GoalState for own in (0, 1)}
    assert ends == set(OUTCOMES)


def test_bump_that_stopped_the_robot_names_both_causes() -> None:
    assert end_of(touches(1, 1), GoalState.ABORTED, Reason.BUMPER, 60.0) == (
        "collided",
        "touched something once; bumper contact",
    )
