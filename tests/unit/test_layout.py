"""The sizes of folders, files and functions: what is too large no longer says what it holds."""

import ast
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
MAX_LINES: Final = 399
MAX_FUNCTION_LINES: Final = 39


def too_large(folder: Path) -> dict[str, int]:
    """Return the folders, files and functions below a folder that are too large, with sizes."""
    modules = Counter(path.parent for path in folder.rglob("*.py"))
    found = {str(path): count for path, count in modules.items() if count > MAX_MODULES}
    for path in folder.rglob("*.py"):
        found |= too_long(path)
    return found


def too_long(path: Path) -> dict[str, int]:
    """Return a file and its functions, if they are too long, with their lines."""
    text = path.read_text(encoding="utf-8")
    lines = text.count("\n")
    found = {str(path): lines} if lines > MAX_LINES else {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno:
            length = node.end_lineno - node.lineno + 1
            if length > MAX_FUNCTION_LINES:
                found[f"{path}:{node.name}"] = length
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_folders_files_and_functions_are_small(package: str) -> None:
    assert too_large(ROOT / package) == {}


def test_a_folder_with_too_many_modules_is_found(tmp_path: Path) -> None:
    for number in range(MAX_MODULES):
        (tmp_path / f"module_{number}.py").touch()
    assert too_large(tmp_path) == {}
    (tmp_path / "one_more.py").touch()
    assert too_large(tmp_path) == {str(tmp_path): MAX_MODULES + 1}


def test_a_file_that_is_too_long_is_found(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text("\n" * MAX_LINES)
    assert too_large(tmp_path) == {}
    module.write_text("\n" * (MAX_LINES + 1))
    assert too_large(tmp_path) == {str(module): MAX_LINES + 1}


@pytest.mark.parametrize("keyword", ["def", "async def"])
def test_a_function_that_is_too_long_is_found(tmp_path: Path, keyword: str) -> None:
    module = tmp_path / "module.py"
    body = MAX_FUNCTION_LINES - 1
    module.write_text(f"class A:\n    {keyword} f():\n" + "        0\n" * body)
    assert too_large(tmp_path) == {}
    module.write_text(f"class A:\n    {keyword} f():\n" + "        0\n" * (body + 1))
    assert too_large(tmp_path) == {f"{module}:f": MAX_FUNCTION_LINES + 1}
