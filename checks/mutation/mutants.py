"""All mutants of a module, in the order of its source, identified by text and not by line."""

import ast
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any, Final, NamedTuple

from checks.mutation import operators

MAX_TEXT: Final = 100
TYPE_CALLS: Final = ("NamedTuple", "TypeVar", "cast")
UNUSED_FIELDS: Final = ("annotation", "returns", "decorator_list", "format_spec", "type_params")
"""Parts of a node that have no effect when the code runs."""


class Identity(NamedTuple):
    """A mutant, identified by its function or class and by the old and the new code."""

    module: str
    scope: str
    was: str
    now: str

    def __str__(self) -> str:
        return f"{self.module} {self.scope or '(module)'}:\n    - {self.was}\n    + {self.now}"


class NodePlace(NamedTuple):
    """The place of a node in the tree: a field of its parent, and all nodes above, outermost first.

    `at` is the index in a list, or None if the field contains the node itself.
    """

    above: tuple[ast.AST, ...]
    field: str
    at: int | None
    scopes: tuple[str, ...]
    function: str

    def get(self) -> ast.AST:
        """Return the node in this place."""
        held = getattr(self.above[-1], self.field)
        node: ast.AST = held if self.at is None else held[self.at]
        return node

    @contextmanager
    def holding(self, node: ast.AST) -> Iterator[None]:
        """Put another node in this place within the block."""
        was = self.get()
        self._put(node)
        try:
            yield
        finally:
            self._put(was)

    def _put(self, node: ast.AST) -> None:
        if self.at is None:
            setattr(self.above[-1], self.field, node)
        else:
            getattr(self.above[-1], self.field)[self.at] = node


@dataclass(frozen=True)
class Mutant:
    """A mutant; `function` is the outermost changed function, empty for module code."""

    identity: Identity
    line: int
    place: NodePlace
    replacement: ast.AST
    tree: ast.Module

    @property
    def function(self) -> str:
        """The outermost changed function; empty for module code."""
        return self.place.function

    def compile(self, file: str) -> CodeType:
        """Return the code of the whole module with this change."""
        with self.place.holding(self.replacement):
            ast.fix_missing_locations(self.tree)
            return compile(self.tree, file, "exec", dont_inherit=True)


def mutants_of(path: Path, root: Path) -> list[Mutant]:
    """Return the mutants of a source file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    module = str(path.relative_to(root))
    found = []
    for place in places(tree):
        node = place.get()
        piece = largest_piece(node, place)
        was = text_of(piece or node)
        for replacement in replacements(node, place):
            ast.copy_location(replacement, node)
            with place.holding(replacement):
                now = text_of(piece or replacement)
            identity = Identity(module, ".".join(place.scopes), was, now)
            line = getattr(node, "lineno", 0)
            found.append(Mutant(identity, line, place, replacement, tree))
    return found


def replacements(node: ast.AST, place: NodePlace) -> Iterator[ast.AST]:
    """Yield the replacements of a node."""
    if isinstance(node, ast.expr):
        stored = isinstance(getattr(node, "ctx", None), ast.Store | ast.Del)
        if isinstance(place.above[-1], ast.comprehension) and place.field == "ifs":
            yield from operators.FLAGS
        if not stored:
            yield from operators.expressions(node)
    elif isinstance(node, ast.stmt) and place.function and not is_docstring(node):
        yield from operators.statements(node)


def places(tree: ast.Module) -> Iterator[NodePlace]:
    """Yield every place that has an effect when the code runs, in the order of the source."""
    pending = list(inside(tree, (), (), ""))[::-1]
    while pending:
        place = pending.pop()
        node = place.get()
        if declares(node):
            continue
        yield place
        scopes, function = place.scopes, place.function
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            scopes = (*scopes, node.name)
        pending.extend(list(inside(node, place.above, scopes, function))[::-1])


def inside(
    node: ast.AST, above: tuple[ast.AST, ...], scopes: tuple[str, ...], function: str
) -> Iterator[NodePlace]:
    """Yield the places directly below a node."""
    is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    for field, held in ast.iter_fields(node):
        if field in UNUSED_FIELDS:
            continue
        changes = function or (".".join(scopes) if is_function and field == "body" else "")
        for index, child in enumerate(held) if isinstance(held, list) else [(None, held)]:
            if isinstance(child, ast.AST):
                yield NodePlace((*above, node), field, index, scopes, changes)


def declares(node: ast.AST) -> bool:
    """Return whether a node only declares: docstrings, slots, imports, types."""
    if isinstance(node, ast.Import | ast.ImportFrom | ast.expr_context):
        return True
    if isinstance(node, ast.Assign):
        return any(isinstance(one, ast.Name) and one.id == "__slots__" for one in node.targets)
    if isinstance(node, ast.AnnAssign):
        return isinstance(node.annotation, ast.Name) and node.annotation.id == "TypeAlias"
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in TYPE_CALLS
    return is_docstring(node)


def is_docstring(node: ast.AST) -> bool:
    """Return whether a statement is a constant."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def largest_piece(node: ast.AST, place: NodePlace) -> ast.AST | None:
    """Return the largest code around a node that fits in a line; None for the node itself."""
    piece = None
    if isinstance(node, ast.stmt):
        return None
    for around in reversed(place.above):
        if isinstance(around, ast.Module) or len(text_of(around)) > MAX_TEXT:
            break
        piece = around
        if isinstance(around, ast.stmt):
            break
    return piece


def text_of(node: ast.AST) -> str:
    """Return the source of an expression, or of a statement without its body."""
    shown: Any = copy(node)
    for field in ("body", "orelse", "handlers", "finalbody"):
        if isinstance(getattr(shown, field, None), list):
            setattr(shown, field, [])
    return ast.unparse(shown)
