"""The operation counter agrees with counts by hand."""

import ast
from argparse import ArgumentParser
from collections import Counter
from math import pi, sin
from typing import Any

import pytest

from benchmarks.mcu_cost import budget, mcu
from benchmarks.mcu_cost.instrumentation import COUNTER, Instrumentation
from benchmarks.mcu_cost.memory_size import heap_bytes, lengths
from benchmarks.mcu_cost.operation_counter import OperationCounter
from robot.core.values import Pose


def counted(source: str, *arguments: Any) -> tuple[Any, Counter[str]]:
    """Return the result of `f` and its cost by operation."""
    counter = OperationCounter()
    tree = Instrumentation(counter, "here").visit(ast.parse(source))
    space: dict[str, Any] = {COUNTER: counter, "sin": sin, "__name__": "here"}
    exec(compile(ast.fix_missing_locations(tree), "here", "exec"), space)
    counter.clear()
    result = space["f"](*arguments)
    return result, +sum(counter.by_function().values(), Counter[str]())


def test_addition_is_counted_by_its_operand_types() -> None:
    source = "def f(a, b):\n    return a + b\n"
    always = {"call": 1, "argument": 2, "local": 2}
    assert counted(source, 1, 2) == (3, Counter({**always, "int": 1}))
    assert counted(source, 1, 2.5) == (3.5, Counter({**always, "float + - *": 1}))
    assert counted(source, 1, 1 << 30)[1]["long int"] == 1


def test_only_executed_operations_are_counted() -> None:
    source = "def f(a):\n    return 1.0 * a if a < 0.5 and a > 0.1 else -a\n"
    result, inside = counted(source, 0.3)
    assert (result, inside["float compare"], inside["float + - *"]) == (0.3, 2, 1)
    result, outside = counted(source, 0.7)
    assert (result, outside["float compare"], outside["float negate"]) == (-0.7, 1, 1)


def test_comparison_chain_counts_up_to_the_first_failure() -> None:
    source = "def f(a):\n    return 0 < a + 1 <= 9\n"
    assert counted(source, -5)[1]["int compare"] == 1
    result, both = counted(source, 5)
    assert (result, both["int compare"], both["int"]) == (True, 2, 1)


def test_loop_body_counts_once_per_iteration() -> None:
    source = "def f(n):\n    k = 0\n    while k < n:\n        k += 1\n    return k\n"
    result, counts = counted(source, 4)
    assert (result, counts["int compare"], counts["int"]) == (4, 5, 4)
    source = "def f(n):\n    s = 0\n    for i in range(n):\n        s += i\n    return s\n"
    result, counts = counted(source, 4)
    assert (result, counts["range, each"], counts["int"]) == (6, 4, 4)


def test_later_fields_cost_more() -> None:
    source = "def f(p):\n    return p.heading_rad\n"
    result, counts = counted(source, Pose(1.0, 2.0, 3.0))
    assert (result, counts["field"], counts["field, each before it"]) == (3.0, 1, 2)


@pytest.mark.parametrize(("angle_rad", "kind"), [(0.1, "sin or cos, small"), (pi, "sin or cos")])
def test_math_functions_have_their_own_cost(angle_rad: float, kind: str) -> None:
    result, counts = counted("def f(a):\n    return sin(a)\n", angle_rad)
    assert (result, counts[kind]) == (sin(angle_rad), 1)


def test_list_operations_are_counted() -> None:
    source = "def f(a):\n    a[1] = a[0]\n    a[0] += 2\n    x, y, z, w = a\n    return x, y\n"
    result, counts = counted(source, [1, 2, 3, 4])
    assert result == (3, 1)
    assert (counts["item"], counts["store item"], counts["unpack, each"]) == (2, 2, 4)
    assert (counts["make tuple"], counts["make tuple, each"]) == (1, 2)


def test_call_is_counted_in_the_called_function() -> None:
    source = "def g(a, b=2):\n    return a\n\ndef f():\n    return g(g(1))\n"
    result, counts = counted(source)
    assert (result, counts["call"], counts["argument"], counts["default"]) == (1, 3, 4, 2)


def test_every_counted_operation_has_a_cost() -> None:
    costs = budget.worst_case_ticks("bug", 2, 20)
    kinds = set().union(*(tick.operations for tick in costs.ticks))
    assert kinds <= set(mcu.INSTRUCTIONS)
    assert len(kinds) > 20
    assert all(price > 0 for price in mcu.INSTRUCTIONS.values())


class Thing:
    __slots__ = ("a", "b")

    def __init__(self, a: object, b: object) -> None:
        self.a, self.b = a, b


class Loose:
    """An object with a __dict__, whose size is not bounded."""


def test_memory_size_is_that_of_its_blocks() -> None:
    assert heap_bytes(Thing(1, None)) == 32
    assert heap_bytes(Thing(1.5, 1 << 40)) == 32 + 16 + 32
    assert heap_bytes(Thing([0] * 10, bytearray(20))) == 32 + (16 + 48) + (16 + 32)
    assert heap_bytes(Thing([0.0] * 10, Pose(0.0, 0.0, 0.0))) == 32 + (16 + 48 + 160) + (32 + 48)
    shared = [0] * 4
    assert heap_bytes(Thing(shared, shared)) == 32 + 32
    with pytest.raises(TypeError, match="Loose: no __slots__"):
        heap_bytes(Thing(Loose(), 1))


def test_lengths_grow_with_a_list() -> None:
    growing: list[int] = []
    thing = Thing(growing, [1, 2])
    assert lengths(thing) == 2
    growing.append(1)
    assert lengths(thing) == 3


def test_report_compares_each_navigator_with_its_limit() -> None:
    parser = ArgumentParser()
    budget.add_options(parser)
    few = ["--worlds", "box", "--noises", "none", "--seconds", "2", "--stories", "1"]
    report = budget.measure(parser.parse_args([*few, "--navigators", "vgm", "--dearest"]))
    limits = {figure.name: figure.at_most for figure in report.figures if figure.at_most}
    assert limits == {"vgm, worst of all": 35.0, "vgm, state": 4096}
    assert report.met
    assert any("float + - *" in record_tick for record_tick in report.notes)


def test_instructions_convert_to_time_and_share() -> None:
    """Convert 1 million instructions to 16.7 ms, a third of the period."""
    assert mcu.milliseconds(1_000_000) == pytest.approx(16.7, abs=0.05)
    assert mcu.share_percent(1_500_000) == pytest.approx(50.0)
