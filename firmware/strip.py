"""Remove annotations, docstrings and `__slots__`, which the board does not use, from sources."""

import ast
from collections.abc import Iterator


class Stripper(ast.NodeTransformer):
    """Drops annotations, docstrings, `__slots__` and `__all__`."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Drop the annotations and the docstring of a function."""
        node.returns = None
        every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        for argument in (*every, node.args.vararg, node.args.kwarg):
            if argument is not None:
                argument.annotation = None
        return self._with_body(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Drop the docstring of a class."""
        return self._with_body(node)

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """Drop a docstring."""
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        """Turn an annotated assignment into a plain one."""
        if node.value is None:
            return None
        return ast.copy_location(ast.Assign([node.target], self.visit(node.value)), node)

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        """Drop `__slots__` and `__all__`."""
        target = node.targets[0]
        if isinstance(target, ast.Name) and target.id in ("__slots__", "__all__"):
            return None
        return self.generic_visit(node)

    def _with_body(self, node: ast.FunctionDef | ast.ClassDef) -> ast.AST:
        self.generic_visit(node)
        node.body = node.body or [ast.Pass()]
        return node


def stripped(tree: ast.Module) -> ast.Module:
    """Return a module without annotations, docstrings, `__slots__` and `__all__`."""
    result = ast.fix_missing_locations(Stripper().visit(tree))
    assert isinstance(result, ast.Module)
    return result


def final_names(tree: ast.Module) -> Iterator[str]:
    """Yield the names of a module that are declared `Final`."""
    for node in tree.body:
        if (
            isinstance(node, ast.AnnAssign)
            and isinstance(node.target, ast.Name)
            and "Final" in ast.unparse(node.annotation)
        ):
            yield node.target.id
