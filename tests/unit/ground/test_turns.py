"""Turning points: none is missed, and those that decided a run are named."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ground.explain import MANY, Why, explained
from ground.station.history.decision_history import AT_ONCE
from protocol.wire.codec import decode
from protocol.wire.enums import Branch
from protocol.wire.messages import AvoidanceDecision
from protocol.wire.reasons import Reason
from runtime.units import PERIOD_NS as TICK_NS
from tests.support.ground.recordings import Recording, Show, box, decided, turning_points


@pytest.fixture(scope="module")
def run() -> Recording:
    return box()[0]


@pytest.fixture
def show(run: Recording, tmp_path: Path) -> Iterator[Show]:
    shown = Show(run, tmp_path, 0.0)
    yield shown
    asyncio.run(shown.station.close())


def of_the_run(run: Recording, until_s: float) -> list[str]:
    """Return the turning points until `until_s`."""
    messages = (decode(one.frame).message for one in run.found)
    decisions = [one for one in messages if isinstance(one, AvoidanceDecision)]
    return [
        point.words for point in turning_points(decisions) if point.time_ns <= until_s * 1e9 + 1
    ]


@pytest.mark.parametrize("step_s", [0.05, 0.4, 7.0, 30.0])
def test_no_turning_point_is_missed_at_any_poll_rate(
    run: Recording, show: Show, step_s: float
) -> None:
    why, at_s = Why(), 0.0
    while at_s < 30.0:
        why.look(show.station)
        at_s += step_s
        show.go(at_s)
        why.look(show.station)
        why.look(show.station)
    assert [point.words for point in why.points] == of_the_run(run, 30.0)


def test_each_is_explained_with_what_was_known_then(show: Show) -> None:
    why = Why()
    show.go(8.0)
    why.look(show.station)
    turned = why.at()
    assert turned is not None
    found = explained(turned, show.station)
    assert turned.point.words in found.lines[-1]
    assert any(line.startswith("state    ACTIVE AUTO") for line in found.lines)
    assert any(line.startswith("cycle") for line in found.lines)


def test_a_recording_that_is_turned_back_forgets_what_is_not_yet(
    run: Recording, show: Show
) -> None:
    why = Why()
    show.go(20.0)
    why.look(show.station)
    show.bus.rewind()
    show.open()
    show.go(7.3)
    why.look(show.station)
    assert [point.words for point in why.points] == of_the_run(run, 7.3)
    show.go(20.0)
    why.look(show.station)
    assert [point.words for point in why.points] == of_the_run(run, 20.0)


class Stage:
    """A station that has just these decisions."""

    def __init__(self, *branches: Branch) -> None:
        self.robot = "r1"
        self.now_ns = 10**12
        self.said = [
            (tick + 1, decided(time_ns=tick, branch=branch)) for tick, branch in enumerate(branches)
        ]

    def decisions(self, after_ns: int) -> list[tuple[int, AvoidanceDecision]]:
        return [pair for pair in self.said if pair[0] > after_ns][-MANY:]

    def moment(self, time_ns: int | None = None) -> None:
        return None


def stage_of(*branches: Branch) -> Any:
    """Return a stage in place of a station."""
    return Stage(*branches)


def test_one_key_goes_back_turn_by_turn_and_stops_at_the_first() -> None:
    why = Why(most=2)
    assert why.at() is None
    why.look(stage_of(Branch.TO_GOAL, Branch.PASS_LEFT, Branch.TO_GOAL, Branch.PASS_RIGHT))
    words = [None if (found := why.at(back)) is None else found.point.words for back in range(3)]
    assert words == [
        "goes for the goal -> passes on the right",
        "passes on the left -> goes for the goal",
        None,
    ]
    assert why.at(-1) is None


def test_another_robot_begins_anew() -> None:
    why, stage = Why(), stage_of(Branch.TO_GOAL, Branch.PASS_LEFT)
    why.look(stage)
    stage.robot = "r2"
    stage.said = [(1, decided(branch=Branch.PASS_RIGHT))]
    why.look(stage)
    assert why.points == []


def test_turn_with_expired_details_is_still_explained() -> None:
    why, stage = Why(), stage_of(Branch.TO_GOAL, Branch.PASS_LEFT)
    why.look(stage)
    turned = why.at()
    assert turned is not None
    assert "so it passes on the left" in explained(turned, stage).headline


def test_skipped_decisions_create_no_turning_point() -> None:
    """Overflow the batch: the first decision after a gap is not compared with older ones."""
    assert MANY == AT_ONCE
    why, stage = Why(), stage_of(Branch.TO_GOAL)
    why.look(stage)
    stage.said += [
        (tick, decided(time_ns=tick, branch=Branch.PASS_LEFT)) for tick in range(2, 4000)
    ]
    why.look(stage)
    assert why.points == []


def decisions_of(*branches: Branch, guard: int = 0) -> list[AvoidanceDecision]:
    return [
        decided(time_ns=tick * TICK_NS, branch=branch, guard=guard)
        for tick, branch in enumerate(branches)
    ]


def test_a_run_in_which_nothing_changes_has_no_turning_point() -> None:
    assert turning_points([]) == []
    assert turning_points(decisions_of(Branch.TO_GOAL)) == []
    assert turning_points(decisions_of(Branch.TO_GOAL, Branch.TO_GOAL)) == []


def test_each_change_of_branch_and_side_is_one_with_its_stamp_and_words() -> None:
    points = turning_points(
        decisions_of(Branch.TO_GOAL, Branch.PASS_LEFT, Branch.PASS_LEFT, Branch.PASS_RIGHT)
    )
    assert [(point.time_ns // TICK_NS, point.words) for point in points] == [
        (1, "goes for the goal -> passes on the left"),
        (3, "changes the side: passes on the left -> passes on the right"),
    ]


def test_the_guard_is_one_too() -> None:
    free, slowed = decisions_of(Branch.TO_GOAL), decisions_of(Branch.TO_GOAL, guard=Reason.SLOWED)
    (point,) = turning_points(free + slowed)
    assert point.words == "guard: nothing -> slowed for an obstacle"
    assert (point.previous, point.decision) == (free[0], slowed[0])
