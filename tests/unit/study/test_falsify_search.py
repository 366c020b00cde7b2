"""The search of the falsifier: climbs, shrinking, and its verb."""

import json
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.corpus import generate
from plant.corpus.draft import Axis
from plant.model.configuration import KINDS as CONFIGURATION_KINDS
from plant.model.configuration import Fault
from plant.model.draws import Draws
from plant.world.writer import dumps
from protocol.world import Polyline, WorldCircle
from runtime.errors import UserError
from study.cli.falsify import files_of, main, parser
from study.falsify import climb as climbs
from study.falsify import search as searches
from study.falsify.climb import STEPS, Climb, SearchSettings, Violation, class_of, climb
from study.falsify.evaluate import evaluate
from study.falsify.findings import (
    ClassRecord,
    SearchProgress,
    finding_of,
    near,
    open_search,
    read_finding,
    save_progress,
    settings_json,
)
from study.falsify.search import Search, SearchBudget, SearchLine, Shrunk
from study.falsify.shrink import (
    Shrinker,
    checked,
    parts_of,
    reduce_list,
    replaced,
    roundings,
    simple_values,
    walls_in,
)
from study.runner import workers
from study.runner.workers import Workers
from tests.support.each import each
from tests.support.studies import (
    SCENES,
    evaluation_of,
    first_violation,
    search_of,
    violation_of,
)

SEEDS = {"bug": 32, "bug:right": 1, "vgm": 7}
"""Seeds whose first failure comes soon, and is small after MOST_WORLDS worlds."""

MOST_TRIALS = 12
MOST_WORLDS = 30


class InPlace(Executor):
    """Run every task at once in this process."""

    def submit(self, call: Any, /, *args: Any, **keywords: Any) -> "Future[Any]":
        done: Future[Any] = Future()
        try:
            done.set_result(call(*args, **keywords))
        except Exception as error:
            done.set_exception(error)
        return done


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
        assert made.target in CONFIGURATION_KINDS[made.kind].targets
        if CONFIGURATION_KINDS[made.kind].lowest == CONFIGURATION_KINDS[made.kind].highest:
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


SETTINGS = search_of("vgm", "ab")
KINDS = ("blocked", "no-progress", "timeout-still")


def fake_climb(_settings: SearchSettings, number: int) -> Climb:
    """Find a failure in every second climb; every third of these is of another kind."""
    kind = KINDS[number // 2 % 3]
    found = () if number % 2 else (violation_of("a", kind),)
    return Climb(number=number, trials=5, simulated_s=100.0, violations=found)


def fake_shrink(settings: SearchSettings, violation: Violation) -> Shrunk:
    """Shrink at once."""
    name = violation.failure_class
    finding = finding_of(settings.subject, "a", violation.evaluation, 60.0, name)
    return Shrunk(failure_class=name, finding=finding, drawn="<svg/>", walls=1, trials=3)


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searches, "climb", fake_climb)
    monkeypatch.setattr(searches, "shrink", fake_shrink)


def run(directory: Path, trials: int, jobs: int = 1) -> SearchProgress:
    clock: Iterator[int] = count()
    wanted = settings_json(SETTINGS, "code")
    with open_search(directory, wanted) as progress:
        search = Search(SETTINGS, directory, progress, lambda: float(next(clock)))
        for _ in search.run(Workers(InPlace(), lambda: jobs), SearchBudget(trials=trials)):
            pass
        search.save()
    return progress


def timeless(progress: SearchProgress) -> SearchProgress:
    """Return the progress without its times."""
    classes = {name: replace(one, after_s=0.0) for name, one in progress.classes.items()}
    return replace(progress, spent_s=0.0, classes=classes)


def files_in(directory: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in directory.glob("a-*")}


@pytest.mark.usefixtures("_quick")
def test_each_class_has_one_finding(tmp_path: Path) -> None:
    progress = run(tmp_path / "out", 60)
    assert len(progress.classes) == 3
    assert sum(one.seen for one in progress.classes.values()) == progress.climbs // 2
    assert all(0.0 < one.after_s <= progress.spent_s for one in progress.classes.values())
    assert sorted(files_in(tmp_path / "out")) == sorted(
        f"a-wedge-{kind}{suffix}" for kind in KINDS for suffix in (".svg", ".toml")
    )


