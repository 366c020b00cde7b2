"""The core uses only features of MicroPython on a small controller."""

import ast
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.robot.core.sources import CORE, FILES
from tests.support.until import PATIENCE_S

OUTSIDE = ("math", "typing", "runtime.elementary")
FORBIDDEN = {"dataclass", "enum", "remainder", "_replace", "OrderedDict", "print", "open"}


def trees() -> list[tuple[str, ast.AST]]:
    return [(file.name, ast.parse(file.read_text("utf-8"))) for file in FILES]


def imported(node: ast.AST) -> str | None:
    if isinstance(node, ast.ImportFrom):
        return node.module
    return node.names[0].name if isinstance(node, ast.Import) else None


def complaint(node: ast.AST) -> str | None:
    """Return what in this node MicroPython lacks, or what is forbidden in the core."""
    if isinstance(node, ast.Match):
        return "match"
    if isinstance(node, ast.Dict) and None in node.keys:
        return "{**a}"
    if isinstance(node, ast.arguments) and node.posonlyargs:
        return "positional-only /"
    if isinstance(node, ast.FormattedValue):
        return "formatting"
    if isinstance(node, ast.Attribute | ast.Name):
        name = node.attr if isinstance(node, ast.Attribute) else node.id
        return name if name in FORBIDDEN else None
    return None


def test_source_files_of_the_core_are_found() -> None:
    assert len(FILES) > 15


def test_the_core_imports_math_typing_elementary_and_itself() -> None:
    for name, tree in trees():
        for module in filter(None, map(imported, ast.walk(tree))):
            allowed = module in OUTSIDE or module.startswith("robot.core")
            assert allowed, (name, module)


def test_the_substitute_for_typing_has_each_name_imported() -> None:
    substitute = runpy.run_path(str(SUBSTITUTES / "typing.py"))
    wanted = {
        alias.name
        for _, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "typing"
        for alias in node.names
    }
    assert {"Final", "NamedTuple"} <= wanted <= substitute.keys()


def test_nothing_is_used_that_micropython_lacks() -> None:
    for name, tree in trees():
        complaints = [found for node in ast.walk(tree) if (found := complaint(node))]
        assert not complaints, (name, complaints)


def test_the_check_can_fail() -> None:
    bad = "match x:\n    case 1: f'{x:.2f}'\ng = {**a}\ndef f(a, /): return a._replace()\n"
    found = {complaint(node) for node in ast.walk(ast.parse(bad))} - {None}
    assert found == {"match", "formatting", "{**a}", "positional-only /", "_replace"}


def test_classes_that_change_have_slots_and_nothing_else() -> None:
    for name, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.bases:
                slots = [
                    target for target in ast.walk(node) if getattr(target, "id", "") == "__slots__"
                ]
                assert slots, (name, node.name)


CYCLE = """
from robot.core import brain
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs
state, outputs = brain.step(brain.State(DEFAULTS), Inputs(0, None, None, None), DEFAULTS)
import typing
print(outputs.left_mrad_s, DEFAULTS.track_m, hasattr(typing, "List"))
"""
SUBSTITUTES = CORE.parents[1] / "firmware" / "onboard"
WITH_SUBSTITUTE = f"import sys; sys.path.insert(0, {str(SUBSTITUTES)!r})\n"


def interpreters() -> list[list[str]]:
    """Return CPython, and MicroPython's Unix port if it is installed."""
    micropython = shutil.which("micropython")
    return [[sys.executable, "-S"], *([[micropython]] if micropython else [])]


@pytest.mark.parametrize("interpreter", interpreters(), ids=lambda line: Path(line[0]).name)
def test_a_cycle_runs_with_the_substitute_for_typing(interpreter: list[str]) -> None:
    ran = subprocess.run(
        [*interpreter, "-c", WITH_SUBSTITUTE + CYCLE],
        cwd=CORE.parents[1],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert (ran.returncode, ran.stdout.strip()) == (0, "0 0.2 False"), ran.stderr
