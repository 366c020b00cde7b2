"""A row can be traced to the code that produced it."""

import subprocess
from pathlib import Path
from shutil import which

import pytest

from ground.recording import metadata
from runtime.cli import compiled
from study.runner.rows import ROOT, code, code_digest, machine
from tests.support.study.made import CODE


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in (
        "robot/core/brain.py",
        "plant/sim/simulation.py",
        "runtime/calibrations/none.toml",
    ):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(name)
    return tmp_path


@pytest.mark.parametrize(
    "name", ["robot/core/brain.py", "plant/new.py", "runtime/calibrations/none.toml"]
)
def test_digest_covers_files_that_a_trial_runs(tree: Path, name: str) -> None:
    before = code_digest(tree)
    (tree / name).write_text("otherwise")
    assert code_digest(tree) != before


@pytest.mark.parametrize("name", ["README.md", "study/report.py", "plant/worlds_of_others.toml"])
def test_digest_ignores_other_files(tree: Path, name: str) -> None:
    before = code_digest(tree)
    (tree / name).parent.mkdir(exist_ok=True)
    (tree / name).write_text("otherwise")
    assert code_digest(tree) == before


def test_moving_a_line_between_files_changes_the_digest(tree: Path) -> None:
    (tree / "plant/a.py").write_text("x")
    (tree / "plant/b.py").write_text("")
    before = code_digest(tree)
    (tree / "plant/a.py").write_text("")
    (tree / "plant/b.py").write_text("x")
    assert code_digest(tree) != before


@pytest.mark.skipif(which("git") is None, reason="no git on this machine")
def test_commit_is_that_of_the_checkout() -> None:
    answer = subprocess.run(
        ["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    assert code().commit == (answer.stdout.strip() or "unknown")
    assert len(code().digest) == len(CODE.digest) * 32


@pytest.mark.parametrize(
    ("listed", "known", "dirty"),
    [("abc", "abc", False), ("abc+", "abc", True), ("unknown", "unknown", False)],
)
def test_compiled_installation_reports_its_compiled_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listed: str, known: str, dirty: bool
) -> None:
    monkeypatch.setattr(metadata, "ROOT", tmp_path)
    monkeypatch.setattr(compiled, "commit", lambda: listed)
    code.cache_clear()
    try:
        assert (code().commit, code().dirty) == (known, dirty)
    finally:
        code.cache_clear()


def test_machine_info_is_complete() -> None:
    assert "unknown" not in machine()
    assert all(machine())
