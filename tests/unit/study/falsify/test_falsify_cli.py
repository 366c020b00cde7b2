"""The verb `sidestep falsify`: its options, its errors, and its end."""

import json
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest

from runtime.errors import UserError
from study.cli.falsify import files_of, main, parser
from study.falsify.findings import ClassRecord, finding_of, near, read_finding
from study.falsify.search import Search
from study.runner import workers
from tests.support.each import each
from tests.unit.study.falsify.examples import first_violation, search_of


@pytest.fixture(name="no_climbs")
def _no_climbs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a search end at once with one class of failure."""

    def run(search: Search, *_: object) -> Iterator[None]:
        search.started_s = search.monotonic_s()
        search.progress.trials = 7
        search.progress.classes["a-wedge-blocked"] = ClassRecord(0, 2, 3, "It stops.", 4.56)
        yield

    monkeypatch.setattr(Search, "run", run)


def run(tmp_path: Path, *words: str) -> int:
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
        run(tmp_path)


@pytest.mark.usefixtures("no_climbs")
def test_findings_end_with_exit_code_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path) == 1
    shown = capsys.readouterr().out
    assert shown == (
        "a-wedge-blocked: seen 2, 3 walls: It stops.\n"
        f"classes of failure: 1 in 7 trials, in {tmp_path / 'out'}\n"
    )


@pytest.mark.usefixtures("no_climbs")
def test_json_has_one_entry_for_each_class(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(tmp_path, "--json")
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
    assert run(tmp_path) == 130
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
        workers, "workers", lambda *_: nullcontext(workers.Workers(workers.InPlace(), lambda: 1))
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
        run(tmp_path, "--starts", "3")


def test_replay_of_an_empty_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no \.toml file"):
        files_of([tmp_path])
