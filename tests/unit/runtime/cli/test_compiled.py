"""Compiled modules are used only with the sources they were made of."""

import json
from hashlib import sha256
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

import sidestep
from runtime.cli import compiled

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
    monkeypatch.setattr(sidestep.own("compiled"), "complaint", lambda: "brain.py has changed")
    assert sidestep.main(["trial", "--world", "box"]) == 2
    assert capsys.readouterr().err == "sidestep trial: brain.py has changed\n"


@pytest.mark.parametrize(("is_compiled", "end"), [(True, " (compiled)\n"), (False, "0\n")])
def test_the_version_shows_compiled_modules(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    is_compiled: bool,
    end: str,
) -> None:
    monkeypatch.setattr(sidestep, "version", lambda: "1.0")
    monkeypatch.setattr(sidestep.own("compiled"), "is_compiled", lambda: is_compiled)
    assert sidestep.main(["--version"]) == 0
    assert capsys.readouterr().out.endswith(end)


def test_the_checkout_contains_no_compiled_module() -> None:
    assert list(compiled.compiled_modules(compiled.ROOT)) == []
