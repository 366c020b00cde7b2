"""Random trials of the corpus have the same digests in each variant of the environment."""

import sys
from pathlib import Path

import pytest

from verification.same_bits import __main__ as command
from verification.same_bits.__main__ import attempt, compared, differences, run
from verification.same_bits.trials import Result, result_of, trial_of
from verification.same_bits.variants import Variant, of_processors, requirements

TRIALS = 12
"""`make same-bits` runs a thousand."""

VARIANTS = of_processors(sys.executable)


@pytest.fixture(scope="module")
def usual() -> list[Result]:
    return run(Variant("usual", sys.executable), TRIALS)


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_no_digest_differs(variant: Variant, usual: list[Result]) -> None:
    assert differences(usual, run(variant, TRIALS)) == []


def test_the_trials_differ_from_each_other(usual: list[Result]) -> None:
    assert len(usual) == len({result.digest for result in usual}) == TRIALS
    assert len({trial_of(number).world.name for number in range(TRIALS)}) == TRIALS


def test_a_difference_and_a_missing_trial_are_found() -> None:
    same, other, missing = (Result(k, f"digest {k}", f"trial {k}", "reached") for k in range(3))
    assert differences([same, other, missing], [same, other._replace(digest="0")]) == [
        "trial 1",
        "trial 2",
    ]


def test_a_result_survives_its_line() -> None:
    result = Result(7, "ab", "box vgm left none 3", "timeout")
    assert result_of(result.line()) == result


def test_a_variant_that_cannot_run_counts_as_different(
    usual: list[Result], tmp_path: Path, capsys: pytest.CaptureFixture[str]
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


def test_lowest_libraries_are_those_of_the_project() -> None:
    lowest, newest = requirements(lowest=True), requirements(lowest=False)
    assert {"numpy==2.0.*", "pymunk==7.0.*"} <= set(lowest)
    assert {"numpy", "pymunk"} <= set(newest)