@pytest.mark.usefixtures("_quick")
def test_findings_do_not_depend_on_the_number_of_jobs(tmp_path: Path) -> None:
    one, two = run(tmp_path / "1", 60, jobs=1), run(tmp_path / "2", 60, jobs=3)
    assert timeless(one) == timeless(two)
    assert files_in(tmp_path / "1") == files_in(tmp_path / "2")


@pytest.mark.usefixtures("_quick")
def test_continued_search_equals_one_without_a_stop(tmp_path: Path) -> None:
    run(tmp_path / "1", 25)
    continued, whole = run(tmp_path / "1", 60), run(tmp_path / "2", 60)
    assert timeless(continued) == timeless(whole)
    assert files_in(tmp_path / "1") == files_in(tmp_path / "2")


@pytest.mark.usefixtures("_quick")
def test_class_that_was_not_shrunk_is_shrunk_later(tmp_path: Path) -> None:
    directory = tmp_path / "out"
    progress = run(directory, 60)
    progress.classes["a-wedge-blocked"].sentence = ""
    save_progress(directory, progress)
    (directory / "a-wedge-blocked.toml").unlink()
    # Only the climb that found it first is repeated.
    assert run(directory, 60).classes["a-wedge-blocked"].sentence
    assert (directory / "a-wedge-blocked.toml").exists()


@pytest.mark.usefixtures("_quick")
def test_search_ends_when_its_time_is_used_up(tmp_path: Path) -> None:
    clock = count(0, 10)
    with open_search(tmp_path / "out", settings_json(SETTINGS, "code")) as progress:
        search = Search(SETTINGS, tmp_path / "out", progress, lambda: float(next(clock)))
        steps = sum(
            1 for _ in search.run(Workers(InPlace(), lambda: 1), SearchBudget(span_s=300.0))
        )
    assert 1 <= steps < 30
    assert search.is_over(SearchBudget(span_s=progress.spent_s))
    assert progress.climbs < 30


@pytest.mark.usefixtures("_quick")
def test_directory_of_another_search_is_refused(tmp_path: Path) -> None:
    run(tmp_path, 10)
    other = settings_json(search_of("bug", "ab"), "code")
    with (
        pytest.raises(UserError, match="another search \\(navigator differ"),
        open_search(tmp_path, other),
    ):
        pass


@pytest.mark.usefixtures("_quick")
def test_directory_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UserError, match="is not empty"):
        run(tmp_path, 10)


@pytest.mark.usefixtures("_quick")
def test_directory_in_use_is_refused(tmp_path: Path) -> None:
    wanted = settings_json(SETTINGS, "code")
    with open_search(tmp_path, wanted), pytest.raises(UserError, match="writing there"):
        run(tmp_path, 10)


@pytest.mark.usefixtures("_quick")
def test_damaged_progress_is_reported(tmp_path: Path) -> None:
    run(tmp_path, 10)
    (tmp_path / "progress.json").write_text('{"classes": {}, "wrong": 1}')
    with pytest.raises(UserError, match=r"progress\.json: is damaged"):
        run(tmp_path, 20)


@pytest.mark.usefixtures("_quick")
def test_finding_is_the_same_from_its_file(tmp_path: Path) -> None:
    finding = finding_of(SETTINGS.subject, "a", evaluation_of("blocked"), 60.0, "found")
    file = tmp_path / "found.toml"
    file.write_text(finding.text())
    assert read_finding(file) == finding
    assert file.read_text().splitlines()[0].startswith("# vgm ends (has not moved")


@pytest.mark.usefixtures("_quick")
def test_world_file_without_a_recipe_is_no_finding(tmp_path: Path) -> None:
    finding = finding_of(SETTINGS.subject, "a", evaluation_of("blocked"), 60.0, "found")
    file = tmp_path / "found.toml"
    file.write_text(finding.text().replace("falsify:", "other:"))
    with pytest.raises(UserError, match="is no finding"):
        read_finding(file)


