"""The size of folders: a room that holds too much no longer says what belongs there."""

from collections import Counter
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[2]
PACKAGES: Final = (
    "runtime",
    "protocol",
    "robot",
    "plant",
    "ground",
    "study",
    "benchmarks",
    "verification",
    "examples",
    "tests",
)
MAX_MODULES: Final = 15
"""In one folder, its `__init__` included; its subfolders are counted on their own."""


def too_full(folder: Path) -> dict[str, int]:
    """Return the folders below a folder that hold too many modules, with their numbers."""
    modules = Counter(path.parent for path in folder.rglob("*.py"))
    found = {path.relative_to(folder.parent).as_posix(): n for path, n in modules.items()}
    return {path: n for path, n in found.items() if n > MAX_MODULES}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_has_more_than_fifteen_modules(package: str) -> None:
    assert too_full(ROOT / package) == {}


def test_a_folder_with_too_many_modules_is_found(tmp_path: Path) -> None:
    room = tmp_path / "robot" / "room"
    room.mkdir(parents=True)
    for number in range(MAX_MODULES + 1):
        (room / f"module_{number}.py").touch()
    assert too_full(tmp_path / "robot") == {"robot/room": MAX_MODULES + 1}
    (room / "module_0.py").unlink()
    assert too_full(tmp_path / "robot") == {}
