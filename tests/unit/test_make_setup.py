"""`make setup` with a fake Python that records its arguments, without a network."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FINISHED = "sidestep 0.1.0"

PYTHON = f"""#!/bin/sh
case "$*" in
    *"-m venv"*) ;;
    *) exec {sys.executable} "$@" ;;
esac
echo "venv" >>asked
mkdir -p .venv/bin
cp env_python .venv/bin/python
printf '#!/bin/sh\\necho {FINISHED}\\n' >.venv/bin/sidestep
chmod +x .venv/bin/sidestep
"""
ENV_PYTHON = """#!/bin/sh
echo "$*" >>asked
echo "words of pip"
[ ! -e broken ]
"""
WITHOUT_VENV = f"""#!/bin/sh
case "$*" in
    *ensurepip*) exit 1 ;;
    *) exec {sys.executable} "$@" ;;
esac
"""


def executable(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o755)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    folder = tmp_path / "tree"
    folder.mkdir()
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, folder)
    executable(folder / "fake_python", PYTHON)
    executable(folder / "env_python", ENV_PYTHON)
    return folder


def make(folder: Path, pythons: str = "./fake_python") -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS"))}
    return subprocess.run(
        ["make", "setup", f"PYTHONS={pythons}"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def asked(folder: Path) -> list[str]:
    """Return the calls since the last time, in short: venv, or what pip was to install."""
    lines = (folder / "asked").read_text().splitlines() if (folder / "asked").exists() else []
    (folder / "asked").unlink(missing_ok=True)
    return [line.partition("constraints.txt ")[2] or line for line in lines]


INSTALLS = ["hatchling editables", "--no-build-isolation -e .[dev]"]


def test_first_setup_does_everything_and_hides_pip_output(tree: Path) -> None:
    run = make(tree)
    assert (run.returncode, run.stderr) == (0, "")
    assert asked(tree) == ["venv", *INSTALLS]
    assert FINISHED in run.stdout
    assert "words of pip" not in run.stdout


def test_second_setup_does_nothing(tree: Path) -> None:
    make(tree)
    asked(tree)
    assert make(tree).returncode == 0
    assert asked(tree) == []


@pytest.mark.parametrize("changed", ["constraints.txt", "pyproject.toml"])
def test_after_a_change_only_pip_runs(tree: Path, changed: str) -> None:
    make(tree)
    asked(tree)
    soon = (tree / ".venv" / "ready").stat().st_mtime + 1
    os.utime(tree / changed, (soon, soon))
    assert make(tree).returncode == 0
    assert asked(tree) == INSTALLS


def test_pip_failure_is_shown_and_setup_repeated_next_time(tree: Path) -> None:
    (tree / "broken").touch()
    run = make(tree)
    assert run.returncode == 2
    assert "words of pip" in run.stderr
    assert "pip could not install hatchling editables" in run.stderr
    asked(tree)
    (tree / "broken").unlink()
    assert make(tree).returncode == 0
    assert asked(tree) == ["venv", *INSTALLS]


def test_a_tree_that_was_moved_is_set_up_afresh(tree: Path) -> None:
    make(tree)
    asked(tree)
    moved = tree.rename(tree.parent / "elsewhere")
    assert make(moved).returncode == 0
    assert asked(moved) == ["venv", *INSTALLS]


def test_an_environment_whose_python_is_gone_is_made_afresh(tree: Path) -> None:
    make(tree)
    asked(tree)
    (tree / ".venv" / "bin" / "python").unlink()
    assert make(tree).returncode == 0
    assert asked(tree) == ["venv", *INSTALLS]


def test_missing_python_is_reported_with_what_to_install(tree: Path) -> None:
    executable(tree / "old", "#!/bin/sh\nexit 1\n")
    run = make(tree, pythons="./old python-not-there")
    assert run.returncode == 2
    assert "no Python from 3.11 to 3.13" in run.stderr
    assert "apt install python3 python3-venv" in run.stderr
    assert not (tree / ".venv").exists()


def test_python_without_venv_is_reported_with_its_package(tree: Path) -> None:
    executable(tree / "python3.12", WITHOUT_VENV)
    run = make(tree, pythons="./python3.12")
    assert run.returncode == 2
    assert "apt install ./python3.12-venv" in run.stderr


def test_python_without_venv_is_skipped_for_another(tree: Path) -> None:
    executable(tree / "python3.12", WITHOUT_VENV)
    assert make(tree, pythons="./python3.12 ./fake_python").returncode == 0
