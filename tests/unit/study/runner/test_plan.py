"""Trials have an identity that depends on their settings only, and a balanced order."""

import json
from collections import Counter
from dataclasses import replace
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS
from runtime.errors import UserError
from study.runner.plan import (
    EVERY_NAVIGATOR,
    MIN_TIMEOUT_S,
    SEED_STRIDE,
    UNREACHABLE_TIMEOUT_S,
    ListedWorld,
    id_of,
    navigator_of,
    noise_of,
    tasks_of,
    time_for,
)
from tests.support.each import each
from tests.support.study.made import boxed, floor, list_of, settings, tasks


def test_plans_every_combination_once() -> None:
    made = tasks(floor(), boxed(), navigators=EVERY_NAVIGATOR, noise=tuple(LEVELS), seeds=3)
    assert len(made) == 2 * len(EVERY_NAVIGATOR) * (1 + 3 * 3)
    assert len({task.trial_id for task in made}) == len(made)


def test_seeds_differ_by_world_and_not_by_navigator() -> None:
    made = tasks(floor(), boxed(), navigators=EVERY_NAVIGATOR, noise=("default", "harsh"), seeds=2)
    seeds = {(task.world_digest, task.seed) for task in made}
    assert len(seeds) == len({seed for _, seed in seeds}) == 2 * 2


def test_plan_is_deterministic() -> None:
    assert tasks(floor(), boxed(), seeds=2) == tasks(floor(), boxed(), seeds=2)


def test_world_order_does_not_change_trial_ids() -> None:
    one = {task.trial_id for task in tasks(floor(), boxed())}
    assert one == {task.trial_id for task in tasks(boxed(), floor())}


def test_world_source_does_not_change_trial_ids() -> None:
    (one,) = list_of(floor())
    moved = ListedWorld("kept:elsewhere.toml", one.digest, replace(one.world, family="other"))
    asked = settings()
    assert [task.trial_id for task in tasks_of([one], asked, "1")] == [
        task.trial_id for task in tasks_of([moved], asked, "1")
    ]


@each(
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
def test_every_setting_changes_the_trial_id(changed: dict[str, object]) -> None:
    assert tasks(floor())[0].trial_id != tasks(floor(), **changed)[0].trial_id


def test_version_changes_the_trial_id() -> None:
    assert id_of({"seed": 1}, "0.1.0") != id_of({"seed": 1}, "0.2.0")


def test_parameter_order_does_not_change_the_plan() -> None:
    one = tasks(floor(), parameters={"d_obs_m": 0.3, "d_th_m": 0.2})
    other = tasks(floor(), parameters={"d_th_m": 0.2, "d_obs_m": 0.3})
    assert one == other
    assert json.loads(one[0].parameters) == {"d_obs_m": 0.3, "d_th_m": 0.2}


def test_every_part_of_the_plan_is_balanced() -> None:
    worlds = [floor(f"floor{number}") for number in range(20)]
    made = tasks(*worlds, navigators=EVERY_NAVIGATOR, noise=("default",), seeds=4)
    quarter = list(islice(made, len(made) // 4))
    assert {task.seed % SEED_STRIDE for task in quarter} == {0}
    half_round = Counter(task.navigator + task.side for task in quarter[: len(quarter) // 2])
    assert len(half_round) == len(EVERY_NAVIGATOR)
    assert max(half_round.values()) <= 3 * min(half_round.values())


@given(st.floats(0.0, 1e5))
def test_time_limit_is_sufficient_and_rounded_to_10_s(length_m: float) -> None:
    time_s = time_for(replace(floor(), shortest_path_m=length_m))
    assert time_s >= MIN_TIMEOUT_S
    assert time_s >= 30.0 + 40.0 * length_m / 0.3 - 1e-6 * length_m
    assert time_s % 10.0 == 0.0


def test_time_limit_depends_on_speed_and_reachability() -> None:
    far = replace(floor(), shortest_path_m=10.0)
    slow = replace(far, robot={"max_speed_m_s": 0.1})
    assert time_for(slow) > 2.5 * time_for(far)
    lost = replace(floor(), shortest_path_m=None, reachable=False)
    assert time_for(lost) == UNREACHABLE_TIMEOUT_S


def test_navigator_side_defaults_to_left() -> None:
    assert navigator_of("bug") == "bug:left"
    assert navigator_of("bug:right") == "bug:right"


@each(
    ("text", "message"),
    [
        ("vgm_memroy", "did you mean 'vgm_memory'"),
        ("", "there are bug"),
        ("bug:lift", "did you mean 'left'"),
        (":left", "no such navigator"),
    ],
)
def test_unknown_navigator_is_refused_with_suggestion(text: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        navigator_of(text)


def test_unknown_noise_level_is_refused_with_suggestion() -> None:
    with pytest.raises(UserError, match="did you mean 'harsh'"):
        noise_of("harhs")
