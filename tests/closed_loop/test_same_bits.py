"""Random trials of the corpus have the same digests in each variant of the environment."""

import sys
from pathlib import Path

import pytest

from checks.same_bits import __main__ as command
from checks.same_bits.__main__ import attempt, compared, differences, run
from checks.same_bits.record import BitsRecord, VariantRow, page_of, read, write
from checks.same_bits.trials import TrialDigest, result_of, trial_of
from checks.same_bits.variants import Variant, of_processors, requirements, unpack

TRIALS = 6
"""`make same-bits` runs a thousand."""

VARIANTS = of_processors(sys.executable)[::-1]
"""The combination of all comes first."""


@pytest.fixture(scope="module")
def usual() -> list[TrialDigest]:
    return run(Variant("usual", sys.executable), TRIALS)


@pytest.mark.sweep(len(VARIANTS))
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_no_digest_differs(variant: Variant, usual: list[TrialDigest]) -> None:
    assert differences(usual, run(variant, TRIALS)) == []


def test_the_trials_differ_from_each_other(usual: list[TrialDigest]) -> None:
    assert len(usual) == len({result.digest for result in usual}) == TRIALS
    assert len({trial_of(number).world.name for number in range(TRIALS)}) == TRIALS


def test_a_difference_and_a_missing_trial_are_found() -> None:
    same, other, missing = (
        TrialDigest(k, f"digest {k}", f"trial {k}", "reached") for k in range(3)
    )
    assert differences([same, other, missing], [same, other._replace(digest="0")]) == [
        "trial 1",
        "trial 2",
    ]


def test_a_result_survives_its_line() -> None:
    result = TrialDigest(7, "ab", "box vgm left none 3", "timeout")
    assert result_of(result.line()) == result


def test_a_variant_that_cannot_run_counts_as_different(
    usual: list[TrialDigest], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    absent = Variant("absent", str(tmp_path / "python"))
    broken = Variant("broken", sys.executable, {"PYTHONHASHSEED": "x"})
    for variant in (absent, broken):
        assert compared(variant, usual[:1], attempt(variant, 1)) is None
        assert "cannot run" in capsys.readouterr().out


def test_the_command_compares_other_interpreters(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "of_processors", lambda _python: [])
    assert command.main(["--trials", "1", "--python", sys.executable]) == 0
    assert f"0 of 1 differ: {sys.executable}" in capsys.readouterr().out


def test_the_page_and_its_json_keep_every_variant(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    page = tmp_path / "page.md"
    arguments = ["--trials", "1", "--page", str(page)]
    monkeypatch.setattr(command, "run", lambda *_: [TrialDigest(0, "digest", "box", "reached")])
    for name in ("first", "second", "first"):
        variant = Variant(name, sys.executable)
        monkeypatch.setattr(command, "of_processors", lambda _python, one=variant: [one])
        assert command.main(arguments) == 0
    record = read(page.with_suffix(".json"))
    assert [(row.variant, row.trials, row.differing) for row in record.rows] == [
        ("second", 1, []),
        ("first", 1, []),
    ]
    assert "0 of 2 digests differ." in page.read_text()


def test_the_page_counts_differences_and_keeps_the_control_apart(tmp_path: Path) -> None:
    record = BitsRecord(machine="one", ends="3 reached")
    record.add(VariantRow("new", 3, ["trial 1"], "abc", "2026-01-01"))
    record.add(VariantRow("old", 3, ["trial 1", "trial 2"], "def", "2026-01-01", control=True))
    text = page_of(record)
    assert "1 of 3 digests differ." in text
    assert text.index("| new | 3 | 1 |") < text.index("## Control") < text.index("| old | 3 | 2 |")
    write(record, tmp_path / "page.md")
    assert read(tmp_path / "page.json") == record


def test_values_of_library_functions_are_compared(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    same = Variant("same", sys.executable, {"PYTHONHASHSEED": "4711"})
    monkeypatch.setattr(command, "of_processors", lambda _python: [same])
    page = tmp_path / "page.md"
    assert command.main(["--functions", "--page", str(page)]) == 0
    (found,) = read(page.with_suffix(".json")).functions
    assert set(found.differing.values()) == {0}
    assert "| same | 0 |" in page.read_text()


def test_differing_values_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    printed = {"usual": ["f\t1\t2\t3"], "other": ["f\t1\t0\t0"]}
    monkeypatch.setattr(command, "output", lambda variant, *_rest: printed[variant.name])
    page = tmp_path / "page.md"
    assert command.compare_functions([Variant("other", "python")], page) == 0
    assert read(page.with_suffix(".json")).functions[0].differing == {"f": 2}


def test_an_older_commit_is_unpacked_with_the_trials(tmp_path: Path) -> None:
    root = unpack("HEAD", tmp_path / "older")
    assert (root / "checks/same_bits/trials.py").exists()
    assert len(run(Variant("older", sys.executable), 1, root)) == 1


def test_lowest_libraries_are_those_of_the_project() -> None:
    lowest, newest = requirements(lowest=True), requirements(lowest=False)
    assert {"numpy==2.0.*", "pymunk==7.0.*"} <= set(lowest)
    assert {"numpy", "pymunk"} <= set(newest)
