"""The source of the core shows that each tick ends: every loop and every call chain is bounded.

Calls through names that are only known at run time (a row's trigger, a navigator's step) are not
followed; these tables are flat.
"""

import ast
from collections.abc import Iterator

from tests.support.each import each
from tests.support.robot.core.sources import CORE, FILES

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
    assert {"pursuit.begin", "perception.sonar_ring.update", "geometry.wrap"} <= set().union(
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
