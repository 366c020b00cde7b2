"""The build compiles only when asked to, and says why it cannot."""

import json
import subprocess
import tomllib
from pathlib import Path
from shutil import which

import pytest

import hatch_build

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("value", "wanted"), [("", False), ("0", False), ("1", True)])
def test_only_the_value_1_compiles(
    monkeypatch: pytest.MonkeyPatch, value: str, wanted: bool
) -> None:
    monkeypatch.setenv(hatch_build.SWITCH, value)
    assert hatch_build.is_wanted() is wanted


@pytest.mark.parametrize("value", ["yes", "2", " 1"])
def test_another_value_of_the_switch_is_refused(
    monkeypatch: pytest.MonkeyPatch, value: str
) -> None:
    monkeypatch.setenv(hatch_build.SWITCH, value)
    with pytest.raises(SystemExit, match=f"SIDESTEP_COMPILE={value}: use 1 to compile"):
        hatch_build.is_wanted()


def test_a_missing_compiler_is_named_with_the_package_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    with pytest.raises(SystemExit, match="no C compiler 'no-such-compiler': install gcc"):
        hatch_build.check_compiler()


def test_missing_headers_of_python_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("CC", "sh")
    monkeypatch.setattr("sysconfig.get_paths", lambda: {"include": str(tmp_path)})
    with pytest.raises(SystemExit, match="install python3-dev"):
        hatch_build.check_compiler()


def test_a_pattern_without_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"no file matches modules = 'robot/cor/\*.py'"):
        hatch_build.sources_in(tmp_path, ["robot/cor/*.py"])


def test_modules_of_other_sources_are_refused(tmp_path: Path) -> None:
    sources = ["runtime/elementary.py"]
    (tmp_path / hatch_build.HASHES).write_text(json.dumps(hatch_build.hashes(ROOT, sources)))
    hatch_build.check(tmp_path, ROOT, sources)
    with pytest.raises(SystemExit, match="are those of other sources"):
        hatch_build.check(tmp_path, ROOT, [*sources, "robot/core/brain.py"])
    with pytest.raises(SystemExit, match="are those of other sources"):
        hatch_build.check(tmp_path / "nowhere", ROOT, sources)


def test_the_modules_named_in_the_project_are_found() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    hooks = project["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]
    sources = hatch_build.sources_in(ROOT, hooks["custom"]["modules"])
    assert {"robot/core/brain.py", "plant/sim/sonar.py"} <= set(sources)
    assert not [name for name in sources if name.endswith("__init__.py")]


def test_sources_reach_what_they_import() -> None:
    paths = hatch_build.reached(ROOT, ["study/trial/core_loop.py"])
    found = {path.relative_to(ROOT).as_posix() for path in paths}
    assert {"study/trial/core_loop.py", "robot/core/brain.py", "robot/core/__init__.py"} <= found
    assert not [name for name in found if name.startswith("ground/")]


@pytest.mark.skipif(which("git") is None, reason="no git on this machine")
def test_the_commit_is_known_in_a_checkout_only(tmp_path: Path) -> None:
    assert hatch_build.commit_of(tmp_path) == "unknown"

    def git(*words: str) -> str:
        author = ("-c", "user.name=A", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
        run = ("git", "-C", str(tmp_path), *author, *words)
        return subprocess.run(run, check=True, capture_output=True, text=True).stdout.strip()

    git("init", "--quiet")
    assert hatch_build.commit_of(tmp_path) == "unknown"
    (tmp_path / "a.py").write_text("x = 1\n")
    git("add", "a.py")
    git("commit", "--quiet", "-m", "a")
    (tmp_path / "untracked").touch()
    assert hatch_build.commit_of(tmp_path) == git("rev-parse", "HEAD")
    (tmp_path / "a.py").write_text("x = 2\n")
    assert hatch_build.commit_of(tmp_path) == git("rev-parse", "HEAD") + "+"
