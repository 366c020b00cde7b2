"""Climbs: determined by their number, near a violation, and fast for the paper's methods."""

from dataclasses import replace
from functools import cache
from typing import Any, cast

import pytest

from plant.model.configuration import KINDS, Fault
from plant.model.draws import Draws
from study.falsify import climb as climbs
from study.falsify.climb import STEPS, Violation, class_of, climb
from study.falsify.evaluate import evaluate
from study.falsify.shrink import Shrinker, walls_in
from tests.support.each import each
from tests.unit.study.falsify.examples import SCENES, first_violation, search_of

SEEDS = {"bug": 32, "bug:right": 1, "vgm": 7}
"""Seeds whose first failure comes soon, and is small after MOST_WORLDS worlds."""

MOST_TRIALS = 12
MOST_WORLDS = 30


@cache
def found(navigator: str) -> Violation:
    return first_violation(search_of(navigator, "ab", SEEDS[navigator]), MOST_TRIALS)


def test_climb_is_determined_by_its_number() -> None:
    settings = search_of("vgm", "ac")
    one, again = climb(settings, 1), climb(settings, 1)
    assert one.trials == again.trials <= STEPS
    assert [v.candidate for v in one.violations] == [v.candidate for v in again.violations]
    digests = [[v.evaluation.outcome.digest for v in each.violations] for each in (one, again)]
    assert digests[0] == digests[1]


@pytest.mark.sweep(len(SEEDS))
@pytest.mark.parametrize("navigator", SEEDS)
def test_paper_method_fails_at_most_three_walls(navigator: str) -> None:
    violation = found(navigator)
    settings = search_of(navigator, "ab", SEEDS[navigator])
    shrinker = Shrinker(settings, violation, most=MOST_WORLDS)
    smallest = shrinker.shrink()
    assert violation.letter in smallest.violated
    assert walls_in(smallest.world) <= 3 < walls_in(violation.evaluation.world)
    assert smallest.world.reachable
    family = violation.candidate.family
    assert class_of(violation.letter, family, smallest.kind) == violation.failure_class


def test_neighbour_changes_at_most_three_values() -> None:
    random = Draws("neighbours")
    for family in SCENES:
        one = climbs.draw(random, family, climbs.VARIED)
        for _ in range(20):
            other = climbs.neighbour(random, one, climbs.VARIED)
            changed = [name for name in one.values if one.values[name] != other.values[name]]
            assert len(changed) <= 3
            for axis in climbs.axes_of(family, climbs.VARIED):
                assert axis.low <= other.values[axis.name] <= axis.high


def test_usual_robot_has_no_overrides() -> None:
    values = {"usual_robot": 1.0, "radius_m": 0.2, "max_speed_m_s": 0.2, "sonar_max_m": 1.0}
    assert climbs.robot_of(values) == {}
    robot = climbs.robot_of({**values, "usual_robot": 0.0})
    assert robot == {"radius_m": 0.2, "max_speed_m_s": 0.2, "sonar_max_m": 1.0, "track_m": 0.32}


def test_people_and_faults_are_part_of_the_world() -> None:
    random = Draws("people")
    worlds = []
    for _ in range(30):
        one = climbs.draw(random, "three_walls", climbs.VARIED)
        values = {**one.values, "people": 2.0, "fault": 3.0}
        worlds.append(climbs.built(replace(one, values=values), "w", 1))
    made = [world for world in worlds if world is not None]
    assert any(getattr(one, "path_m", ()) for world in made for one in world.obstacles)
    assert all(world.faults[0]["kind"] == "sonar_dropout" for world in made)
    assert made


@each("number", range(1, len(climbs.FAULTS) + 1))
@each("share", [0.0, 0.3, 1.0])
def test_every_fault_of_the_space_is_valid(number: int, share: float) -> None:
    for target in range(8):
        values = {"fault": float(number), "fault_target": float(target), "fault_start_s": 1.5}
        (fault,) = climbs.faults_of({**values, "fault_value": share})
        made = Fault(**cast("dict[str, Any]", fault))
        assert made.kind == climbs.FAULTS[number - 1]
        assert made.target in KINDS[made.kind].targets
        if KINDS[made.kind].lowest == KINDS[made.kind].highest:
            assert "value" not in fault


def test_each_wheel_fault_changes_the_drive() -> None:
    subject, digests = search_of("vgm", "c").subject, set[str]()
    one = climbs.draw(Draws("faults/0"), "wedge", ("faults",))
    numbers = [0, *(climbs.FAULTS.index(kind) + 1 for kind in climbs.WHEEL_FAULTS)]
    for number in numbers:
        values = {**one.values, "fault": float(number), "fault_start_s": 1.0, "fault_value": 0.8}
        world = climbs.built(replace(one, values=values), "w", 1)
        assert world is not None
        digests.add(evaluate(subject, world, 0, 10.0).outcome.digest)
    assert len(digests) == len(numbers)
