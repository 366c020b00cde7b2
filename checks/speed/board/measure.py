"""Measure the core on the emulated board: `python -m checks.speed.board.measure`.

Trials drive with every navigator through all worlds, and the scenarios found by `scenarios` follow.
Each tick's instructions are counted and its cycles modelled by the plugin; the board itself reports
heap, allocation and stack. The state of a navigator is counted in this process. A drive that was
measured with the same image is not repeated. Exits with 1 if a trajectory differs from that of the
core in this process, or a ceiling is exceeded. The results are committed, and compared with the
ceilings by tests, too.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from struct import Struct
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Final, NamedTuple

import msgspec

from checks.same_bits.on_board import SHOWN, image_hash
from checks.speed.board.scenarios import (
    SCENARIOS,
    TICKS,
    TickScenario,
    run_scenario,
    search,
    state_bytes,
)
from firmware.board import Board, Emulator
from firmware.host import BoardCore
from firmware.image import IMAGE, OUTPUT
from plant.sim.simulation import Plant
from plant.world.file import load, shipped
from protocol.navigators import NAVIGATORS
from protocol.wire.messages import BoardReport
from robot.core.values import Outputs
from robot.hosting import InProcessCore
from runtime.errors import UserError
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

ROOT: Final = Path(__file__).resolve().parents[3]
FOLDER: Final = ROOT / "docs" / "evidence" / "microcontroller"
COSTS: Final = FOLDER / "cost.json"


class Cost(msgspec.Struct, frozen=True, kw_only=True):
    """Worst ticks of one drive or scenario: times modelled in milliseconds, memory in bytes.

    `command` is the path from the inputs to the wheel command, `whole` everything since the end of
    the tick before. `heap_peak` and `stack` are the largest since the reset. `equal`: the digest of
    the drive, or every estimated pose of the scenario, is that of the core in this process.
    """

    navigator: str
    world: str
    ticks: int
    equal: bool
    command_instructions: int
    whole_instructions: int
    command_ms: float
    median_ms: float
    whole_ms: float
    cycles_per_instruction: float
    heap_live: int
    heap_peak: int
    allocated: int
    stack: int


class Build(msgspec.Struct, frozen=True, kw_only=True):
    """The measured image; sizes in bytes, hashes are the beginnings of SHA-256."""

    image: str
    core: str
    flash: int
    static: int
    heap: int
    stack: int


class Costs(msgspec.Struct):
    """All measurements with one image; `searched`: ticks that the search ran for each navigator.

    `state_bytes`: the largest state of each navigator on the heap of the board.
    """

    build: Build
    noise: str
    seed: int
    limit_s: float
    drives: list[Cost] = []
    searched: int = 0
    hardest: list[Cost] = []
    state_bytes: dict[str, int] = {}


class Ceiling(NamedTuple):
    """Limits of the worst tick in milliseconds: the target, and the ceilings of the gate."""

    wanted_ms: float
    command_ms: float
    whole_ms: float


CEILINGS: Final = {
    "bug": Ceiling(12.5, 9.5, 14.5),
    "vgm": Ceiling(12.5, 9.5, 14.0),
    "vgm_memory": Ceiling(25.0, 19.5, 23.0),
    "bug1": Ceiling(25.0, 19.0, 22.5),
    "bug2": Ceiling(25.0, 19.0, 22.5),
    "distbug": Ceiling(25.0, 19.0, 22.5),
}
FLASH_BYTES: Final = 512 * 1024
RAM_BYTES: Final = 64 * 1024
WANTED_RAM_BYTES: Final = 32 * 1024
STACK_BYTES: Final = 4 * 1024
HEAP_LIVE_BYTES: Final = 32 * 1024


def excesses(build: Build, cost: Cost) -> list[str]:
    """Return a text about each figure that is above its ceiling."""
    ceiling = CEILINGS[cost.navigator]
    figures = (
        ("command path, ms", cost.command_ms, ceiling.command_ms),
        ("whole tick, ms", cost.whole_ms, ceiling.whole_ms),
        ("live heap, bytes", cost.heap_live, HEAP_LIVE_BYTES),
        ("stack, bytes", cost.stack, STACK_BYTES),
        ("RAM, bytes", ram_bytes(build, cost), RAM_BYTES),
        ("flash, bytes", build.flash, FLASH_BYTES),
    )
    where = f"{cost.navigator} in {cost.world}"
    return [
        f"{where}: {name}: {found:g} > {most:g}" for name, found, most in figures if found > most
    ]


def ram_bytes(build: Build, cost: Cost) -> int:
    """Return static memory, the largest use of the heap and that of the stack."""
    return build.static + cost.heap_peak + cost.stack


def read(path: Path = COSTS) -> Costs:
    """Return the committed measurements."""
    return msgspec.json.decode(path.read_bytes(), type=Costs)


def write(costs: Costs, path: Path = COSTS) -> None:
    """Replace the measurements in a file."""
    costs.drives.sort(key=lambda cost: (cost.navigator, cost.world))
    costs.hardest.sort(key=lambda cost: (cost.navigator, cost.world))
    new = path.with_suffix(".new")
    new.write_bytes(msgspec.json.format(msgspec.json.encode(costs), indent=1) + b"\n")
    new.replace(path)


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


NOISE: Final = "default"
SEED: Final = 1
LIMIT_S: Final = 20.0


def measure_drive(
    world: str, navigator: str, limit_s: float, last_s: float = float("inf")
) -> Cost | None:
    """Measure one trial on a board; None if it is too late to start."""
    if monotonic() > last_s:
        return None
    trial = Trial(world=load(world), navigator=navigator, noise=NOISE, seed=SEED, timeout_s=limit_s)
    reports: list[BoardReport] = []

    def watch(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        assert isinstance(onboard.core, BoardCore)
        reports.append(report_of(onboard.core))

    with counted(IMAGE.elf) as found:
        outcome = run_trial(trial, watch, partial(BoardCore, found.board))
    equal = outcome.digest == run_trial(trial).digest
    return summary(navigator, world, equal, reports, found)


def measure_scenario(navigator: str, number: int, ticks: int) -> Cost:
    """Measure one scenario of the search on a board."""
    scenario = TickScenario(navigator, number)
    ours = InProcessCore(scenario.params())
    expected = [ours.state.odometry.pose for _ in run_scenario(ours, scenario.body(), ticks)]
    reports, driven = [], []
    with counted(IMAGE.elf) as found:
        core = BoardCore(found.board, scenario.params())
        for _ in run_scenario(core, scenario.body(), ticks):
            driven.append(core.state.odometry.pose)
            reports.append(report_of(core))
    return summary(navigator, f"search {number}", driven == expected, reports, found)


def report_of(core: BoardCore) -> BoardReport:
    """Return the board's report of the last tick."""
    assert core.cost is not None
    return core.cost