@pytest.mark.usefixtures("_quick")
def test_progress_line_shows_classes_and_time_left(tmp_path: Path) -> None:
    with open_search(tmp_path / "out", settings_json(SETTINGS, "code")) as progress:
        search = Search(SETTINGS, tmp_path / "out", progress, lambda: 60.0)
        budget = SearchBudget(span_s=120.0)
        search.started_s = 0.0
        progress.trials, progress.climbs, progress.simulated_s = 30, 4, 7200.0
        line = SearchLine(search, budget, sys.stderr, lambda: 60.0).line()
    assert line == ("30 trials in 4 climbs, 2.0 simulated h/min, classes of failure: 0, 60 s left")


class Endless(Executor):
    """Accept tasks and end none."""

    def submit(self, _call: Any, /, *_args: Any, **_keywords: Any) -> "Future[Any]":
        return Future()


@pytest.mark.usefixtures("_quick")
def test_climbs_in_flight_follow_the_threads_of_the_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(searches, "REFRESH_S", 0.0)
    search = Search(SETTINGS, tmp_path, SearchProgress(), lambda: 0.0)
    threads = iter([*[6] * 13, *[9] * 7])
    steps = search.run(Workers(Endless(), lambda: next(threads)), SearchBudget(span_s=1.0))
    next(steps)
    assert len(search.running) == 12
    next(steps)  # more workers have joined
    assert len(search.running) == 18


@given(st.sets(st.integers(0, 30), max_size=6), st.integers(1, 31))
def test_reduction_keeps_exactly_what_is_needed(needed: set[int], count: int) -> None:
    items = list(range(count))
    wanted = {one for one in needed if one < count}
    assert set(reduce_list(items, lambda kept: wanted <= set(kept))) == wanted


def test_reduction_ends_where_no_item_can_be_removed_alone() -> None:
    kept = reduce_list(list("abcdef"), lambda some: "c" in some or len(some) == 6)
    assert kept == ["c"]


@each(
    ("axis", "value", "simpler"),
    [
        (Axis("turn_deg", -180.0, 180.0), 12.34, [0.0, 90.0, 45.0, 12.0, 12.3]),
        (Axis("count", 1, 4, whole=True), 3.0, [1.0, 2.0]),
        (Axis("max_speed_m_s", 0.1, 0.5), 0.3333, [0.3, 0.33]),
        (Axis("max_speed_m_s", 0.1, 0.5), 0.3, []),
    ],
)
def test_simple_values_stay_within_the_axis(axis: Axis, value: float, simpler: list[float]) -> None:
    assert list(simple_values(axis, value)) == simpler


def test_rounding_starts_with_the_coarsest_grid() -> None:
    world = generate("three_walls", 0, 3)
    first = next(iter(roundings(world, "goal")))
    assert first.goal.x_m % 0.5 == first.goal.y_m % 0.5 == 0.0
    assert first.start == world.start
    assert first.obstacles == world.obstacles


def test_each_part_is_rounded_alone() -> None:
    world = generate("three_walls", 0, 3)
    assert parts_of(world) == ["all", "size", "start", "goal", *range(len(world.obstacles))]
    for other in roundings(world, 0):
        assert other.obstacles[1:] == world.obstacles[1:]
        assert other.start == world.start


def test_wall_without_length_is_no_valid_world() -> None:
    world = generate("three_walls", 0, 3)
    assert checked(dumps(world)) is not None
    flat = replaced(world, 0, Polyline(((1.0, 1.0), (1.0, 1.0))))
    assert checked(dumps(flat)) is None


def test_walls_are_counted_as_straight_pieces() -> None:
    world = generate("three_walls", 0, 3)
    bent = replaced(world, 0, Polyline(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))))
    assert walls_in(bent) == walls_in(world) + 1
    post = replaced(world, 0, WorldCircle(x_m=1.0, y_m=1.0, radius_m=0.1))
    assert walls_in(post) == walls_in(world)


