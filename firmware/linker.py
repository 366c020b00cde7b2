"""Link Python sources to one module for the firmware; the sources themselves stay as they are.

On the board each module, each import and each name of a module takes RAM, while code and literals
stay in flash. So all modules are linked to one, in the order of their imports; a name that is not
unique gets the name of its module as a suffix. Constants (`X: Final = 3`) are inlined, annotations,
docstrings and `__slots__` removed, and definitions that nothing uses left out. Nothing else
changes: the board runs the statements of the sources.

MicroPython's compiler neither reads nor prints floating-point numbers exactly: the last bits of a
frozen literal may differ from those in CPython. So the frozen C source is corrected: each number is
replaced by the literal of the program that it came from.
"""

import ast
import builtins
import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from math import inf
from typing import Final, NamedTuple, TypeGuard

from runtime.errors import LocalError


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


FROZEN_FLOAT: Final = re.compile(r"(\{\{&mp_type_float\}, \(mp_float_t\))([^}]+)(\})")
MAX_FLOAT: Final = 1e38
"""Largest number that is frozen; the tool converts each one to single precision, too."""
NEAR: Final = 1e-14
"""Relative difference of a frozen number from its literal: a few units in the last place."""


def is_literal(value: object) -> bool:
    """Return whether MicroPython keeps the literal of this value in flash."""
    if isinstance(value, bool):
        return False
    if isinstance(value, int | str):
        return True
    if isinstance(value, float):
        return 0.0 <= value <= MAX_FLOAT
    if type(value) is tuple:  # not a named one, whose text is a call
        return bool(value) and all(type(one) is int for one in value)
    return False


def literal(value: object) -> ast.expr:
    """Return the expression of a constant."""
    return ast.parse(repr(value), mode="eval").body


def floats_in(source: str) -> set[float]:
    """Return the floating-point literals of a program."""
    nodes = ast.walk(ast.parse(source))
    return {
        node.value
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, float)
    }


def exact(frozen: str, wanted: Iterable[float]) -> str:
    """Return frozen C source in which every number is one of the wanted ones.

    Raises LocalError for a number that is not near exactly one of them.
    """
    ordered = sorted(wanted)

    def corrected(found: re.Match[str]) -> str:
        return f"{found[1]}{nearest(float(found[2]), ordered)!r}{found[3]}"

    return FROZEN_FLOAT.sub(corrected, frozen)


def nearest(value: float, ordered: list[float]) -> float:
    """Return the only ordered number near a value; raise LocalError unless there is just one."""
    place = bisect_left(ordered, value)
    around = [-inf, *ordered, inf][max(0, place - 1) : place + 4]
    near = [one for one in around if one == value or abs(one - value) <= NEAR * abs(value)]
    if value in near:
        return value
    if len(near) != 1:
        raise LocalError(f"frozen number {value!r} is near {near}, not near one literal")
    return near[0]


BODY: Final = "<body>"
"""The statements of a module that bind no name."""
NATIVE: Final = {"runtime.elementary": "elementary"}
"""Modules that are translated to C, and their names on the board."""
TUPLE: Final = re.compile(r"(\s*[^=]* = )\((.*)\)")


class Binding(NamedTuple):
    """A module-level name; a name BODY is the module itself."""

    module: str
    name: str


class Module:
    """A module: its statements, and where each of its names comes from."""

    def __init__(self, name: str, source: str, modules: Mapping[str, str]) -> None:
        """Parse a module; `modules` are all modules that may be linked."""
        tree = ast.parse(source)
        self.name = name
        self.finals = set(final_names(tree))
        self.body = stripped(tree).body
        self.imported: dict[str, Binding] = {}
        self.imports: list[Binding] = []
        for statement in self.body:
            if isinstance(statement, ast.Import | ast.ImportFrom):
                self._import(statement, modules)
        self.defined = {name for one in self.body for name in bound_names(one)}

    def _import(self, statement: ast.Import | ast.ImportFrom, modules: Mapping[str, str]) -> None:
        for alias in statement.names:
            origin = Binding(alias.name, BODY)
            if isinstance(statement, ast.ImportFrom):
                whole = f"{statement.module}.{alias.name}"
                is_module = whole in modules
                origin = (
                    Binding(whole, BODY)
                    if is_module
                    else Binding(statement.module or "", alias.name)
                )
            self.imported[alias.asname or alias.name] = origin
            self.imports.append(origin)


