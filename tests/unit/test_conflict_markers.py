"""No file of the project contains the markers of a merge that was not resolved."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
MARKER: Final = re.compile(rb"^(?:<{7}|>{7}) \S", re.MULTILINE)
SUFFIXES: Final = {".c", ".h", ".json", ".md", ".py", ".toml", ".xml", ".yml"}
FOLDERS: Final = (
    *("checks", "docs", "examples", "ground", "plant", "protocol"),
    *("robot", "runtime", "study", "tests"),
)


def marked(root: Path) -> Iterator[Path]:
    """Yield the text files below a folder that contain a marker."""
    for path in root.rglob("*"):
        if path.suffix in SUFFIXES and MARKER.search(path.read_bytes()):
            yield path


def test_no_file_has_an_unresolved_merge() -> None:
    top = [path for path in ROOT.glob("*.md") if MARKER.search(path.read_bytes())]
    assert [*top, *(path for name in FOLDERS for path in marked(ROOT / name))] == []


def test_an_unresolved_merge_is_found(tmp_path: Path) -> None:
    page, whole = tmp_path / "page.md", tmp_path / "whole.md"
    page.write_text(f"one\n{'<' * 7} HEAD\ntwo\n{'=' * 7}\nthree\n{'>' * 7} other\n")
    whole.write_text(f"{'<' * 8} a heading\n{'=' * 7}\n")
    assert list(marked(tmp_path)) == [page]
