"""The source of the core: what MicroPython lacks is not used, and each tick ends."""

import ast
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from checks.harness.until import PATIENCE_S
from tests.support.each import each

CORE = Path(__file__).parents[4] / "robot" / "core"
FILES = sorted(CORE.rglob("*.py"))


NAMES = [".".join(file.relative_to(CORE).with_suffix("").parts) for file in FILES]
"""Return the modules of the core, such as `brain` and `safety.guard`."""

FORMATTING = {"str", "repr", "format", "print", "round"}

Calls = dict[str, set[str]]


def tree(name: str) -> ast.Module:
    return ast.parse(CORE.joinpath(*name.split(".")).with_suffix(".py").read_text("utf-8"))


def changed_in(body: list[ast.stmt]) -> set[str]:
    """Return the names that a loop's body sets: `k -= 1`, `swept, last = end, k`."""
    return {
        node.id
        for one in body
        for node in ast.walk(one)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }


def compared_in(test: ast.expr) -> set[str]:
    """Return the names that the loop's condition compares with a limit."""
    parts = test.values if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And) else [test]
    ordered = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
    return {
        part.left.id
        for part in parts
        if isinstance(part, ast.Compare)
        and isinstance(part.ops[0], ordered)
        and isinstance(part.left, ast.Name)
    }


def unbounded(module: ast.AST) -> list[str]:
    return [
        ast.unparse(node.test)
        for node in ast.walk(module)
        if isinstance(node, ast.While) and not compared_in(node.test) & changed_in(node.body)
    ]


def aliases(module: ast.Module) -> dict[str, str]:
    """Map the aliases of a module to core modules and functions, such as `rings` and `wrap`."""
    known: dict[str, str] = {}
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("robot.core"):
            inside = (node.module or "").removeprefix("robot.core").removeprefix(".")
            for one in node.names:
                known[one.asname or one.name] = f"{inside}.{one.name}" if inside else one.name
    return known


def called(node: ast.AST, name: str, known: dict[str, str], own: set[str]) -> Iterator[str]:
    for call in ast.walk(node):
        if not isinstance(call, ast.Call):
            continue
        if isinstance(call.func, ast.Name):
            here = call.func.id
            yield f"{name}.{here}" if here in own else known.get(here, here)
        elif isinstance(call.func, ast.Attribute) and isinstance(call.func.value, ast.Name):
            module = known.get(call.func.value.id)
            if module is not None:
                yield f"{module}.{call.func.attr}"


def calls_of(name: str, module: ast.Module) -> Calls:
    known = aliases(module)
    functions = [node for node in ast.walk(module) if isinstance(node, ast.FunctionDef)]
    own = {node.name for node in functions}
    return {f"{name}.{node.name}": set(called(node, name, known, own)) for node in functions}


def circle(calls: Calls) -> list[str] | None:
    """Return a function that calls itself, directly or not, with the call chain."""
    done: set[str] = set()

    def follow(function: str, way: list[str]) -> list[str] | None:
        if function in way:
            return [*way, function]
        if function in done or function not in calls:
            return None
        for callee in calls[function]:
            found = follow(callee, [*way, function])
            if found:
                return found
        done.add(function)
        return None

    return next((found for function in calls if (found := follow(function, []))), None)


def formatting(module: ast.AST) -> list[str]:
    found = []
    for node in ast.walk(module):
        if isinstance(node, ast.JoinedStr):
            found.append("f-string")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            found += [node.func.id] if node.func.id in FORMATTING else []
        elif isinstance(node, ast.Attribute) and node.attr == "format":
            found.append("format")
    return found


@each("name", NAMES)
def test_every_while_counts_against_a_limit(name: str) -> None:
    assert not unbounded(tree(name))


@each("name", NAMES)
def test_nothing_is_formatted_or_printed(name: str) -> None:
    assert not formatting(tree(name))


def test_no_recursion_in_the_core() -> None:
    calls: Calls = {}
    for name in NAMES:
        calls |= calls_of(name, tree(name))
    assert {"brain.begin", "perception.sonar_ring.update", "values.wrap"} <= set().union(
        *calls.values()
    )
    assert circle(calls) is None


@each(
    "loop",
    ["while True:\n    k += 1", "while k:\n    k -= 1", "while k < 9:\n    j += 1"],
)
def test_the_check_of_loops_can_fail(loop: str) -> None:
    assert unbounded(ast.parse(loop))
    assert not unbounded(ast.parse("while again and k < 9:\n    k += 1"))


def test_the_check_of_calls_can_fail() -> None:
    here = "from robot.core import there as far\ndef f(): g()\ndef g(): far.h()\n"
    there = "from robot.core.here import f\ndef h(): return f()\n"
    calls = calls_of("here", ast.parse(here)) | calls_of("there", ast.parse(there))
    assert circle(calls) == ["here.f", "here.g", "there.h", "here.f"]


def test_the_check_of_formatting_can_fail() -> None:
    assert formatting(ast.parse("f'{x}'; str(1.5); '{}'.format(x)")) == [
        "f-string",
        "str",
        "format",
    ]


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
