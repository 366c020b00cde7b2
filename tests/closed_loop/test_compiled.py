"""The compiled core and simulation do the same as their sources, to the last bit."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import hatch_build
from checks.built import ROOT, wheel
from runtime.cli import compiled
from tests.support.compiled.installation import installed, run_python
from tests.support.compiled.trials import is_compiled, outcomes

TRIALS = ("-m", "tests.support.compiled.trials")
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
    run = run_python(installation, *TRIALS, *(["all"] if whole else []))
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
    run = run_python(installation, "sidestep.py", *words, str(tmp_path))
    assert run.returncode == 0, run.stderr
    assert "reached" in run.stdout + run.stderr


def test_compiled_installation_knows_its_commit(installation: Path) -> None:
    code = "from study.runner.rows import code; print(code().commit)"
    known = run_python(installation, "-c", code).stdout.strip()
    assert known == hatch_build.commit_of(ROOT).removesuffix("+") != ""


def test_version_names_a_compiled_installation(installation: Path) -> None:
    assert run_python(installation, "sidestep.py", "--version").stdout.endswith(" (compiled)\n")


def test_a_changed_source_of_a_compiled_module_is_refused(
    installation: Path, changed: Path
) -> None:
    changed.write_text(changed.read_text() + "\n# changed\n")
    run = run_python(installation, "sidestep.py", "trial", "--world", "box")
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