class Program:
    """Modules by name, and the values of their constants."""

    def __init__(self, sources: Mapping[str, str], values: Mapping[Binding, object]) -> None:
        """Parse the sources; `values` are the module-level values as CPython computes them."""
        self._values = values
        self._modules = {name: Module(name, text, sources) for name, text in sources.items()}

    def linked(self, root: str) -> str:
        """Return the source of one module that contains `root` and everything that it needs."""
        ordered: list[Module] = []
        self._visit(root, ordered, set())
        for module in ordered:
            module.body = [Inliner(self, module).visit(statement) for statement in module.body]
        live = self._live(root)
        names = self._names(ordered, live)
        lines = sorted(
            import_line(origin, names[origin]) for origin in self._outside(ordered, live)
        )
        for module in ordered:
            for statement in module.body:
                if isinstance(statement, ast.Import | ast.ImportFrom):
                    continue
                bound = bound_names(statement) or [BODY]
                if any(Binding(module.name, name) in live for name in bound):
                    lines.append(source_of(Renamer(self, module, names).visit(statement)))
        return "\n".join([*lines, ""])

    def origin(self, module: str, name: str) -> Binding | None:
        """Return where a name of a module is defined, following imports."""
        while module in self._modules:
            if name == BODY or name in self._modules[module].defined:
                return Binding(module, name)
            found = self._modules[module].imported.get(name)
            if found is None:
                return None
            module, name = found
        return Binding(module, name)

    def constant(self, origin: Binding) -> object:
        """Return the value of a constant that can be inlined, else None."""
        module = self._modules.get(origin.module)
        if module is None or origin.name not in module.finals:
            return None
        value = self._values.get(origin)
        return value if is_literal(value) else None

    def _visit(self, name: str, ordered: list[Module], seen: set[str]) -> None:
        """Append a module behind those that it imports."""
        module = self._modules.get(name)
        if module is None or name in seen:
            return
        seen.add(name)
        for origin in module.imports:
            self._visit(origin.module, ordered, seen)
        ordered.append(module)

    def _live(self, root: str) -> set[Binding]:
        """Return the names that are reached from the statements of a module."""
        live: set[Binding] = set()
        todo = [Binding(root, BODY)]
        while todo:
            binding = todo.pop()
            if binding in live:
                continue
            live.add(binding)
            module = self._modules.get(binding.module)
            if module is None:
                continue
            todo.append(Binding(module.name, BODY))
            for statement in module.body:
                if binding.name in (bound_names(statement) or [BODY]):
                    todo += self._references(module, statement)
        return live

    def _references(self, module: Module, statement: ast.stmt) -> Iterator[Binding]:
        if isinstance(statement, ast.Import | ast.ImportFrom):
            return
        for node in ast.walk(statement):
            origin = self.resolved(module, node)
            if origin is not None:
                yield origin

    def resolved(self, module: Module, node: ast.AST) -> Binding | None:
        """Return what a name, or an attribute of a module, refers to.

        A built-in name counts as imported, because a global of the module is found faster.
        """
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            origin = self.origin(module.name, node.id)
            is_builtin = origin is None and hasattr(builtins, node.id)
            return Binding("builtins", node.id) if is_builtin else origin
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            source = self.origin(module.name, node.value.id)
            if source is not None and source.name == BODY and source.module in self._modules:
                return self.origin(source.module, node.attr)
        return None

    def _outside(self, ordered: list[Module], live: set[Binding]) -> set[Binding]:
        """Return the used names of other modules, which are built into MicroPython."""
        inside = {module.name for module in ordered}
        return {binding for binding in live if binding.module not in inside}

    def _names(self, ordered: list[Module], live: set[Binding]) -> dict[Binding, str]:
        """Return a unique name for each binding, which no function uses for a local."""
        places = {module.name: place for place, module in enumerate(ordered)}
        every = [one for one in live if one.name != BODY or one.module not in places]
        counts = Counter(plain_name(one) for one in every)
        local = {name for module in ordered for name in local_names(module.body)}
        names: dict[Binding, str] = {}
        for binding in sorted(every, key=lambda one: (not self._is_fixed(one), one)):
            name = plain_name(binding)
            if self._is_fixed(binding):
                names[binding] = name
                continue
            if binding.module in places and (counts[name] > 1 or name in local):
                name = f"{name}_{binding.module.rpartition('.')[2]}"
            taken = set(names.values()) - {name if binding.module not in places else ""}
            while name in taken or (name in local and binding.module in places):
                name += "_"
            names[binding] = name
        return names

    def _is_fixed(self, binding: Binding) -> bool:
        """Return whether a name must not be changed, because a `try` binds it."""
        module = self._modules.get(binding.module)
        tries = [] if module is None else [one for one in module.body if isinstance(one, ast.Try)]
        return any(binding.name in bound_names(one) for one in tries)


