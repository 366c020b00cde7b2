"""The mutation operators: the replacements of each kind of syntax node."""

import ast
from collections.abc import Iterator, Mapping
from copy import copy
from types import MappingProxyType
from typing import Final

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
        elif not is_nothing(node.value):
            yield ast.Return(ast.Constant(None))
    elif isinstance(node, ast.Break):
        yield ast.Continue()
    elif isinstance(node, ast.If | ast.While) and not isinstance(node.test, ast.Constant):
        for flag in FLAGS:
            changed = copy(node)
            changed.test = flag
            yield changed


def is_nothing(node: ast.expr) -> bool:
    """Return whether None would have the same effect."""
    return isinstance(node, ast.Constant) and node.value in (None, False, "")
