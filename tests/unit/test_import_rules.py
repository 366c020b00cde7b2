"""Modules that may import the large libraries, where import contracts cannot express it."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "protocol",
    "robot",
    "firmware",
    "plant",
    "ground",
    "gateways",
    "vehicle_check",
    "study",
)
MAY_IMPORT = {
    "zenoh": ("protocol/bus/",),
    "pymunk": ("plant/sim/physics.py",),
    "pymavlink": (
        "gateways/mavlink/mavlink_dialect.py",
        "vehicle_check/mavlink_frames.py",
        "protocol/dialect/",
    ),
    "textual": ("ground/app", "ground/app/widgets"),
    "numpy": ("plant/", "study/"),
}


@cache
def imports_of(file: Path) -> set[str]:
    """Return the top-level names of all imports of a file, nested ones included."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def importers_of(library: str) -> list[str]:
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    return sorted(
        file.relative_to(ROOT).as_posix() for file in files if library in imports_of(file)
    )


def test_each_library_is_imported_only_where_it_belongs() -> None:
    strangers = {
        library: [file for file in importers_of(library) if not file.startswith(allowed)]
        for library, allowed in MAY_IMPORT.items()
    }
    assert strangers == {library: [] for library in MAY_IMPORT}


def test_import_rules_cover_files_with_imports() -> None:
    assert "plant/sim/physics.py" in importers_of("pymunk")
    assert any(file.startswith("protocol/bus/") for file in importers_of("zenoh"))