class Scoped(ast.NodeTransformer):
    """Visits the names of a statement that are not local to a function."""

    def __init__(self, program: Program, module: Module) -> None:
        self._program = program
        self._module = module
        self._hidden: list[set[str]] = []

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Enter a function; its own names hide those of the module."""
        node.args.defaults = [self.visit(default) for default in node.args.defaults]
        self._hidden.append(set(local_names([node])) - {node.name})
        node.body = [self.visit(statement) for statement in node.body]
        self._hidden.pop()
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """Replace a name."""
        return node if self._is_hidden(node.id) else self._changed(node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Replace a name of another module."""
        if isinstance(node.value, ast.Name) and not self._is_hidden(node.value.id):
            changed = self._changed(node)
            if changed is not node:
                return changed
        return self.generic_visit(node)

    def _is_hidden(self, name: str) -> bool:
        return any(name in names for names in self._hidden)

    def _changed(self, node: ast.Name | ast.Attribute) -> ast.expr:
        raise NotImplementedError


class Inliner(Scoped):
    """Replaces the uses of constants by their values."""

    def _changed(self, node: ast.Name | ast.Attribute) -> ast.expr:
        origin = self._program.resolved(self._module, node)
        value = None if origin is None else self._program.constant(origin)
        return node if value is None else literal(value)


class Renamer(Scoped):
    """Replaces names by those that are unique in the linked module."""

    def __init__(self, program: Program, module: Module, names: Mapping[Binding, str]) -> None:
        super().__init__(program, module)
        self._names = names

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Rename a function of the module."""
        if not self._hidden:
            node.name = self._names.get(Binding(self._module.name, node.name), node.name)
        return super().visit_FunctionDef(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Rename a class of the module; its methods keep their names."""
        node.name = self._names.get(Binding(self._module.name, node.name), node.name)
        node.bases = [self.visit(base) for base in node.bases]
        self._hidden.append({one.name for one in node.body if isinstance(one, ast.FunctionDef)})
        hidden = self._hidden.pop()
        for statement in node.body:
            if isinstance(statement, ast.FunctionDef) and statement.name in hidden:
                self._method(statement)
        return node

    def visit_Try(self, node: ast.Try) -> ast.AST:
        """Keep the names of a statement that replaces a missing module."""
        return self.generic_visit(node) if self._hidden else node

    def _method(self, node: ast.FunctionDef) -> None:
        name = node.name
        self.visit_FunctionDef(node)
        node.name = name

    def _changed(self, node: ast.Name | ast.Attribute) -> ast.expr:
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            name = self._names.get(Binding(self._module.name, node.id), node.id)
            return ast.Name(name, node.ctx)
        origin = self._program.resolved(self._module, node)
        if origin is None or origin not in self._names:
            return node
        return ast.Name(self._names[origin], ast.Load())


def plain_name(binding: Binding) -> str:
    """Return the name of a binding, or that of a module itself."""
    return binding.module if binding.name == BODY else binding.name


def import_line(origin: Binding, name: str) -> str:
    """Return the import of a name that is built into MicroPython."""
    if origin.name == BODY:
        return f"import {origin.module} as {name}" if name != origin.module else f"import {name}"
    suffix = "" if name == origin.name else f" as {name}"
    return f"from {NATIVE.get(origin.module, origin.module)} import {origin.name}{suffix}"


def bound_names(statement: ast.stmt) -> list[str]:
    """Return the names that a definition binds; none for other statements."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return [statement.name]
    if isinstance(statement, ast.Assign):
        targets = (node for target in statement.targets for node in ast.walk(target))
        return [node.id for node in targets if is_stored(node)]
    if isinstance(statement, ast.Try):
        every = [*statement.body, *(one for case in statement.handlers for one in case.body)]
        aliases = [alias for one in every if isinstance(one, ast.ImportFrom) for alias in one.names]
        names = {name for one in every for name in bound_names(one)}
        return sorted(names | {alias.asname or alias.name for alias in aliases})
    return []


def local_names(statements: list[ast.stmt]) -> Iterator[str]:
    """Yield the names that are local to the functions of these statements."""
    for statement in statements:
        for function in ast.walk(statement):
            if isinstance(function, ast.FunctionDef | ast.Lambda | ast.comprehension):
                for node in ast.walk(function):
                    if is_stored(node):
                        yield node.id
                    elif isinstance(node, ast.arg):
                        yield node.arg


def is_stored(node: ast.AST) -> TypeGuard[ast.Name]:
    """Return whether a node is a name that is assigned."""
    return isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load)


def source_of(statement: ast.stmt) -> str:
    """Return the source of a statement.

    `a, b = (x, y)` is written without parentheses, so that the compiler creates no tuple.
    """
    lines = ast.unparse(ast.fix_missing_locations(statement)).split("\n")
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
