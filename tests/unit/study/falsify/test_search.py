"""The search: in the order of its climbs, resumable, and each class shrunk once."""

import sys
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import UserError
from study.falsify import search as searches
from study.falsify.climb import Climb, SearchSettings, Violation
from study.falsify.findings import (
    SearchProgress,
    finding_of,
    open_search,
    read_finding,
    save_progress,
    settings_json,
)
from study.falsify.search import Search, SearchBudget, SearchLine, Shrunk
from study.runner.workers import InPlace, Workers
from tests.unit.study.falsify.examples import evaluation_of, search_of, violation_of

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


@pytest.fixture(autouse=True)
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


def test_each_class_has_one_finding(tmp_path: Path) -> None:
    progress = run(tmp_path / "out", 60)
    assert len(progress.classes) == 3
    assert sum(one.seen for one in progress.classes.values()) == progress.climbs // 2
    assert all(0.0 < one.after_s <= progress.spent_s for one in progress.classes.values())
    assert sorted(files_in(tmp_path / "out")) == sorted(
        f"a-wedge-{kind}{suffix}" for kind in KINDS for suffix in (".svg", ".toml")
    )


def test_findings_do_not_depend_on_the_number_of_jobs(tmp_path: Path) -> None:
    one, two = run(tmp_path / "1", 60, jobs=1), run(tmp_path / "2", 60, jobs=3)
    assert timeless(one) == timeless(two)
    assert files_in(tmp_path / "1") == files_in(tmp_path / "2")


def test_continued_search_equals_one_without_a_stop(tmp_path: Path) -> None:
    run(tmp_path / "1", 25)
    continued, whole = run(tmp_path / "1", 60), run(tmp_path / "2", 60)
    assert timeless(continued) == timeless(whole)
    assert files_in(tmp_path / "1") == files_in(tmp_path / "2")


def test_class_that_was_not_shrunk_is_shrunk_later(tmp_path: Path) -> None:
    directory = tmp_path / "out"
    progress = run(directory, 60)
    progress.classes["a-wedge-blocked"].sentence = ""
    save_progress(directory, progress)
    (directory / "a-wedge-blocked.toml").unlink()
    # Only the climb that found it first is repeated.
    assert run(directory, 60).classes["a-wedge-blocked"].sentence
    assert (directory / "a-wedge-blocked.toml").exists()


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


def test_directory_of_another_search_is_refused(tmp_path: Path) -> None:
    run(tmp_path, 10)
    other = settings_json(search_of("bug", "ab"), "code")
    with (
        pytest.raises(UserError, match="another search \\(navigator differ"),
        open_search(tmp_path, other),
    ):
        pass


def test_directory_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UserError, match="is not empty"):
        run(tmp_path, 10)


def test_directory_in_use_is_refused(tmp_path: Path) -> None:
    wanted = settings_json(SETTINGS, "code")
    with open_search(tmp_path, wanted), pytest.raises(UserError, match="writing there"):
        run(tmp_path, 10)


def test_damaged_progress_is_reported(tmp_path: Path) -> None:
    run(tmp_path, 10)
    (tmp_path / "progress.json").write_text('{"classes": {}, "wrong": 1}')
    with pytest.raises(UserError, match=r"progress\.json: is damaged"):
        run(tmp_path, 20)


def test_finding_is_the_same_from_its_file(tmp_path: Path) -> None:
    finding = finding_of(SETTINGS.subject, "a", evaluation_of("blocked"), 60.0, "found")
    file = tmp_path / "found.toml"
    file.write_text(finding.text())
    assert read_finding(file) == finding
    assert file.read_text().splitlines()[0].startswith("# vgm ends (has not moved")


def test_world_file_without_a_recipe_is_no_finding(tmp_path: Path) -> None:
    finding = finding_of(SETTINGS.subject, "a", evaluation_of("blocked"), 60.0, "found")
    file = tmp_path / "found.toml"
    file.write_text(finding.text().replace("falsify:", "other:"))
    with pytest.raises(UserError, match="is no finding"):
        read_finding(file)


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
