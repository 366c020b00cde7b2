"""Search for expensive ticks of the core, by the bytecodes that CPython executes in it.

The search runs synthetic scenarios in this process, which is fast, and ranks them by their tick
with the most bytecodes. The cost of the first ones is then measured on the board. The result is the
worst tick found, not an upper bound.
"""

import sys
from pathlib import Path
from types import FrameType
from typing import Any, Final

from checks.speed.board.scenarios import Scenario, run_scenario
from robot import core
from robot.hosting import InProcessCore

SCENARIOS: Final = 24
TICKS: Final = 200
MEASURED: Final = 2
"""Scenarios of each navigator that are measured on the board."""
SOURCES: Final = str(Path(core.__file__).parent)


class BytecodeCounter:
    """Counts the bytecodes that are executed in the modules of the core."""

    def __init__(self) -> None:
        self.count = 0

    def enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        """Trace the bytecodes of a function of the core; called by `sys.settrace`."""
        if not frame.f_code.co_filename.startswith(SOURCES):
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return self.trace

    def trace(self, frame: FrameType, event: str, argument: Any) -> Any:
        """Count a bytecode."""
        self.count += event == "opcode"
        return self.trace


def search(navigator: str, count: int = SCENARIOS, ticks: int = TICKS) -> list[tuple[str, int]]:
    """Return the scenarios whose worst ticks execute the most bytecodes."""
    numbers = range(count)
    worst = {number: bytecodes(Scenario(navigator, number), ticks) for number in numbers}
    ranked = sorted(numbers, key=lambda number: -worst[number])
    return [(navigator, number) for number in ranked[:MEASURED]]


def bytecodes(scenario: Scenario, ticks: int) -> int:
    """Return the bytecodes of the worst tick of a scenario; its first tick is left out."""
    counter, most = BytecodeCounter(), 0
    core = InProcessCore(scenario.params())
    before = sys.gettrace()
    sys.settrace(counter.enter)
    try:
        for tick in run_scenario(core, scenario.body(), ticks):
            most = max(most, counter.count if tick else 0)
            counter.count = 0
    finally:
        sys.settrace(before)
    return most
