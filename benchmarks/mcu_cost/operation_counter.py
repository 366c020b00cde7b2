"""Execute the operations of the core and count them by kind."""

import math
import operator
from collections import Counter
from collections.abc import Callable, Mapping
from types import BuiltinMethodType, FunctionType, ModuleType
from typing import Any

from benchmarks.mcu_cost.mcu import INSTRUCTIONS

SMALL_INT = 1 << 30
BOX_BYTES = 16
WORD_BYTES = 4

BINARY: Mapping[str, Callable[[Any, Any], Any]] = {
    "Add": operator.add,
    "Sub": operator.sub,
    "Mult": operator.mul,
    "Div": operator.truediv,
    "FloorDiv": operator.floordiv,
    "Mod": operator.mod,
    "BitAnd": operator.and_,
    "BitOr": operator.or_,
    "BitXor": operator.xor,
    "LShift": operator.lshift,
    "RShift": operator.rshift,
    "Pow": operator.pow,
}
COMPARE: Mapping[str, Callable[[Any, Any], Any]] = {
    "Lt": operator.lt,
    "LtE": operator.le,
    "Gt": operator.gt,
    "GtE": operator.ge,
    "Eq": operator.eq,
    "NotEq": operator.ne,
    "Is": operator.is_,
    "IsNot": operator.is_not,
    "In": lambda a, b: a in b,
    "NotIn": lambda a, b: a not in b,
}
FLOAT = {"Div": "float /", "FloorDiv": "float /", "Mod": "float %", "Pow": "other of math"}
MATH = {"sqrt": "sqrt", "atan2": "atan2", "tanh": "tanh"}
BUILTIN = {abs: "abs", int: "int()", len: "len"}


