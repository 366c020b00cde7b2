"""Foreign packages with our names: in the working directory, on the path, in our folders."""

import base64
import hashlib
import sys
from pathlib import Path

import pytest

from runtime.cli import conflicts, packages
from runtime.cli.conflicts import broken_files
from runtime.cli.packages import APART, PACKAGES, ROOT, displaced

OURS = "our = 1\n"


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make Python search for our packages again."""
    for name in PACKAGES:
        monkeypatch.delitem(sys.modules, name, raising=False)


def shadow(folder: Path, name: str) -> Path:
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text("raise RuntimeError('imported')\n")
    return folder


def record(site: Path, name: str, *files: str) -> None:
    """Install a distribution: write each of its files and the list of them."""
    lines = []
    for file in files:
        place = site / file
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(f"{OURS}# {name}\n")
        digest = base64.urlsafe_b64encode(hashlib.sha256(place.read_bytes()).digest())
        lines.append(f"{file},sha256={digest.rstrip(b'=').decode()},1")
    lines.append(f"{Path(file).parent}/__pycache__/{Path(file).stem}.pyc,,")
    info = site / f"{name}-7.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 7.5\n")
    (info / "RECORD").write_text("\n".join([*lines, f"{info.name}/RECORD,,"]))


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an installation of ours with two packages that Python finds."""
    for module in (conflicts, packages):
        monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(conflicts, "displaced", list)
    monkeypatch.syspath_prepend(tmp_path)
    record(tmp_path, "sidestep", "robot/__init__.py", "robot/run.py", "plant/__init__.py")
    return tmp_path


@pytest.mark.usefixtures("forgotten")
def test_our_own_packages_are_not_displaced() -> None:
    assert list(displaced()) == []


@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_earlier_on_the_path_displaces_ours(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(shadow(tmp_path, name))
    (found,) = displaced()
    assert found.wins
    assert f"package `{name}` at {tmp_path / name}, not at {ROOT / name}" in found.what
    assert found.do == APART


@pytest.mark.usefixtures("forgotten")
def test_a_module_displaces_a_package_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "study.py").write_text("raise RuntimeError('imported')\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert [str(tmp_path / "study.py") in found.what for found in displaced()] == [True]


@pytest.mark.usefixtures("forgotten")
def test_a_folder_without_a_package_displaces_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robot").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    assert list(displaced()) == []


@pytest.mark.usefixtures("forgotten")
def test_remedy_depends_on_the_cause(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(shadow(tmp_path, "ground"))
    monkeypatch.setenv("PYTHONPATH", f"/nowhere:{tmp_path}")
    assert [found.do for found in displaced()] == [f"take {tmp_path} out of PYTHONPATH"]
    monkeypatch.delenv("PYTHONPATH")
    monkeypatch.chdir(tmp_path)
    assert [found.do for found in displaced()] == ["start sidestep in another folder"]


def test_packages_without_foreign_files_are_no_conflict(site: Path) -> None:
    record(site, "other", "other/__init__.py")
    assert conflicts.conflicts() == []


def test_files_replaced_by_another_distribution_are_named(site: Path) -> None:
    record(site, "robotframework", "robot/run.py", "robot/running/model.py")
    (found,) = conflicts.conflicts()
    assert (found.wins, found.do) == (True, APART)
    assert found.what == f"package `robot`: robotframework 7.5 has replaced {site}/robot/run.py"


def test_a_folder_shared_with_another_distribution_is_a_warning(site: Path) -> None:
    record(site, "robotframework", "robot/running/model.py")
    (found,) = conflicts.conflicts()
    assert (found.wins, found.do) == (False, APART)
    assert found.what == f"package `robot`: robotframework 7.5 has files in {site}/robot, too"


def test_files_taken_away_with_another_distribution_are_named(site: Path) -> None:
    (site / "robot" / "run.py").unlink()
    (found,) = conflicts.conflicts()
    assert found.wins
    assert str(found) == f"file {site}/robot/run.py of package `robot` is missing: " + (
        "install sidestep again"
    )


def test_a_file_changed_by_hand_is_no_conflict(site: Path) -> None:
    (site / "plant" / "__init__.py").write_text("mine = 2\n")
    assert broken_files() == {"plant": site / "plant" / "__init__.py"}
    assert conflicts.conflicts() == []


def test_a_path_cannot_steer_the_terminal() -> None:
    assert packages.shown(Path("/tmp/\x1b[2Jx")) == "/tmp/?[2Jx"
