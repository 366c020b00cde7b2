"""The plan of a study: trials with an identity, and the sources of worlds."""

import json
from collections import Counter
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.corpus import FAMILIES
from plant.model.configuration import LEVELS
from plant.model.errors import WorldError
from plant.world.file import load, shipped
from plant.world.writer import dumps
from runtime.errors import UserError
from study.runner import plan
from study.runner.plan import (
    EVERY_NAVIGATOR,
    MIN_TIMEOUT_S,
    SEED_STRIDE,
    UNREACHABLE_TIMEOUT_S,
    ListedWorld,
    StudySettings,
    WorldSelection,
    digest_of,
    id_of,
    listed,
    navigator_of,
    noise_of,
    tasks_of,
    time_for,
    world_of,
)
from study.runner.run_task import trial_of
from study.runner.store import keep
from tests.support.each import each
from tests.support.studies import boxed, floor, list_of, settings, tasks


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


STEP: Final = "def step(memory, pose, ring, goal, params): ...\n"


def test_own_navigator_is_planned_by_name_and_version(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(STEP)
    settings = StudySettings(navigators=(navigator_of(f"{file}:right"), "bug:left"))
    assert settings.navigators[0] == f"{file}:right"
    before = tasks_of(listed(wanted("open")), settings, "1")
    assert {(one.navigator, one.side) for one in before} == {("mine", "right"), ("bug", "left")}
    file.write_text(STEP + "# changed")
    kept = {one.trial_id for one in before} & {
        one.trial_id for one in tasks_of(listed(wanted("open")), settings, "1")
    }
    assert kept == {one.trial_id for one in before if one.navigator == "bug"}


def test_two_own_navigators_of_one_name_are_refused(tmp_path: Path) -> None:
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "mine.py").write_text(STEP)
    files = tuple(navigator_of(str(tmp_path / place / "mine.py")) for place in ("a", "b"))
    with pytest.raises(UserError, match="are both named mine; give one of them another name"):
        StudySettings(navigators=files).own()


def test_trial_of_a_changed_navigator_is_not_repeated(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(STEP)
    settings = StudySettings(navigators=(navigator_of(str(file)),))
    (one,) = listed(wanted("open"))
    task = tasks_of([one], settings, "1")[0]
    assert trial_of(task, one.world, settings.own()).navigator == str(file)
    own = settings.own()
    file.write_text(STEP + "# changed")
    with pytest.raises(UserError, match="has changed since the study began"):
        trial_of(task, one.world, own)


def test_unknown_noise_level_is_refused_with_suggestion() -> None:
    with pytest.raises(UserError, match="did you mean 'harsh'"):
        noise_of("harhs")


def wanted(*places: str, families: list[str] | None = None, per_family: int = 1) -> WorldSelection:
    return WorldSelection(places, families, per_family, corpus_seed=5)


def names(found: list[ListedWorld]) -> list[str]:
    return [one.world.name for one in found]


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Make a directory with two world files."""
    place = tmp_path / "mine"
    place.mkdir()
    for file, world in (("a: 1", floor("a", family=None)), ("b", boxed("b"))):
        (place / f"{file}.toml").write_text(dumps(world))
    (place / "notes.txt").write_text("no world")
    return place


def test_corpus_has_the_requested_worlds_per_family() -> None:
    found = listed(wanted("corpus", families=["box", "open"], per_family=3))
    assert [one.world.family for one in found] == ["box"] * 3 + ["open"] * 3
    assert len(listed(wanted("corpus"))) == len(FAMILIES)


def test_fixed_worlds_are_two_per_family() -> None:
    families = [one.world.family for one in listed(wanted("fixed"))]
    assert sorted(map(str, families)) == sorted([*FAMILIES, *FAMILIES])


def test_shipped_worlds_are_listed_by_name_or_all() -> None:
    assert names(listed(wanted("box", "u_trap"))) == ["box", "u_trap"]
    assert len(listed(wanted("shipped"))) == len(shipped())


def test_directory_names_the_family_of_its_worlds(
    own: Path,
) -> None:
    found = listed(wanted(str(own)))
    assert names(found) == ["a", "b"]
    assert [one.world.family for one in found] == ["mine", "disc"]


def test_every_listed_world_has_a_shortest_path() -> None:
    for one in listed(wanted("fixed", "box")):
        unreachable = one.world.family == "unreachable"
        assert one.world.reachable is not unreachable
        assert (one.world.shortest_path_m is None) == unreachable


def test_repeated_world_is_listed_once(own: Path) -> None:
    found = listed(wanted("box", str(own), "box", str(own / "a: 1.toml")))
    assert names(found) == ["box", "a", "b"]


def test_different_worlds_of_one_name_are_refused(own: Path) -> None:
    (own / "c.toml").write_text(dumps(boxed("a")))
    with pytest.raises(UserError, match="both named 'a' and differ"):
        listed(wanted(str(own)))


def test_source_reproduces_the_world(own: Path, tmp_path: Path) -> None:
    families = ["box", "unreachable", "disc", "mine", "shipped", "maze"]
    found = [
        *listed(wanted("corpus", families=["box", "maze"])),
        *listed(wanted("fixed", "wall", str(own), families=["unreachable", "shipped", "mine"])),
    ]
    assert {one.world.family for one in found} < set(families)
    keep(found, tmp_path)
    for file in own.iterdir():
        file.unlink()
    for one in found:
        assert digest_of(world_of(one.source, tmp_path)) == one.digest


def test_kept_file_is_written_once(own: Path, tmp_path: Path) -> None:
    found = listed(wanted(str(own)))
    keep(found, tmp_path)
    before = [file.stat().st_ino for file in sorted((tmp_path / plan.KEPT).iterdir())]
    keep(found, tmp_path)
    after = [file.stat().st_ino for file in sorted((tmp_path / plan.KEPT).iterdir())]
    assert before == after
    assert len(before) == 2


def test_digest_covers_what_affects_a_trial() -> None:
    world = load("box")
    assert digest_of(replace(world, family="other", shortest_path_m=9.0)) == digest_of(world)
    moved = replace(world, goal=replace(world.goal, x_m=world.goal.x_m + 1e-9))
    assert digest_of(moved) != digest_of(world)


def test_all_bad_files_are_reported_in_order(own: Path) -> None:
    (own / "0.toml").write_text("size_m = [")
    (own / "z.toml").write_text('name = "z"\nsize_m = [4.0, -1.0]\n')
    with pytest.raises(WorldError) as refused:
        listed(wanted(str(own)))
    lines = str(refused.value).splitlines()
    assert "0.toml" in lines[0]
    assert all("z.toml" in line for line in lines[1:])
    assert len(lines) >= 2


def test_directory_without_worlds_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no \.toml file"):
        listed(wanted(str(tmp_path)))


@each(
    ("place", "message"), [("u_trab", "did you mean 'u_trap'"), ("corpsu", "did you mean 'corpus'")]
)
def test_unknown_world_is_refused_with_suggestion(place: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        listed(wanted(place))


def test_missing_file_is_refused() -> None:
    with pytest.raises(WorldError, match=r"nowhere\.toml: file: cannot be read"):
        listed(wanted("nowhere.toml"))


@each("place", ["corpus", "fixed", "box"])
def test_unknown_family_is_refused(place: str) -> None:
    with pytest.raises(UserError, match="--families: no such family: 'boxx'"):
        listed(wanted(place, families=["boxx"]))


@pytest.mark.parametrize("source", ["", "moon:box", "corpus:box", "corpus:x:1:1", "kept"])
def test_source_of_another_version_is_refused(source: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="world_source"):
        world_of(source, tmp_path)
