"""The wheel: it carries what runs and nothing else, and runs away from the tree."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path
from typing import Final

import pytest

from checks import built

pytestmark = pytest.mark.stack

ROOT: Final = Path(__file__).parents[2]
WHEEL: Final = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"][
    "targets"
]["wheel"]
METADATA: Final = "Metadata-Version: 2.1\nName: robotframework\nVersion: 7.5\n"
PACKAGES: Final = WHEEL["only-include"]


def tried(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run it as an installed program is run: without the path of these tests."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)


def run(*command: str | Path, cwd: Path) -> str:
    done = tried(*command, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def wheel() -> Path:
    """Return the wheel of this tree, which is built once for all runs."""
    return built.wheel(compiled=False)


@pytest.fixture(scope="session")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install this wheel in an environment; return its executable."""
    return environment(tmp_path_factory.mktemp("env"), wheel)


@pytest.fixture(scope="session")
def beside_robot_framework(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the executable after another distribution installed a package `robot`."""
    place = tmp_path_factory.mktemp("shared")
    other = place / "robotframework-7.5-py3-none-any.whl"
    info = "robotframework-7.5.dist-info"
    with zipfile.ZipFile(other, "w") as archive:
        for file in ("robot/__init__.py", "robot/run.py", "robot/running/model.py"):
            archive.writestr(file, "")
        archive.writestr(f"{info}/METADATA", METADATA)
        archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\n")
        archive.writestr(f"{info}/RECORD", "")
    return environment(place / "env", wheel, other)


def environment(place: Path, *wheels: Path) -> Path:
    """Make one with these wheels, and with the dependencies of the tests; return `sidestep`."""
    venv.create(place)
    python = place / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check"]
    for wheel in wheels:
        run(*pip, "install", "--quiet", "--no-deps", "--no-index", wheel, cwd=place)
    borrow_dependencies(python)
    return place / "bin" / "sidestep"


def borrow_dependencies(python: Path) -> None:
    """Let the new environment see what the tests' own has installed, but not the tree itself."""
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(run(python, "-c", ask, cwd=python.parent).strip())
    (site / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")


def test_the_wheel_carries_every_file_of_its_packages(wheel: Path) -> None:
    carried = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for pattern in ("*.py", "*.toml", "*.xml", "py.typed")
        for path in (ROOT / package).rglob(pattern)
    }
    assert wanted <= carried


def test_the_wheel_carries_no_other_package(wheel: Path) -> None:
    tops = {name.partition("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    (metadata,) = (top for top in tops if top.endswith(".dist-info"))
    assert tops == {*PACKAGES, metadata}


def test_the_installed_wheel_starts_away_from_the_tree(installed: Path, tmp_path: Path) -> None:
    assert run(installed, "--version", cwd=tmp_path).startswith("sidestep 0.")
    assert "u_trap" in run(installed, "worlds", "list", cwd=tmp_path)


@pytest.mark.parametrize("words", [["bench", "codec"], ["bench", "--help"], ["bench"]])
def test_bench_of_the_wheel_asks_for_a_checkout(installed: Path, words: list[str]) -> None:
    # Not even in the tree: what is installed there may be another version.
    done = tried(installed, *words, cwd=ROOT)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("sidestep bench: needs a checkout of the source")
    assert done.stderr.count("\n") == 1


def test_verb_names_the_distribution_that_shadows_it(
    beside_robot_framework: Path, tmp_path: Path
) -> None:
    done = tried(beside_robot_framework, "run", "robot", "--help", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith(
        "sidestep run robot: package `robot`: robotframework 7.5 has replaced "
    )
    assert "`python3 -m venv`, `pipx install` or `uvx --from`" in done.stderr


def test_doctor_warns_about_a_shared_package(beside_robot_framework: Path, tmp_path: Path) -> None:
    nowhere = ("--connect", "tcp/127.0.0.1:1", "--json")
    done = tried(beside_robot_framework, "doctor", *nowhere, cwd=tmp_path)
    findings = json.loads(done.stdout)["findings"]
    (found,) = (found for found in findings if "robotframework 7.5" in found["what"])
    assert found["bad"]
    assert "pipx" in found["do"]


def test_doctor_of_a_wheel_alone_finds_no_package_of_others(
    installed: Path, tmp_path: Path
) -> None:
    done = tried(installed, "doctor", "--connect", "tcp/127.0.0.1:1", "--json", cwd=tmp_path)
    findings = json.loads(done.stdout)["findings"]
    assert [found["what"] for found in findings if "package" in found["what"]] == []


TYPED: Final = """\
import asyncio

import sidestep
from sidestep import GoalEnded, Mission, Refused, Robot, Waypoint


async def drive(robot: Robot) -> float | None:
    mission = Mission(waypoints=(Waypoint(x_m=1.0, y_m=2.0),))
    sidestep.agreed(await robot.mission.upload(mission))
    ended: GoalEnded | Refused = await robot.goto(5.4, 2.0)
    robot.fly()  # type: ignore[attr-defined]
    sidestep.fly()  # type: ignore[attr-defined]
    return None if isinstance(ended, Refused) else ended.wall_s


async def main() -> None:
    async with sidestep.connect() as robot:
        print(await drive(robot))


asyncio.run(main())
"""
"""Without types, mypy would complain that it has nothing to ignore."""
PROGRAMS: Final = sorted((ROOT / "tests" / "data" / "programs").glob("*.py"))
"""A square, a patrol, two robots at once, trials, and telemetry as tables."""


def test_a_users_script_passes_strict_mypy_with_the_wheel(installed: Path, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(TYPED)
    python = str(installed.parent / "python")
    words = ("-m", "mypy", "--strict", "--config-file=", "--python-executable", python)
    # Away from the tree, whose packages mypy would check instead of those of the wheel.
    copies = [shutil.copy(program, tmp_path) for program in PROGRAMS]
    assert len(copies) == 5
    assert "Success" in run(python, *words, script, *copies, cwd=tmp_path)


def test_the_package_shows_its_api_only(installed: Path, tmp_path: Path) -> None:
    code = (
        "import sys, sidestep; before = set(sys.modules); print(*dir(sidestep));"
        "print({'ground', 'zenoh'} & before, hasattr(sidestep, 'main'), sidestep.Robot.__name__)"
    )
    names, facts = run(installed.parent / "python", "-c", code, cwd=tmp_path).splitlines()
    assert {"Robot", "connect", "GoalState", "operations"} <= set(names.split())
    assert not {"main", "sys", "os", "api", "ROOT"} & set(names.split())
    assert facts == "set() False Robot"
