"""Instrumentation of a syntax tree: `a + b.c` becomes `counter.binary("Add", a, counter.attr…`.

Costs that do not depend on values (names, constants, jumps, stores) are added up per unit. A unit
is a piece of code that runs as a whole; at run time it only counts how often it ran.
"""

import ast
from collections import Counter
from typing import TypeVar

from benchmarks.mcu_cost.operation_counter import OperationCounter

COUNTER = "_counter"
ROTATED = 3  # up to this number of names is assigned without a tuple

Node = TypeVar("Node", bound=ast.AST)


class Instrumentation(ast.NodeTransformer):
    """Rewrite functions; module-level code is not counted."""

    def __init__(self, counter: OperationCounter, module: str) -> None:
        self._counter = counter
        self._module = self._function = module
        self._locals: set[str] = set()
        self._unit: Counter[str] | None = None
        self._temporaries = 0

    # functions and statements

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        """Count call and arguments, and rewrite the body."""
        outer, self._locals = self._locals, names_of(node)
        self._function = f"{self._module}.{node.name}"
        prologue = Counter({"call": 1, "argument": len(node.args.args)})
        first = self._spend_statement(prologue)
        node.body = [first, *self._block(node.body)]
        node.decorator_list = []
        self._locals, self._function = outer, self._module
        return node

    def _block(self, body: list[ast.stmt]) -> list[ast.stmt]:
        return [one for statement in body for one in self._statement(statement)]

    def _statement(self, node: ast.stmt) -> list[ast.stmt]:
        """Return the statement after a count of its unit."""
        if isinstance(node, ast.Pass | ast.Global | ast.Import | ast.ImportFrom):
            return [node]
        outer, self._unit = self._unit, Counter()
        done = self.visit(node)
        unit, self._unit = self._unit, outer
        statements = done if isinstance(done, list) else [done]
        return [self._spend_statement(unit), *statements] if unit else statements

    def visit_If(self, node: ast.If) -> ast.If:
        """Count a conditional statement."""
        self._count("jump")
        node.test = self.visit(node.test)
        node.body, node.orelse = self._block(node.body), self._block(node.orelse)
        return node

    def visit_While(self, node: ast.While) -> ast.While:
        """Count a while loop."""
        node.test = self._conditional(node.test, "jump")
        node.body, node.orelse = self._block(node.body), self._block(node.orelse)
        return node

    def visit_For(self, node: ast.For) -> ast.For:
        """Count a for loop."""
        ranged = isinstance(node.iter, ast.Call) and name_of(node.iter.func) == "range"
        if ranged:
            assert isinstance(node.iter, ast.Call)
            node.iter.args = [self.visit(one) for one in node.iter.args]
        else:
            self._count("loop")
            node.iter = self.visit(node.iter)
        each = Counter({"range, each" if ranged else "loop, each": 1, "store local": 1})
        if isinstance(node.target, ast.Tuple):
            each += Counter({"unpack": 1, "unpack, each": len(node.target.elts)})
        spent = self._spend_statement(each)
        node.body, node.orelse = [spent, *self._block(node.body)], self._block(node.orelse)
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.stmt | list[ast.stmt]:
        """Count an assignment."""
        target = node.targets[0]
        if len(node.targets) == 1 and isinstance(target, ast.Subscript):
            return self._store_item(target, self.visit(node.value))
        if any(isinstance(one, ast.Tuple) for one in node.targets):
            node.value = self._unpacked(target, node.value)
        else:
            node.value = self.visit(node.value)
        node.targets = [self._target(one) for one in node.targets]
        return node

    def _unpacked(self, target: ast.expr, value: ast.expr) -> ast.expr:
        """Rewrite the value of `a, b = …`; two or three values are rotated on the stack."""
        if isinstance(value, ast.Tuple) and len(value.elts) <= ROTATED:
            value.elts = [self.visit(one) for one in value.elts]
            return value
        return counter_call("unpack", self.visit(value))

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.stmt | list[ast.stmt]:
        """Count an annotated assignment."""
        if node.value is None:
            return node
        assign = ast.Assign([node.target], node.value)
        return self.visit_Assign(ast.copy_location(assign, node))

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.stmt | list[ast.stmt]:
        """Count an augmented assignment."""
        source = ast.parse(ast.unparse(node.target), mode="eval").body
        value = ast.BinOp(source, node.op, node.value)
        return self.visit_Assign(ast.copy_location(ast.Assign([node.target], value), node))

    def _store_item(self, target: ast.Subscript, value: ast.expr) -> ast.stmt:
        thing, key = self.visit(target.value), self.visit(target.slice)
        return ast.Expr(counter_call("store", thing, key, value))

    def _target(self, target: ast.expr) -> ast.expr:
        if isinstance(target, ast.Tuple):
            target.elts = [self._target(one) for one in target.elts]
        elif isinstance(target, ast.Attribute):
            self._count("store attribute")
            target.value = self.visit(target.value)
        elif isinstance(target, ast.Subscript):
            self._count("store item")
            target.value, target.slice = self.visit(target.value), self.visit(target.slice)
        else:
            self._count("store local")
        return target

    # expressions

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Count a name."""
        self._count("local" if node.id in self._locals else "global")
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        """Count a constant."""
        self._count("constant")
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        """Count an attribute at run time."""
        if self._unit is None:
            return node
        return counter_call("attribute", self.visit(node.value), ast.Constant(node.attr))

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        """Count a subscript at run time."""
        if self._unit is None:
            return node
        return counter_call("item", self.visit(node.value), self.visit(node.slice))

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        """Count a binary operation at run time."""
        if self._unit is None:
            return node
        left, right = self.visit(node.left), self.visit(node.right)
        return counter_call("binary", ast.Constant(type(node.op).__name__), left, right)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        """Count a unary operation."""
        if self._unit is None:
            return node
        if isinstance(node.operand, ast.Constant):
            self._count("constant")
            return node
        operand = self.visit(node.operand)
        if isinstance(node.op, ast.USub):
            return counter_call("negate", operand)
        self._count("not" if isinstance(node.op, ast.Not) else "int")
        return ast.UnaryOp(node.op, operand)

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        """Count comparisons, up to the first that fails."""
        if self._unit is None:
            return node
        left = self.visit(node.left)
        name = ast.Constant(type(node.ops[0]).__name__)
        if len(node.ops) == 1:
            return counter_call("compare", name, left, self.visit(node.comparators[0]))
        middle = f"{COUNTER}_{self._temporaries}"
        self._temporaries += 1
        self._locals.add(middle)
        kept = ast.NamedExpr(ast.Name(middle, ast.Store()), self.visit(node.comparators[0]))
        first = counter_call("compare", name, left, kept)
        load = ast.Name(middle, ast.Load())
        rest = ast.Compare(load, node.ops[1:], node.comparators[1:])
        self._count("jump")
        return ast.BoolOp(ast.And(), [first, self._conditional(rest, "jump")])

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        """Count the operands that are evaluated."""
        if self._unit is None:
            return node
        first, *others = node.values
        self._count("jump")
        return ast.BoolOp(
            node.op, [self.visit(first), *(self._conditional(one, "jump") for one in others)]
        )

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        """Count a conditional expression."""
        if self._unit is None:
            return node
        self._count("jump")
        test = self.visit(node.test)
        return ast.IfExp(test, self._conditional(node.body, "jump"), self._conditional(node.orelse))

    def visit_Tuple(self, node: ast.Tuple) -> ast.expr:
        """Count a tuple."""
        return self._display(node, node, "make_tuple")

    def visit_List(self, node: ast.List) -> ast.expr:
        """Count a list."""
        return self._display(node, node, "make_list")

    def _display(self, node: ast.expr, shown: ast.Tuple | ast.List, kind: str) -> ast.expr:
        if self._unit is None:
            return node
        if kind == "make_tuple" and all(isinstance(one, ast.Constant) for one in shown.elts):
            self._count("constant")
            return node
        shown.elts = [self.visit(one) for one in shown.elts]
        return counter_call(kind, shown)

    def visit_ListComp(self, node: ast.ListComp) -> ast.expr:
        """Count a list comprehension."""
        if self._unit is None:
            return node
        for source in node.generators:
            source.iter = self.visit(source.iter)
            source.ifs = [self._conditional(one, "jump") for one in source.ifs]
        self._count("call")
        node.elt = self._conditional(node.elt, "loop, each", "store local")
        return counter_call("make_list", node)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Count a call."""
        if self._unit is None:
            return node
        function = self.visit(node.func)
        self._count("star", sum(isinstance(one, ast.Starred) for one in node.args))
        arguments = [self.visit(one) for one in node.args]
        for keyword in node.keywords:
            keyword.value = self.visit(keyword.value)
        called = counter_call("call", function, *arguments)
        called.keywords = node.keywords
        return called

    # units

    def _count(self, name: str, times: int = 1) -> None:
        if self._unit is not None and times:
            self._unit[name] += times

    def _conditional(self, node: ast.expr, *costs: str) -> ast.expr:
        """Rewrite an expression that is evaluated conditionally as a unit of its own."""
        outer, self._unit = self._unit, Counter(costs)
        done = self.visit(node)
        unit, self._unit = self._unit, outer
        return counter_call("spend", ast.Constant(self._counter.unit(self._function, unit)), done)

    def _spend_statement(self, unit: Counter[str]) -> ast.stmt:
        return ast.Expr(
            counter_call("spend", ast.Constant(self._counter.unit(self._function, unit)))
        )


def counter_call(method: str, *arguments: ast.expr) -> ast.Call:
    """Return a call of a method of the counter."""
    counter = ast.Attribute(ast.Name(COUNTER, ast.Load()), method, ast.Load())
    return ast.Call(counter, list(arguments), [])


def name_of(node: ast.expr) -> str | None:
    """Return the identifier of a name, None for another expression."""
    return node.id if isinstance(node, ast.Name) else None


def names_of(function: ast.FunctionDef) -> set[str]:
    """Return the arguments and the names assigned in the body."""
    names = {one.arg for one in function.args.args}
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names
