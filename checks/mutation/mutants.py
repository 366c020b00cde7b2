"""All mutants of a module, those that no test can detect with the reason, and the page of them.

Mutants are in the order of the source, and identified by text and not by line. The committed list
`equivalent.toml` has those that no test can detect; docs/evidence/mutants.md is written from it.
"""

import ast
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, MappingProxyType
from typing import Any, Final, NamedTuple

import msgspec

TINY: Final = 1e-6
LARGE: Final = 1e-2

COMPARISONS: Final[Mapping[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = MappingProxyType(
    {
        ast.Lt: (ast.LtE, ast.GtE),
        ast.LtE: (ast.Lt, ast.Gt),
        ast.Gt: (ast.GtE, ast.LtE),
        ast.GtE: (ast.Gt, ast.Lt),
        ast.Eq: (ast.NotEq,),
        ast.NotEq: (ast.Eq,),
        ast.Is: (ast.IsNot,),
        ast.IsNot: (ast.Is,),
        ast.In: (ast.NotIn,),
        ast.NotIn: (ast.In,),
    }
)
"""The comparison with the other boundary, and the negation."""

ARITHMETIC: Final[Mapping[type[ast.operator], type[ast.operator]]] = MappingProxyType(
    {
        ast.Add: ast.Sub,
        ast.Sub: ast.Add,
        ast.Mult: ast.Div,
        ast.Div: ast.Mult,
        ast.FloorDiv: ast.Mult,
        ast.Mod: ast.Mult,
        ast.Pow: ast.Mult,
        ast.LShift: ast.RShift,
        ast.RShift: ast.LShift,
        ast.BitAnd: ast.BitOr,
        ast.BitOr: ast.BitAnd,
        ast.BitXor: ast.BitAnd,
    }
)
CALLS: Final[Mapping[str, str]] = MappingProxyType(
    {"min": "max", "max": "min", "any": "all", "all": "any"}
)
DELETED: Final = (ast.Assign, ast.AnnAssign, ast.Expr, ast.Raise, ast.Continue)
FLAGS: Final = (ast.Constant(True), ast.Constant(False))


def expressions(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the replacements of an expression."""
    if isinstance(node, ast.Compare):
        yield from comparisons(node)
    elif isinstance(node, ast.BinOp):
        yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
    elif isinstance(node, ast.UnaryOp):
        yield node.operand
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.IfExp):
        yield from (ast.IfExp(flag, node.body, node.orelse) for flag in FLAGS)
    elif isinstance(node, ast.Constant):
        yield from constants(node.value)
    elif isinstance(node, ast.Attribute):
        if node.attr.isupper() and isinstance(node.value, ast.Name):
            yield ast.BinOp(node, ast.Add(), ast.Constant(1))
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CALLS:
        yield ast.Call(ast.Name(CALLS[node.func.id], ast.Load()), node.args, node.keywords)


def comparisons(node: ast.Compare) -> Iterator[ast.expr]:
    """Yield a comparison with each operator replaced."""
    for at, operator in enumerate(node.ops):
        for other in COMPARISONS[type(operator)]:
            operators = [*node.ops[:at], other(), *node.ops[at + 1 :]]
            yield ast.Compare(node.left, operators, node.comparators)


def constants(value: object) -> Iterator[ast.expr]:
    """Yield the replacements of a constant."""
    if isinstance(value, bool):
        yield ast.Constant(not value)
    elif isinstance(value, int):
        yield ast.Constant(value + 1)
    elif isinstance(value, float):
        yield ast.Constant(LARGE if 0.0 < abs(value) < TINY else value * 1.5 or 1.0)
    elif isinstance(value, str):
        yield ast.Constant(f"XX{value}")
    elif isinstance(value, bytes):
        yield ast.Constant(b"XX" + value)


def statements(node: ast.stmt) -> Iterator[ast.stmt]:
    """Yield the replacements of a statement in a function."""
    if isinstance(node, DELETED):
        if getattr(node, "value", True) is not None:  # a bare annotation has no value
            yield ast.Pass()
    elif isinstance(node, ast.AugAssign):
        yield ast.Pass()
        yield ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value)
    elif isinstance(node, ast.Return):
        if node.value is None:
            yield ast.Pass()
        elif not (isinstance(node.value, ast.Constant) and node.value.value in (None, False, "")):
            yield ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Break):
        yield ast.Continue()
    elif isinstance(node, ast.If | ast.While) and not isinstance(node.test, ast.Constant):
        for flag in FLAGS:
            changed = copy(node)
            changed.test = flag
            yield changed


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
            yield from FLAGS
        if not stored:
            yield from expressions(node)
    elif isinstance(node, ast.stmt) and place.function and not is_docstring(node):
        yield from statements(node)


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


FILE: Final = Path(__file__).with_name("equivalent.toml")


class EquivalentMutants(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mutants of a function that are equivalent for the same reason.

    `changes` are pairs of the old and the new code, as the report prints them.
    """

    module: str
    scope: str
    changes: tuple[tuple[str, str], ...]
    why: str

    @property
    def identities(self) -> list[Identity]:
        """The mutants."""
        return [Identity(self.module, self.scope, was, now) for was, now in self.changes]


class Entries(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    equivalent: tuple[EquivalentMutants, ...] = ()


def load(file: Path = FILE) -> tuple[EquivalentMutants, ...]:
    """Read the list; raise msgspec.ValidationError if it is malformed."""
    return msgspec.toml.decode(file.read_bytes(), type=Entries).equivalent


def mistakes(
    entries: Iterable[EquivalentMutants], modules: Collection[str], survivors: Iterable[Identity]
) -> list[str]:
    """Return the errors in the entries of these modules.

    An entry is wrong if it has no reason, appears twice, or names no mutant that survived: then its
    code has changed, or a test kills the mutant.
    """
    alive = set(survivors)
    chosen = [entry for entry in entries if entry.module in modules]
    listed = Counter(identity for entry in chosen for identity in entry.identities)
    return [
        *(f"without a reason: {entry.module} {entry.scope}" for entry in chosen if not entry.why),
        *(f"listed twice: {identity}" for identity, times in listed.items() if times > 1),
        *(f"stale: {identity}" for identity in listed if identity not in alive),
    ]


HEAD: Final = """\
<!-- Generated by `make generate-docs` from checks/mutation/equivalent.toml. -->

# Mutants that no test can kill

`make mutation` changes one operator, constant, condition or statement of a module at a time and
runs the unit tests of that module. It fails if a mutant survives that is not listed here, and if
a listed mutant is killed or no longer exists. The tests kill every other mutant of these modules.
Each mutant below is listed with the reason why no test can detect it.
"""


def page(modules: Collection[str], entries: Iterable[EquivalentMutants]) -> str:
    """Return the page in Markdown; `modules` are all mutated modules."""
    listed = [entry for module in modules for entry in entries if entry.module == module]
    without = [f"`{one}`" for one in modules if not any(entry.module == one for entry in listed)]
    lines = [HEAD]
    for module in dict.fromkeys(entry.module for entry in listed):
        lines += [f"## `{module}`", ""]
        for entry in listed:
            if entry.module == module:
                lines += [*section(entry), ""]
    lines += ["## Modules without such a mutant", "", ", ".join(without) + "."]
    return "\n".join(lines) + "\n"


def section(entry: EquivalentMutants) -> Iterator[str]:
    """Yield the lines of one entry: place, reason, old and new code."""
    where = f"In `{entry.scope}`" if entry.scope else "At the top of the module"
    yield f"{where}: {entry.why}."
    yield ""
    yield "```diff"
    last = ""
    for was, now in entry.changes:
        if was != last:
            yield f"- {was}"
        yield f"+ {now}"
        last = was
    yield "```"
