"""Prepare Python sources for freezing into the firmware; the sources themselves stay as they are.

On the board each name of a module takes RAM, while bytecode and literals stay in flash. So constants
(`X: Final = 3`) are inlined, annotations and docstrings dropped, and definitions that nothing uses
left out. Nothing else is changed: the board runs the statements of the sources.
"""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Final, TypeAlias

Constant: TypeAlias = int | float | tuple[int, ...]
Binding: TypeAlias = tuple[str, str]
"""A module and a name in it."""
BODY: Final = "<body>"
"""The statements of a module that bind no name."""

TUPLE: Final = re.compile(r"(\s*[^=]* = )\((.*)\)")
MAX_DIGITS: Final = 15
MAX_EXPONENT: Final = 22
"""A number with so few digits and this decimal exponent is read exactly by MicroPython."""


@dataclass(slots=True)
class Module:
    """A module: its statements, and where each of its names comes from."""

    name: str
    tree: ast.Module
    imported: dict[str, Binding] = field(default_factory=dict)
    """From local name to its origin; the name is empty for a module."""
    defined: dict[str, list[ast.stmt]] = field(default_factory=dict)
    finals: set[str] = field(default_factory=set)


class Program:
    """Modules by name, and the values of their constants."""

    def __init__(self, sources: Mapping[str, str], values: Mapping[Binding, object]) -> None:
        """Parse the sources; `values` are the module-level values as CPython computes them."""
        self.modules: dict[str, Module] = {}
        for name, source in sources.items():
            self.modules[name] = Module(name, without_annotations(ast.parse(source)))
        for module in self.modules.values():
            module.finals = set(final_names(ast.parse(sources[module.name])))
            for statement in module.tree.body:
                self._bind(module, statement)
        self._values = dict(values)

    def add_values(self, values: Mapping[Binding, object]) -> None:
        """Add values of constants."""
        self._values = {**self._values, **values}

    def frozen(self, root: str) -> dict[str, str]:
        """Return the sources of all modules that `root` needs, ready for the compiler."""
        for module in self.modules.values():
            Inliner(self, module).visit(module.tree)
            ast.fix_missing_locations(module.tree)
            module.defined, module.imported = {}, {}
            for statement in module.tree.body:
                self._bind(module, statement)
        live = self._live(root)
        needed = {module for module, _ in live}
        packages = {name.rpartition(".")[0] for name in needed}
        while any(packages):
            needed |= {package for package in packages if package}
            packages = {name.rpartition(".")[0] for name in packages}
        return {
            name: text_of(self._pruned(self.modules[name], live))
            for name in needed
            if name in self.modules
        }

    def constant(self, module: str, name: str) -> Constant | None:
        """Return the value of a constant that can be inlined, else None."""
        origin = self.origin(module, name)
        if origin is None or origin[1] not in self.modules[origin[0]].finals:
            return None
        value = self._values.get(origin)
        return value if is_literal(value) else None  # type: ignore[return-value]

    def origin(self, module: str, name: str) -> Binding | None:
        """Return where a name is defined, following imports; None for one of another program."""
        while module in self.modules:
            found = self.modules[module].imported.get(name)
            if found is None:
                return (module, name) if name in self.modules[module].defined else None
            module, name = found
            if not name:
                return None
        return None

    def module_of(self, module: str, name: str) -> str | None:
        """Return the module that a local name stands for, or None."""
        found = self.modules[module].imported.get(name)
        return found[0] if found is not None and not found[1] else None

    def _bind(self, module: Module, statement: ast.stmt) -> None:
        if isinstance(statement, ast.Import):
            for alias in statement.names:
                module.imported[alias.asname or alias.name] = (alias.name, "")
        elif isinstance(statement, ast.ImportFrom):
            source = statement.module or ""
            for alias in statement.names:
                whole = f"{source}.{alias.name}"
                origin = (whole, "") if whole in self.modules else (source, alias.name)
                module.imported[alias.asname or alias.name] = origin
        else:
            for name in bound_names(statement) or [BODY]:
                module.defined.setdefault(name, []).append(statement)

    def _live(self, root: str) -> set[Binding]:
        """Return the names that are reached from the statements of a module."""
        live: set[Binding] = set()
        todo = [(root, BODY)]
        while todo:
            binding = todo.pop()
            module = self.modules.get(binding[0])
            if binding in live or module is None:
                continue
            live.add(binding)
            todo.append((module.name, BODY))
            name = binding[1]
            if name in module.imported:
                source, there = module.imported[name]
                todo.append((source, there or BODY))
            for statement in module.defined.get(name, ()):
                todo += self._references(module, statement)
        return live

    def _references(self, module: Module, statement: ast.stmt) -> Iterator[Binding]:
        for node in ast.walk(statement):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                yield module.name, node.id
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                source = self.module_of(module.name, node.value.id)
                if source is not None:
                    yield source, node.attr
            elif isinstance(node, ast.ImportFrom) and node is not statement:
                for alias in node.names:
                    whole = f"{node.module}.{alias.name}"
                    known = whole in self.modules
                    yield (whole, BODY) if known else (node.module or "", alias.name)

    def _pruned(self, module: Module, live: set[Binding]) -> ast.Module:
        body: list[ast.stmt] = []
        for statement in module.tree.body:
            if isinstance(statement, ast.Import | ast.ImportFrom):
                statement.names = [
                    alias
                    for alias in statement.names
                    if (module.name, alias.asname or alias.name) in live
                ]
                if statement.names:
                    body.append(statement)
            elif any((module.name, name) in live for name in bound_names(statement) or [BODY]):
                body.append(statement)
        return ast.Module(body, [])


