"""What is installed elsewhere is what is in the tree."""

import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[2]
PACKAGES = ("protocol", "robot", "plant", "ground", "study", "benchmarks")


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet"]
    run(*pip, "--no-deps", "--no-build-isolation", "--wheel-dir", folder, ROOT, cwd=folder)
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_carries_worlds_and_dialect_and_no_tests(wheel: Path) -> None:
    carried = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for pattern in ("*.py", "*.toml", "*.xml")
        for path in (ROOT / package).rglob(pattern)
    }
    assert wanted <= carried
    assert not [name for name in carried if name.startswith(("tests/", "docs/", ".ci/"))]


def test_the_installed_wheel_starts_away_from_the_tree(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "env")
    python = tmp_path / "env" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check"]
    run(*pip, "install", "--quiet", "--no-deps", "--no-index", wheel, cwd=tmp_path)
    executable = tmp_path / "env" / "bin" / "sidestep"
    assert run(executable, "--version", cwd=tmp_path).startswith("sidestep 0.")
    borrow_dependencies(python)
    assert "u_trap" in run(executable, "worlds", "list", cwd=tmp_path)


def borrow_dependencies(python: Path) -> None:
    """Let the new environment see what the tests' own has installed, but not the tree itself."""
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(run(python, "-c", ask, cwd=python.parent).strip())
    (site / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
