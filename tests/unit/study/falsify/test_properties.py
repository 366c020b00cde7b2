"""Properties: which end of a trial violates which, and the time that a trial is given."""

from dataclasses import replace

import pytest

from protocol.outcome import Outcome
from protocol.wire.reasons import Reason
from protocol.world import Circle, GoalPose, Polyline, Start, World
from study.falsify.properties import (
    ELLIPSE,
    LAPS,
    LETTERS,
    START_UP_S,
    both_sides_m,
    scores_of,
    time_limit_s,
    violated_by,
)
from tests.support.each import each
from tests.unit.study.falsify.outcomes import ARRIVED, STUCK

WORLD = World(
    name="w",
    size_m=(4.0, 3.0),
    start=Start(x_m=1.0, y_m=1.0),
    goal=GoalPose(x_m=3.0, y_m=1.0),
    shortest_path_m=3.0,
    reachable=True,
)


@each(
    ("outcome", "reason", "reachable", "letters"),
    [
        (ARRIVED, Reason.NONE, True, ""),
        (STUCK, Reason.BLOCKED, True, "a"),
        (STUCK, Reason.LOST, True, "a"),
        (replace(ARRIVED, outcome="timeout"), Reason.NONE, True, "a"),
        (STUCK, Reason.UNREACHABLE, True, "b"),
        (STUCK, Reason.UNREACHABLE, False, ""),
        (replace(ARRIVED, outcome="collided", own_contacts=1), Reason.NONE, True, "c"),
        (replace(ARRIVED, contacts=1), Reason.NONE, True, ""),
        (replace(ARRIVED, path_m=31.0), Reason.NONE, True, "e"),
        (STUCK, Reason.LOST, False, "f"),
        (replace(ARRIVED, outcome="timeout"), Reason.NONE, False, "f"),
    ],
)
def test_end_of_a_trial_violates_its_property(
    outcome: Outcome, reason: int, reachable: bool, letters: str
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
    post = Circle(x_m=3.0, y_m=2.0, radius_m=0.5)
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