@pytest.fixture(name="no_climbs")
def _no_climbs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a search end at once with one class of failure."""

    def run(search: Search, *_: object) -> Iterator[None]:
        search.started_s = search.monotonic_s()
        search.progress.trials = 7
        search.progress.classes["a-wedge-blocked"] = ClassRecord(0, 2, 3, "It stops.", 4.56)
        yield

    monkeypatch.setattr(Search, "run", run)


def run_verb(tmp_path: Path, *words: str) -> int:
    return main(["vgm", "--jobs", "1", "--output", str(tmp_path / "out"), *words])


def test_letters_of_properties_are_sorted() -> None:
    assert parser().parse_args(["vgm", "--properties", "ca"]).properties == "ac"


@each("words", [["--properties", "x"], ["--detour", "1"], ["--vary", "x"]])
def test_wrong_option_exits_with_2(words: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["vgm", *words])
    assert end.value.code == 2


def test_unknown_navigator_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^no such navigator: 'vmg'; did you mean 'vgm'\?"):
        main(["vmg", "--output", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_output_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(UserError, match="--output"):
        run_verb(tmp_path)


@pytest.mark.usefixtures("no_climbs")
def test_findings_end_with_exit_code_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_verb(tmp_path) == 1
    shown = capsys.readouterr().out
    assert shown == (
        "a-wedge-blocked: seen 2, 3 walls: It stops.\n"
        f"classes of failure: 1 in 7 trials, in {tmp_path / 'out'}\n"
    )


@pytest.mark.usefixtures("no_climbs")
def test_json_has_one_entry_for_each_class(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_verb(tmp_path, "--json")
    printed = json.loads(capsys.readouterr().out)
    assert printed["verb"] == "falsify"
    assert printed["classes"] == {
        "a-wedge-blocked": {"seen": 2, "walls": 3, "after_s": 4.6, "sentence": "It stops."}
    }


def test_interrupted_search_keeps_its_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(search: Search, *_: object) -> Iterator[None]:
        search.started_s = search.monotonic_s()
        search.progress.trials = 11
        yield
        raise KeyboardInterrupt

    monkeypatch.setattr(Search, "run", interrupted)
    assert run_verb(tmp_path) == 130
    assert "To continue, give the same command again" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "progress.json").read_text())["trials"] == 11


def test_replay_tells_violations_from_repaired_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = search_of("vgm", "a", seed=3)
    violation = first_violation(settings, 12)
    file = tmp_path / "one.toml"
    file.write_text(finding_of(settings.subject, "a", violation.evaluation, 400.0, "one").text())
    assert main(["vgm", "--replay", str(tmp_path)]) == 1
    assert capsys.readouterr().out == f"violates a {file}: {violation.evaluation.kind}\n"
    assert read_finding(file).replay().kind == violation.evaluation.kind


def test_replay_from_near_starts_counts_the_drives_that_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        workers, "workers", lambda *_: nullcontext(workers.Workers(InPlace(), lambda: 1))
    )
    settings = search_of("vgm", "a", seed=3)
    found = finding_of(settings.subject, "a", first_violation(settings, 12).evaluation, 400, "one")
    file = tmp_path / "one.toml"
    file.write_text(found.text())
    failed = sum("a" in one.replay().violated for one in near(found, 2))
    assert failed > 0
    assert main(["vgm", "--replay", str(file), "--starts", "2"]) == 1
    assert capsys.readouterr().out == f"violates a {file}: violated in {failed} of 2 drives\n"
    assert main(["vgm_memory", "--replay", str(file), "--starts", "2"]) == 0
    assert capsys.readouterr().out == f"holds a {file}: violated in 0 of 2 drives\n"


def test_starts_without_replay_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="--starts: only with --replay"):
        run_verb(tmp_path, "--starts", "3")


def test_replay_of_an_empty_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no \.toml file"):
        files_of([tmp_path])