class OperationCounter:
    """Count operations by the names of the table, and bytes taken from the heap.

    `counts` are those of the running function; costs that do not depend on values come from its
    units.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.functions: dict[str, Counter[str]] = {"": self.counts}
        self.units: list[tuple[str, Counter[str]]] = []
        self.hits: list[int] = []
        self.heap_bytes = 0

    def unit(self, function: str, counts: Counter[str]) -> int:
        """Register a piece of code that runs as a whole; return its number."""
        self.units.append((function, counts))
        self.hits.append(0)
        return len(self.units) - 1

    def clear(self) -> None:
        """Clear all counts."""
        for counts in self.functions.values():
            counts.clear()
        self.hits = [0] * len(self.units)
        self.heap_bytes = 0

    def by_function(self) -> dict[str, Counter[str]]:
        """Return the counts since `clear`."""
        total = {name: Counter(counts) for name, counts in self.functions.items() if counts}
        units = self.units
        for number, hits in enumerate(self.hits):
            if hits:
                function, unit = units[number]
                counts = total.setdefault(function, Counter())
                for name, count in unit.items():
                    counts[name] += count * hits
        return total

    def spend(self, unit: int, value: Any = None) -> Any:
        """Count a unit; return the value."""
        self.hits[unit] += 1
        return value

    def box(self, value: Any) -> Any:
        """Count a float on the heap; return the value."""
        self.heap_bytes += BOX_BYTES
        return value

    def several(self, name: str, count: int) -> None:
        """Count an operation and its items."""
        self.counts[name] += 1
        self.counts[f"{name}, each"] += count

    def binary(self, name: str, a: Any, b: Any) -> Any:
        """Execute and count a binary operation."""
        result = BINARY[name](a, b)
        if isinstance(a, list | tuple) or isinstance(b, list | tuple):
            self.several("make list", len(result))
            self.heap_bytes += rounded(WORD_BYTES * (4 + len(result)))
        elif type(a) is float or type(b) is float:
            self.counts[FLOAT.get(name, "float + - *")] += 1
            self.box(None)
        elif type(result) is float:
            self.counts["float of ints /"] += 1
            self.box(None)
        elif is_long(a) or is_long(b) or is_long(result):
            self.counts["long int"] += 1
            self.heap_bytes += 2 * BOX_BYTES
        else:
            self.counts["int"] += 1
        return result

    def compare(self, name: str, a: Any, b: Any) -> Any:
        """Execute and count a comparison."""
        if name in ("Is", "IsNot"):
            self.counts["is"] += 1
        elif name in ("In", "NotIn"):
            self.several("in", len(b))
        elif isinstance(a, tuple) or isinstance(b, tuple):
            self.several("compare tuple", len(a) if isinstance(a, tuple) else len(b))
        elif type(a) is float or type(b) is float:
            self.counts["float compare"] += 1
        else:
            self.counts["int compare"] += 1
        return COMPARE[name](a, b)

    def negate(self, a: Any) -> Any:
        """Execute and count a negation."""
        self.counts["float negate" if type(a) is float else "int"] += 1
        return -a if type(a) is not float else self.box(-a)

    def attribute(self, thing: Any, name: str) -> Any:
        """Read an attribute and count it."""
        fields = getattr(type(thing), "_fields", None)
        if isinstance(thing, ModuleType):
            self.counts["attribute of module"] += 1
        elif fields is None:
            self.counts["attribute"] += 1
        else:
            self.counts["field"] += 1
            self.counts["field, each before it"] += fields.index(name)
        return getattr(thing, name)

    def item(self, thing: Any, key: Any) -> Any:
        """Read an item or a slice and count it."""
        value = thing[key]
        if isinstance(key, slice):
            self.counts["slice"] += 1
            self.heap_bytes += rounded(WORD_BYTES * (4 + len(value)))
        elif isinstance(thing, list | tuple | dict):
            self.counts["item"] += 1
        else:
            self.counts["item, boxed" if type(value) is float else "item of array"] += 1
        return value

    def store(self, thing: Any, key: Any, value: Any) -> None:
        """Store an item and count it."""
        self.counts["store item" if isinstance(thing, list) else "store item of array"] += 1
        thing[key] = value

    def unpack(self, value: Any) -> Any:
        """Count the unpacking of a value."""
        named = hasattr(type(value), "_fields")
        self.several("unpack named tuple" if named else "unpack", len(value))
        return value

    def make_tuple(self, value: Any) -> Any:
        """Count the creation of a tuple."""
        self.several("make tuple", len(value))
        self.heap_bytes += rounded(WORD_BYTES * (2 + len(value)))
        return value

    def make_list(self, value: Any) -> Any:
        """Count the creation of a list."""
        self.several("make list", len(value))
        self.heap_bytes += rounded(WORD_BYTES * (4 + len(value)))
        return value

    def call(self, function: Any, *arguments: Any, **named: Any) -> Any:
        """Call a function and count it."""
        self.counts["keyword"] += len(named)
        if isinstance(function, FunctionType):
            return self._call_own(function, arguments, named)
        self.counts["argument"] += len(arguments)
        result = function(*arguments, **named)
        self._count_builtin(function, arguments, result)
        return result

    def _call_own(self, function: FunctionType, arguments: Any, named: Any) -> Any:
        """Call a function of the core, with counts of its own."""
        missing = function.__code__.co_argcount - len(arguments) - len(named)
        self.counts["default"] += missing
        caller = self.counts
        name = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
        self.counts = self.functions.setdefault(name, Counter())
        result = function(*arguments, **named)
        self.counts = caller
        return result

    def _count_builtin(self, function: Any, arguments: tuple[Any, ...], result: Any) -> None:
        """Count a call of a builtin, a method or a class."""
        if hasattr(function, "_fields"):
            self.several("make named tuple", len(result))
            self.heap_bytes += rounded(WORD_BYTES * (2 + len(result)))
            return
        if type(result) is float:
            self.box(None)
        if getattr(function, "__module__", None) == "math":
            self.counts[of_math(function.__name__, arguments[0])] += 1
        elif function in (min, max):
            self.counts["min or max, float" if type(result) is float else "min or max"] += 1
        elif function in BUILTIN:
            self.counts[BUILTIN[function]] += 1
        elif isinstance(function, BuiltinMethodType) and hasattr(function, "__self__"):
            builtin = isinstance(function.__self__, ModuleType)
            self.counts["other builtin" if builtin else "method"] += 1
        elif isinstance(function, type) and function.__module__ != "builtins":
            self.counts["make object"] += 1
            self.heap_bytes += 4 * BOX_BYTES
        else:
            self.counts["other builtin"] += 1


def of_math(name: str, argument: float) -> str:
    """Return the kind of a function of `math`.

    Sine and cosine of small angles need no range reduction, so they have a kind of their own.
    """
    if name in ("sin", "cos"):
        return "sin or cos, small" if abs(argument) <= math.pi / 4 else "sin or cos"
    return MATH.get(name, "other of math")


def is_long(value: Any) -> bool:
    """Return whether an int is on the heap."""
    return isinstance(value, int) and not -SMALL_INT <= value < SMALL_INT


def rounded(size_bytes: int) -> int:
    """Return a size in whole blocks of the heap."""
    return -(-size_bytes // BOX_BYTES) * BOX_BYTES


def instructions(counts: Counter[str]) -> float:
    """Return the instructions of these counts."""
    return sum(INSTRUCTIONS[name] * count for name, count in counts.items())
