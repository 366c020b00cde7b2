"""An emulated board whose instructions are counted and whose cycles are modelled."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from typing import Final

from firmware.board import Board, Emulator
from firmware.image import OUTPUT
from runtime.errors import UserError

SOURCE: Final = Path(__file__).with_name("cycles.c")
PLUGIN: Final = OUTPUT / "cycles.so"
MARKS: Final = ("mark_tick", "mark_command", "link_receive")
TICK, COMMAND, WAIT = range(len(MARKS))
RECORD: Final = Struct("<IIQQ")
MHZ: Final = 96.0
PATIENCE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class TickCost:
    """Instructions and modelled cycles of one tick.

    `command` counts from TICK_INPUTS to the wheel command, `whole` everything since the tick
    before, with serial line and garbage collection.
    """

    command_instructions: int
    command_cycles: int
    whole_instructions: int
    whole_cycles: int


class CountedBoard:
    """A board, and the costs of its ticks, which are there after it has ended."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.ticks: list[TickCost] = []


@contextmanager
def counted(image: Path) -> Iterator[CountedBoard]:
    """Start an emulated board with the plugin; its `ticks` are filled at the end of the block.

    Raises UserError if the plugin does not compile, or without an emulator or an image.
    """
    build_plugin()
    with TemporaryDirectory(prefix="sidestep-cycles-") as folder:
        out = Path(folder) / "marks"
        marks = ":".join(hex(address) for address in addresses(image))
        extra = ("-plugin", f"{PLUGIN},out={out},marks={marks}")
        with Emulator(image, extra=extra) as emulator:
            found = CountedBoard(Board(emulator.line, PATIENCE_S))
            found.board.wait_for_hello()
            yield found
            emulator.terminate()
        found.ticks = list(costs(out.read_bytes()))


def build_plugin() -> None:
    """Compile the plugin unless it is newer than its source."""
    if PLUGIN.exists() and PLUGIN.stat().st_mtime >= SOURCE.stat().st_mtime:
        return
    command = ["gcc", "-O2", "-Wall", "-Wextra", "-shared", "-fPIC", "-o", str(PLUGIN), str(SOURCE)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise UserError(f"the plugin does not compile: {done.stderr.splitlines()[0]}")


def addresses(image: Path) -> list[int]:
    """Return the addresses of the marks in an image."""
    done = subprocess.run(
        ["arm-none-eabi-nm", str(image)], capture_output=True, text=True, check=True
    )
    found = {line.split()[2]: int(line.split()[0], 16) for line in done.stdout.splitlines()}
    return [found[mark] for mark in MARKS]


def costs(records: bytes) -> Iterator[TickCost]:
    """Yield the cost of each tick from the records of the plugin."""
    begun = began = commanded = (0, 0)
    within = False
    for mark, _, instructions, cycles in RECORD.iter_unpack(records):
        now = (instructions, cycles)
        if mark == TICK:
            began, within = now, True
        elif mark == COMMAND:
            commanded = now
        elif within:
            yield TickCost(
                commanded[0] - began[0],
                commanded[1] - began[1],
                now[0] - begun[0],
                now[1] - begun[1],
            )
            begun, within = now, False
        elif begun == (0, 0):
            begun = now


def milliseconds(cycles: float) -> float:
    """Return modelled milliseconds at 96 MHz."""
    return cycles / MHZ / 1000.0
