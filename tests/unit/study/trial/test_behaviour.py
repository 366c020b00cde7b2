"""Driving statistics agree with what the robot did."""

from dataclasses import replace
from itertools import pairwise
from math import inf, isnan, nan, pi
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.sim.simulation import Plant
from robot.core import states
from robot.core.values import Decision, Outputs, Twist
from study.trial.core_loop import Behaviour, CoreLoop
from study.trial.trial import Trial, run_trial
from tests.support.each import each
from tests.support.study.made import boxed, floor

LEFT, RIGHT, GOAL, ALIGN = states.PASS_LEFT, states.PASS_RIGHT, states.TO_GOAL, states.ALIGN


class Still:
    """A plant that only returns heading and clearance."""

    def __init__(self) -> None:
        self.seen = (0.0, 1.0)

    def attitude(self) -> tuple[float, float]:
        return self.seen


def statistics_of(branches: list[int | None], headings: list[float] | None = None) -> Behaviour:
    """Return the statistics after these ticks."""
    watch, plant = Behaviour(), Still()
    for number, branch in enumerate(branches):
        plant.seen = (headings[number] if headings else 0.0, 1.0 + number)
        decision = None
        if branch is not None:
            decision = Decision(branch, None, inf, nan, nan, nan, nan, inf)
        outputs = Outputs(0, 0, 0, Twist(0.0, 0.0), decision)
        watch(cast(Plant, plant), cast(CoreLoop, None), outputs)
    return watch


@each(
    ("branches", "avoidances", "changes"),
    [
        ([], 0, 0),
        ([None, GOAL, GOAL], 0, 0),
        ([GOAL, LEFT, LEFT, GOAL], 1, 0),
        ([GOAL, LEFT, RIGHT, LEFT], 1, 2),
        ([LEFT, GOAL, LEFT, GOAL, LEFT], 3, 0),
        ([LEFT, GOAL, RIGHT], 2, 1),
        ([LEFT, None, ALIGN, RIGHT, RIGHT], 2, 1),
        ([LEFT, states.GIVE_UP], 1, 0),
    ],
)
def test_counts_avoidances_and_side_changes(
    branches: list[int | None], avoidances: int, changes: int
) -> None:
    watch = statistics_of(branches)
    assert (watch.avoidances, watch.side_changes) == (avoidances, changes)


@given(st.lists(st.sampled_from([None, *range(states.LOST + 1)])))
def test_every_tick_counts_in_exactly_one_branch(
    branches: list[int | None],
) -> None:
    watch = statistics_of(branches)
    assert sum(watch.ticks_of.values()) == watch.ticks == len(branches)
    sides = [branch for branch in branches if branch in (LEFT, RIGHT)]
    assert watch.side_changes == sum(a != b for a, b in pairwise(sides))
    assert watch.avoidances <= len(sides)


def test_heading_wrap_is_not_a_full_turn() -> None:
    watch = statistics_of([GOAL] * 3, [pi - 0.1, -pi + 0.1, pi - 0.1])
    assert watch.turned_rad == pytest.approx(0.4)


def test_turns_in_both_directions_add_up() -> None:
    assert statistics_of([GOAL] * 4, [1.0, 1.5, 1.0, 1.5]).turned_rad == pytest.approx(1.5)


def test_mean_clearance_is_over_all_ticks() -> None:
    assert statistics_of([GOAL] * 3).mean_clearance_m == 2.0
    assert isnan(statistics_of([]).mean_clearance_m)


def test_statistics_of_a_drive_agree_with_the_plant() -> None:
    watch, truths = Behaviour(), list[Any]()

    def both(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        watch(plant, onboard, outputs)
        truths.append(plant.truth())

    outcome = run_trial(Trial(world=boxed(), noise="none"), both)
    assert outcome.reached
    assert watch.avoidances >= 1
    assert watch.ticks == outcome.ticks + 1 == len(truths)
    mean_m = sum(one.clearance_m for one in truths) / len(truths)
    assert watch.mean_clearance_m == pytest.approx(mean_m)
    assert watch.turned_rad == pytest.approx(
        sum(abs(one.yaw_rate_rad_s) * 0.05 for one in truths), rel=0.05
    )


def test_behaviour_does_not_change_the_trial() -> None:
    trial = Trial(world=replace(floor(), walls=False), noise="default", seed=3)
    assert run_trial(trial, Behaviour()).digest == run_trial(trial).digest
