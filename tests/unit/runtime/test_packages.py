"""Foreign packages with our names, and compiled modules beside their sources."""

import base64
import hashlib
import json
import sys
from hashlib import sha256
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from runtime.cli import compiled, packages
from runtime.cli.packages import APART, PACKAGES, ROOT, broken_files, conflicts, displaced
from sidestep import __main__ as executable

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
    monkeypatch.setattr(packages, "ROOT", tmp_path)
    monkeypatch.setattr(packages, "displaced", list)
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
    assert conflicts() == []


def test_files_replaced_by_another_distribution_are_named(site: Path) -> None:
    record(site, "robotframework", "robot/run.py", "robot/running/model.py")
    (found,) = conflicts()
    assert (found.wins, found.do) == (True, APART)
    assert found.what == f"package `robot`: robotframework 7.5 has replaced {site}/robot/run.py"


def test_a_folder_shared_with_another_distribution_is_a_warning(site: Path) -> None:
    record(site, "robotframework", "robot/running/model.py")
    (found,) = conflicts()
    assert (found.wins, found.do) == (False, APART)
    assert found.what == f"package `robot`: robotframework 7.5 has files in {site}/robot, too"


def test_files_taken_away_with_another_distribution_are_named(site: Path) -> None:
    (site / "robot" / "run.py").unlink()
    (found,) = conflicts()
    assert found.wins
    assert str(found) == f"file {site}/robot/run.py of package `robot` is missing: " + (
        "install sidestep again"
    )


def test_a_file_changed_by_hand_is_no_conflict(site: Path) -> None:
    (site / "plant" / "__init__.py").write_text("mine = 2\n")
    assert broken_files() == {"plant": site / "plant" / "__init__.py"}
    assert conflicts() == []


def test_a_path_cannot_steer_the_terminal() -> None:
    assert packages.shown(Path("/tmp/\x1b[2Jx")) == "/tmp/?[2Jx"


NAME = "robot/core/brain.py"
TEXT = "x = 1\n"


@pytest.fixture
def installation(tmp_path: Path) -> Path:
    """Return an installation with one compiled module."""
    source = tmp_path / NAME
    source.parent.mkdir(parents=True)
    source.write_text(TEXT)
    module_of(source).touch()
    (tmp_path / "runtime").mkdir()
    digest = sha256(TEXT.encode()).hexdigest()
    (tmp_path / compiled.LIST).write_text(json.dumps({"sources": {NAME: digest}}))
    return tmp_path


def module_of(source: Path, suffix: str = EXTENSION_SUFFIXES[0]) -> Path:
    return source.with_suffix(suffix)


def test_matching_modules_are_no_reason_to_complain(installation: Path) -> None:
    assert compiled.is_compiled(installation)
    assert compiled.complaint(installation) == ""


def test_the_compiled_commit_is_read(installation: Path) -> None:
    assert compiled.commit(installation) == "unknown"
    content = json.loads((installation / compiled.LIST).read_text())
    (installation / compiled.LIST).write_text(json.dumps({"commit": "abc+", **content}))
    assert compiled.commit(installation) == "abc+"
    assert compiled.sources(installation) == content["sources"]


def test_a_changed_source_is_named_with_the_remedy(installation: Path) -> None:
    (installation / NAME).write_text("x = 2\n")
    assert compiled.complaint(installation).startswith(f"{NAME} has changed since it was compiled")
    assert compiled.REMEDY in compiled.complaint(installation)


def test_a_missing_source_counts_as_changed(installation: Path) -> None:
    (installation / NAME).unlink()
    assert compiled.complaint(installation).startswith(f"{NAME} has changed since it was compiled")


def test_a_missing_compiled_module_is_named(installation: Path) -> None:
    module_of(installation / NAME).unlink()
    assert compiled.complaint(installation).startswith(f"the compiled module of {NAME} is missing")


@pytest.mark.parametrize("suffix", EXTENSION_SUFFIXES)
def test_a_compiled_module_without_a_list_is_named(tmp_path: Path, suffix: str) -> None:
    module = module_of(tmp_path / "plant/sim/drive.py", suffix)
    module.parent.mkdir(parents=True)
    module.touch()
    assert not compiled.is_compiled(tmp_path)
    assert compiled.complaint(tmp_path).startswith("plant/sim/drive.py is compiled here")
    assert f"delete plant/sim/drive{suffix}" in compiled.complaint(tmp_path)


def test_a_module_of_another_python_is_ignored(tmp_path: Path) -> None:
    module = module_of(tmp_path / NAME, ".cpython-27-x86_64-linux-gnu.so")
    module.parent.mkdir(parents=True)
    module.touch()
    assert compiled.complaint(tmp_path) == ""


def test_the_executable_refuses_modules_that_do_not_match(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(executable.own("compiled"), "complaint", lambda: "brain.py has changed")
    assert executable.main(["trial", "--world", "box"]) == 2
    assert capsys.readouterr().err == "sidestep trial: brain.py has changed\n"


@pytest.mark.parametrize(("is_compiled", "end"), [(True, " (compiled)\n"), (False, "0\n")])
def test_the_version_shows_compiled_modules(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    is_compiled: bool,
    end: str,
) -> None:
    monkeypatch.setattr(executable, "version", lambda: "1.0")
    monkeypatch.setattr(executable.own("compiled"), "is_compiled", lambda: is_compiled)
    assert executable.main(["--version"]) == 0
    assert capsys.readouterr().out.endswith(end)


def test_the_checkout_contains_no_compiled_module() -> None:
    assert list(compiled.compiled_modules(compiled.ROOT)) == []