def summary(
    navigator: str, world: str, equal: bool, reports: Sequence[BoardReport], found: CountedBoard
) -> Cost:
    """Return the figures of a drive; the first tick also sets the core up and is left out."""
    ticks = found.ticks[1:]
    cycles = sum(tick.whole_cycles for tick in ticks)
    instructions = sum(tick.whole_instructions for tick in ticks)
    return Cost(
        navigator=navigator,
        world=world,
        ticks=len(reports),
        equal=equal,
        command_instructions=max(tick.command_instructions for tick in ticks),
        whole_instructions=max(tick.whole_instructions for tick in ticks),
        command_ms=round(max(milliseconds(tick.command_cycles) for tick in ticks), 3),
        median_ms=round(median(milliseconds(tick.whole_cycles) for tick in ticks), 3),
        whole_ms=round(max(milliseconds(tick.whole_cycles) for tick in ticks), 3),
        cycles_per_instruction=round(cycles / instructions, 3),
        heap_live=max(report.heap_live_bytes for report in reports),
        heap_peak=max(report.heap_peak_bytes for report in reports),
        allocated=max(report.allocated_bytes for report in reports[1:]),
        stack=reports[-1].stack_peak_bytes,
    )


def build() -> Build:
    """Return hashes and sizes of the image; the board reports its sizes."""
    with Board.emulated() as board:
        hello = board.hello
    return Build(
        image=image_hash(),
        core=bytes(hello.core_hash).hex()[:SHOWN],
        flash=hello.flash_bytes,
        static=hello.static_bytes,
        heap=hello.heap_bytes,
        stack=hello.stack_bytes,
    )


def resumed(path: Path, limit_s: float) -> Costs:
    """Return the measurements in a file if they are of this image and limit, else empty ones."""
    made = build()
    if path.exists():
        before = read(path)
        if (before.build.image, before.limit_s) == (made.image, limit_s):
            return before
    return Costs(build=made, noise=NOISE, seed=SEED, limit_s=limit_s)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the drives without a result and write the results; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m checks.speed.board.measure", description=__doc__
    )
    parser.add_argument("--limit", type=float, default=LIMIT_S, help="simulated seconds of a drive")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N")
    parser.add_argument("--minutes", type=float, default=1e6, help="start no drive after this time")
    parser.add_argument("--scenarios", type=int, default=SCENARIOS, help="to search")
    parser.add_argument("--output", type=Path, default=COSTS, metavar="FILE")
    options = parser.parse_args(argv)
    last_s = monotonic() + 60.0 * options.minutes
    costs = resumed(options.output, options.limit)
    with ProcessPoolExecutor(options.jobs) as pool:
        if set(NAVIGATORS) - set(costs.state_bytes):
            costs.state_bytes = dict(
                zip(NAVIGATORS, pool.map(state_bytes, NAVIGATORS), strict=True)
            )
            write(costs, options.output)
        if not costs.hardest:
            costs.searched = options.scenarios * TICKS
            found = pool.map(partial(search, count=options.scenarios), NAVIGATORS)
            picked = [one for scenarios in found for one in scenarios]
            scenarios = [pool.submit(measure_scenario, *one, TICKS) for one in picked]
            keep(costs, costs.hardest, scenarios, options.output)
        done = {(cost.world, cost.navigator) for cost in costs.drives}
        todo = [one for one in product(shipped(), NAVIGATORS) if one not in done]
        drives = [pool.submit(measure_drive, *one, options.limit, last_s) for one in todo]
        keep(costs, costs.drives, drives, options.output)
    return judged(costs)


def keep(
    costs: Costs, rows: list[Cost], runs: Sequence["Future[Cost] | Future[Cost | None]"], path: Path
) -> None:
    """Write the measurements to a file whenever a run has ended."""
    for run in as_completed(runs):
        if (cost := run.result()) is not None:
            rows.append(cost)
            write(costs, path)
            print(cost, flush=True)


def judged(costs: Costs) -> int:
    """Print the drives that differ and the figures above their ceilings; return the exit code."""
    all_costs = [*costs.drives, *costs.hardest]
    words = [f"{cost.navigator} in {cost.world} differs" for cost in all_costs if not cost.equal]
    words += [excess for cost in all_costs for excess in excesses(costs.build, cost)]
    print("\n".join(words) or "all equal and within their ceilings")
    return 1 if words else 0


if __name__ == "__main__":
    sys.exit(main())
