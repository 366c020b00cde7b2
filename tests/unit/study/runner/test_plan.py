"""Trials have an identity that nothing but what they are decides, and an order that is fair."""

import json
from collections import Counter
from dataclasses import replace
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.noise import LEVELS
from runtime.errors import UserError
from study.runner.plan import (
    EVERY_NAVIGATOR,
    MIN_TIMEOUT_S,
    SEED_STRIDE,
    UNREACHABLE_TIMEOUT_S,
    id_of,
    navigator_of,
    noise_of,
    tasks_of,
    time_for,
)
from study.runner.sources import ListedWorld
from tests.support.study.made import boxed, floor, list_of, settings, tasks


def test_every_combination_is_there_once_but_without_noise_one_seed_is_enough() -> None:
    made = tasks(floor(), boxed(), navigators=EVERY_NAVIGATOR, noise=tuple(LEVELS), seeds=3)
    assert len(made) == 2 * len(EVERY_NAVIGATOR) * (1 + 3 * 3)
    assert len({task.trial_id for task in made}) == len(made)


def test_every_world_has_its_own_luck_and_all_navigators_share_it() -> None:
    made = tasks(floor(), boxed(), navigators=EVERY_NAVIGATOR, noise=("default", "harsh"), seeds=2)
    seeds = {(task.world_digest, task.seed) for task in made}
    assert len(seeds) == len({seed for _, seed in seeds}) == 2 * 2


def test_the_same_study_has_the_same_trials_in_the_same_order() -> None:
    assert tasks(floor(), boxed(), seeds=2) == tasks(floor(), boxed(), seeds=2)


def test_the_order_of_the_worlds_changes_no_identity() -> None:
    one = {task.trial_id for task in tasks(floor(), boxed())}
    assert one == {task.trial_id for task in tasks(boxed(), floor())}


def test_where_the_world_comes_from_changes_no_identity() -> None:
    (one,) = list_of(floor())
    moved = ListedWorld("kept:elsewhere.toml", one.digest, replace(one.world, family="other"))
    asked = settings()
    assert [task.trial_id for task in tasks_of([one], asked, "1")] == [
        task.trial_id for task in tasks_of([moved], asked, "1")
    ]


@pytest.mark.parametrize(
    "changed",
    [
        {"navigators": ("vgm:right",)},
        {"navigators": ("bug:left",)},
        {"noise": ("harsh",)},
        {"timeout_s": 21.0},
        {"parameters": {"d_obs_m": 0.31}},
        {"calibrated": False},
    ],
)
def test_whatever_changes_a_trial_changes_its_identity(changed: dict[str, object]) -> None:
    assert tasks(floor())[0].trial_id != tasks(floor(), **changed)[0].trial_id


def test_another_version_is_another_trial() -> None:
    assert id_of({"seed": 1}, "0.1.0") != id_of({"seed": 1}, "0.2.0")


def test_parameters_are_one_whatever_their_order() -> None:
    one = tasks(floor(), parameters={"d_obs_m": 0.3, "d_th_m": 0.2})
    other = tasks(floor(), parameters={"d_th_m": 0.2, "d_obs_m": 0.3})
    assert one == other
    assert json.loads(one[0].parameters) == {"d_obs_m": 0.3, "d_th_m": 0.2}


def test_an_interrupted_study_has_come_equally_far_everywhere() -> None:
    worlds = [floor(f"floor{number}") for number in range(20)]
    made = tasks(*worlds, navigators=EVERY_NAVIGATOR, noise=("default",), seeds=4)
    quarter = list(islice(made, len(made) // 4))
    assert {task.seed % SEED_STRIDE for task in quarter} == {0}
    half_round = Counter(task.navigator + task.side for task in quarter[: len(quarter) // 2])
    assert len(half_round) == len(EVERY_NAVIGATOR)
    assert max(half_round.values()) <= 3 * min(half_round.values())


@given(st.floats(0.0, 1e5))
def test_the_time_is_never_short_and_in_whole_ten_seconds(length_m: float) -> None:
    time_s = time_for(replace(floor(), shortest_path_m=length_m))
    assert time_s >= MIN_TIMEOUT_S
    assert time_s >= 30.0 + 40.0 * length_m / 0.3 - 1e-6 * length_m
    assert time_s % 10.0 == 0.0


def test_a_slower_robot_has_more_time_and_no_way_has_its_own() -> None:
    far = replace(floor(), shortest_path_m=10.0)
    slow = replace(far, robot={"max_speed_m_s": 0.1})
    assert time_for(slow) > 2.5 * time_for(far)
    lost = replace(floor(), shortest_path_m=None, reachable=False)
    assert time_for(lost) == UNREACHABLE_TIMEOUT_S


def test_a_navigator_has_a_side_left_if_nothing_is_said() -> None:
    assert navigator_of("bug") == "bug:left"
    assert navigator_of("bug:right") == "bug:right"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("vgm_memroy", "did you mean 'vgm_memory'"),
        ("", "there are bug"),
        ("bug:lift", "did you mean 'left'"),
        (":left", "no such navigator"),
    ],
)
def test_an_unknown_navigator_or_side_is_told_with_what_was_meant(text: str, says: str) -> None:
    with pytest.raises(UserError, match=says):
        navigator_of(text)


def test_an_unknown_noise_level_is_told_with_what_was_meant() -> None:
    with pytest.raises(UserError, match="did you mean 'harsh'"):
        noise_of("harhs")
