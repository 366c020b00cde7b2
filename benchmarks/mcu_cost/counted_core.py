"""A copy of the core that counts its operations.

The source of `robot/core` is rewritten, not the bytecode. MicroPython compiles a syntax tree nearly
one to one, while CPython's bytecode differs between versions. Whether `a + b` adds floats is only
known at run time. So the counts are the same on every Python.
"""

import ast
import builtins
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.mcu_cost.instrumentation import COUNTER, Instrumentation
from benchmarks.mcu_cost.operation_counter import OperationCounter

PACKAGE = "robot.core"
ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "robot" / "core"
ELEMENTARY = "runtime.elementary"
"""The functions that the core uses besides its own."""


class CountedCore:
    """A copy of the core: `core["brain"]` is a module.

    Modules of inner packages are named with them: `core["safety.guard"]`.
    """

    def __init__(self) -> None:
        self.counter = OperationCounter()
        self._modules: dict[str, ModuleType] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._modules:
            self._load(name)
        return self._modules[name]

    def take(self) -> dict[str, Counter[str]]:
        """Return the counts since the last call by function, and clear them."""
        total = self.counter.by_function()
        self.counter.clear()
        return total

    def clear(self) -> None:
        """Clear the counts."""
        self.counter.clear()

    def _load(self, name: str) -> None:
        own = name != ELEMENTARY
        place = (SOURCE if own else ROOT).joinpath(*name.split("."))
        module = self._modules[name] = ModuleType(f"{PACKAGE}.{name}".rstrip(".") if own else name)
        if place.is_dir():
            return
        file, last = place.with_suffix(".py"), name.rpartition(".")[2]
        tree = Instrumentation(self.counter, last).visit(
            ast.parse(file.read_text("utf-8"), str(file))
        )
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": self._import}
        module.__dict__[COUNTER] = self.counter
        exec(compile(ast.fix_missing_locations(tree), str(file), "exec"), module.__dict__)

    def _import(self, name: str, *rest: Any) -> Any:
        """Import other modules of the core, and its elementary functions, as counted copies."""
        if name == ELEMENTARY:
            return self[name]
        if name != PACKAGE and not name.startswith(f"{PACKAGE}."):
            return builtins.__import__(name, *rest)
        inner = name.removeprefix(PACKAGE).lstrip(".")
        found = self[inner]
        if SOURCE.joinpath(*inner.split(".")).is_dir():
            for wanted in rest[2] or ():
                setattr(found, wanted, self[f"{inner}.{wanted}".lstrip(".")])
        return found
