"""A file is replaced completely, or left unchanged with a reason."""

import re
from pathlib import Path

import pytest

from ground.recording import export_file
from runtime.errors import UserError


def test_symbolic_link_is_preserved(tmp_path: Path) -> None:
    real, link = tmp_path / "kept" / "tour.toml", tmp_path / "tour.toml"
    real.parent.mkdir()
    real.write_text("before")
    link.symlink_to(real)
    export_file.replace(link, "after")
    assert link.is_symlink()
    assert real.read_text() == "after"
    assert [path.name for path in real.parent.iterdir()] == ["tour.toml"]


@pytest.mark.parametrize("name", ["with blank.toml", "-x.toml", "ä\n*?.toml", ".toml", "a" * 240])
def test_unusual_file_names_are_accepted(tmp_path: Path, name: str) -> None:
    export_file.replace(tmp_path / name, "text")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "text"


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("no/such/file.toml", "no such file or directory"),
        ("folder", "is a directory"),
        ("file/below", "not a directory"),
        ("a" * 256, "file name too long"),
    ],
)
def test_failed_replace_names_the_reason_and_changes_nothing(
    tmp_path: Path, name: str, why: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("names_in")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(UserError, match=f"{re.escape(name)}: .*{why}"):
        export_file.replace(tmp_path / name, "text")
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "file").read_text() == "names_in"
