"""A second copy of the core whose every operation goes over a scale.

The source of `robot/core` is rewritten, not the bytecode: MicroPython compiles a syntax tree nearly
one to one, CPython's bytecode differs from version to version, and only at run time is it known
whether `a + b` adds floats. So the counts are the same on every Python.
"""

import ast
import builtins
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.mcu_cost.instrumentation import SCALE, Rewriting
from benchmarks.mcu_cost.operation_counter import Scale

PACKAGE = "robot.core"
SOURCE = Path(__file__).parents[2] / "robot" / "core"


class WeighedCore:
    """`core["brain"]` is a module; `counts` are what it did since they were last taken.

    Modules of inner packages are named with them: `core["safety.guard"]`.
    """

    def __init__(self) -> None:
        self.scale = Scale()
        self._modules: dict[str, ModuleType] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._modules:
            self._load(name)
        return self._modules[name]

    def take(self) -> dict[str, Counter[str]]:
        """The counts since the last time, by function, and the scale cleared."""
        total = self.scale.by_function()
        self.scale.clear()
        return total

    def _load(self, name: str) -> None:
        place = SOURCE.joinpath(*name.split("."))
        module = self._modules[name] = ModuleType(f"{PACKAGE}.{name}".rstrip("."))
        if place.is_dir():
            return
        file, last = place.with_suffix(".py"), name.rpartition(".")[2]
        tree = Rewriting(self.scale, last).visit(ast.parse(file.read_text("utf-8"), str(file)))
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": self._import}
        module.__dict__[SCALE] = self.scale
        exec(compile(ast.fix_missing_locations(tree), str(file), "exec"), module.__dict__)

    def _import(self, name: str, *rest: Any) -> Any:
        """What the copies import of the core are copies too."""
        if name != PACKAGE and not name.startswith(f"{PACKAGE}."):
            return builtins.__import__(name, *rest)
        inner = name.removeprefix(PACKAGE).lstrip(".")
        found = self[inner]
        if SOURCE.joinpath(*inner.split(".")).is_dir():
            for wanted in rest[2] or ():
                setattr(found, wanted, self[f"{inner}.{wanted}".lstrip(".")])
        return found