class Inliner(ast.NodeTransformer):
    """Replaces the uses of constants by their values."""

    def __init__(self, program: Program, module: Module) -> None:
        self._program = program
        self._module = module
        self._hidden: list[set[str]] = []

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:  # noqa: N802
        """Enter a function; its own names hide constants of the module."""
        self._hidden.append(local_names(node))
        self.generic_visit(node)
        self._hidden.pop()
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:  # noqa: N802
        """Replace the name of a constant."""
        if isinstance(node.ctx, ast.Load) and not any(node.id in one for one in self._hidden):
            return self._replaced(node, self._module.name, node.id)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:  # noqa: N802
        """Replace a constant of another module."""
        if isinstance(node.ctx, ast.Load) and isinstance(node.value, ast.Name):
            hidden = any(node.value.id in one for one in self._hidden)
            source = None if hidden else self._program.module_of(self._module.name, node.value.id)
            if source is not None:
                return self._replaced(node, source, node.attr)
        return self.generic_visit(node)

    def _replaced(self, node: ast.expr, module: str, name: str) -> ast.expr:
        value = self._program.constant(module, name)
        return node if value is None else ast.copy_location(literal(value), node)


class Stripper(ast.NodeTransformer):
    """Drops annotations, docstrings, `__slots__` and `__all__`, which the board does not use."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:  # noqa: N802
        """Drop the annotations and the docstring of a function."""
        node.returns = None
        every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        for argument in (*every, node.args.vararg, node.args.kwarg):
            if argument is not None:
                argument.annotation = None
        return self._with_body(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:  # noqa: N802
        """Drop the docstring of a class."""
        return self._with_body(node)

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:  # noqa: N802
        """Drop a docstring."""
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:  # noqa: N802
        """Turn an annotated assignment into a plain one."""
        if node.value is None:
            return None
        return ast.copy_location(ast.Assign([node.target], self.visit(node.value)), node)

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:  # noqa: N802
        """Drop `__slots__` and `__all__`."""
        target = node.targets[0]
        if isinstance(target, ast.Name) and target.id in ("__slots__", "__all__"):
            return None
        return self.generic_visit(node)

    def _with_body(self, node: ast.FunctionDef | ast.ClassDef) -> ast.AST:
        self.generic_visit(node)
        node.body = node.body or [ast.Pass()]
        return node


def without_annotations(tree: ast.Module) -> ast.Module:
    """Return a module without what the board does not use."""
    stripped = ast.fix_missing_locations(Stripper().visit(tree))
    assert isinstance(stripped, ast.Module)
    return stripped


def text_of(tree: ast.Module) -> str:
    """Return the source of a module.

    `a, b = (x, y)` is written without parentheses, for which the compiler makes no tuple.
    """
    lines = ast.unparse(ast.fix_missing_locations(tree)).split("\n")
    return "\n".join(map(without_parentheses, lines))


def without_parentheses(line: str) -> str:
    """Return a line without parentheses around the assigned tuple, if it means the same."""
    found = TUPLE.fullmatch(line)
    if found is None:
        return line
    shorter = found[1] + found[2]
    try:
        same = ast.dump(ast.parse(shorter.strip())) == ast.dump(ast.parse(line.strip()))
    except SyntaxError:
        return line
    return shorter if same else line


def final_names(tree: ast.Module) -> Iterator[str]:
    """Yield the names of a module that are declared `Final`."""
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            if "Final" in ast.unparse(node.annotation):
                yield node.target.id


def bound_names(statement: ast.stmt) -> list[str]:
    """Return the names that a plain definition binds; none for other statements."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return [statement.name]
    if isinstance(statement, ast.Assign):
        return [
            node.id
            for target in statement.targets
            for node in ast.walk(target)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        ]
    return []


def local_names(function: ast.FunctionDef) -> set[str]:
    """Return the names that are local to a function."""
    every = ast.walk(function)
    stored = {node.id for node in every if isinstance(node, ast.Name) and is_stored(node)}
    return stored | {node.arg for node in ast.walk(function) if isinstance(node, ast.arg)}


def is_stored(node: ast.Name) -> bool:
    """Return whether a name is assigned."""
    return not isinstance(node.ctx, ast.Load)


def is_literal(value: object) -> bool:
    """Return whether MicroPython reads the literal of this value exactly and keeps it in flash."""
    if isinstance(value, bool):
        return False
    if isinstance(value, int):
        return True
    if isinstance(value, float):
        return is_short(value)
    if isinstance(value, str):
        return value.startswith("<")  # the format of a message
    return isinstance(value, tuple) and bool(value) and all(type(one) is int for one in value)


def is_short(value: float) -> bool:
    """Return whether a number has so few digits that MicroPython reads it exactly."""
    if value - value != 0.0:
        return False
    _, digits, exponent = Decimal(repr(value)).normalize().as_tuple()
    assert isinstance(exponent, int)
    return len(digits) <= MAX_DIGITS and -MAX_EXPONENT <= exponent <= MAX_EXPONENT


def literal(value: Constant) -> ast.expr:
    """Return the expression of a constant."""
    return ast.parse(repr(value), mode="eval").body


def long_floats(trees: Iterable[ast.AST]) -> list[float]:
    """Return the float literals that MicroPython would not read exactly."""
    return [
        node.value
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, float)
        and not is_short(node.value)
    ]
