"""The same trial gives the same digest: with every Python, processor, and compiled."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import hatch_build
from checks.built import ROOT, wheel
from checks.same_bits import __main__ as command
from checks.same_bits.__main__ import (
    BitsRecord,
    Variant,
    VariantRow,
    attempt,
    compared,
    differences,
    of_processors,
    page_of,
    read,
    requirements,
    run,
    unpack,
    write,
)
from checks.same_bits.trials import TrialDigest, result_of, trial_of
from protocol.navigators import NAVIGATORS
from runtime.cli import compiled
from tests.support import digests
from tests.support.compiled import installed, is_compiled, outcomes, run_python
from tests.support.digests import Run
from tests.support.each import each

KNOWN = digests.committed()["digests"]
RUNS = list(digests.runs())

ELSEWHERE = """
import sys
from tests.support.digests import Run
for navigator in sys.argv[1:]:
    print(Run("u_trap", navigator, "harsh").digest())
"""


@each("run", RUNS)
def test_a_trial_has_its_committed_digest(run: Run) -> None:
    digest = run.digest()
    assert digest == KNOWN[str(run)], digests.difference(str(run), digest)


PLAIN_PROCESSOR = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3",
}
"""The C library and numpy compute without instructions that round differently."""


def test_other_hashes_and_a_plainer_processor_drive_the_same_way() -> None:
    child = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, *NAVIGATORS],
        cwd=Path(__file__).parents[2],
        env={**os.environ, **PLAIN_PROCESSOR, "PYTHONHASHSEED": "4711"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    known = [KNOWN[f"u_trap/{navigator}/harsh"] for navigator in NAVIGATORS]
    assert child.stdout.split() == known, child.stderr


def test_the_trials_differ_from_each_other() -> None:
    """Equal digests would prove nothing if every run had the same one."""
    assert {"bug", "vgm"} <= {run.navigator for run in RUNS}
    assert len({KNOWN[str(run)] for run in RUNS if run.navigator == "vgm"}) == len(
        [run for run in RUNS if run.navigator == "vgm"]
    )


def test_every_trial_of_the_set_has_a_committed_digest() -> None:
    assert sorted(KNOWN) == sorted(map(str, digests.runs()))


def test_a_difference_names_other_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    name = next(iter(KNOWN))
    assert digests.difference(name, "00") == f"{name}: 00 instead of the committed {KNOWN[name]}"
    monkeypatch.setattr(digests, "versions", lambda: {"numpy": "1"})
    assert "here are {'numpy': '1'}" in digests.difference(name, "00")


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


def test_trials_of_the_corpus_differ_from_each_other(usual: list[TrialDigest]) -> None:
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


COMPILED_TRIALS = ("-m", "tests.support.compiled")
CORE = "robot/core/brain.py"


@pytest.fixture(scope="session")
def installation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.getbasetemp()
    return installed(base.parent if "PYTEST_XDIST_WORKER" in os.environ else base)


@pytest.fixture
def changed(installation: Path) -> Iterator[Path]:
    """Yield the source of a compiled module; restore it after the test."""
    source = installation / CORE
    before = source.read_bytes()
    yield source
    source.write_bytes(before)


def test_compiled_trials_equal_those_of_pure_python(
    installation: Path, pytestconfig: pytest.Config
) -> None:
    whole = pytestconfig.getoption("--examples") == "long"
    run = run_python(installation, *COMPILED_TRIALS, *(["all"] if whole else []))
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["compiled"]
    assert not is_compiled()
    expected = outcomes(whole)
    assert {name for name in expected if found["outcomes"][name] != expected[name]} == set()
    assert len(set(expected.values())) > (100 if whole else 20)


def test_every_listed_module_is_loaded_compiled(installation: Path) -> None:
    names = [name.removesuffix(".py").replace("/", ".") for name in compiled.sources(installation)]
    code = f"import importlib; [print(importlib.import_module(n).__file__) for n in {names}]"
    files = run_python(installation, "-c", code).stdout.splitlines()
    assert len(files) == len(names) > 40
    assert not [file for file in files if file.endswith(".py")]


def test_study_sends_trials_to_compiled_workers(installation: Path, tmp_path: Path) -> None:
    words = ("study", "--worlds", "box", "--noise", "none", "--no-report", "--output")
    run = run_python(installation, "-m", "sidestep", *words, str(tmp_path))
    assert run.returncode == 0, run.stderr
    assert "reached" in run.stdout + run.stderr


def test_compiled_installation_knows_its_commit(installation: Path) -> None:
    code = "from study.runner.rows import code; print(code().commit)"
    known = run_python(installation, "-c", code).stdout.strip()
    assert known == hatch_build.commit_of(ROOT).removesuffix("+") != ""


def test_version_names_a_compiled_installation(installation: Path) -> None:
    assert run_python(installation, "-m", "sidestep", "--version").stdout.endswith(" (compiled)\n")


def test_a_changed_source_of_a_compiled_module_is_refused(
    installation: Path, changed: Path
) -> None:
    changed.write_text(changed.read_text() + "\n# changed\n")
    run = run_python(installation, "-m", "sidestep", "trial", "--world", "box")
    assert (run.returncode, run.stdout) == (2, "")
    assert f"{CORE} has changed since it was compiled" in run.stderr


def test_a_build_without_the_switch_is_pure() -> None:
    assert wheel(compiled=False).name.endswith("-py3-none-any.whl")


def test_an_editable_build_is_refused_by_name() -> None:
    call = "from hatchling.build import build_editable; build_editable('.')"
    run = subprocess.run(
        [sys.executable, "-c", call],
        cwd=ROOT,
        env={**os.environ, hatch_build.SWITCH: "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 1
    assert "SIDESTEP_COMPILE: an editable install is not compiled" in run.stderr
