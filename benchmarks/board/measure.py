"""Measure the core on the emulated board: `python -m benchmarks.board.measure`.

Trials drive with every navigator through worlds. Each tick's instructions are counted and its
cycles modelled by the plugin; the board itself reports heap, allocation and stack.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median

from benchmarks.board.counted import CountedBoard, counted, milliseconds
from plant.sim.simulation import Plant
from plant.world.file import load, shipped
from protocol.wire.messages import BoardHello, BoardReport
from robot.core.values import Outputs
from robot.hosting.on_board import BoardCore
from robot.mcu.image import IMAGE, IMAGES
from study.trial.core_loop import CoreLoop
from study.trial.trial import NAVIGATORS, Trial, run_trial

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "evidence" / "microcontroller.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Cost of one trial: times modelled in milliseconds, memory in bytes."""

    navigator: str
    world: str
    ticks: int
    equal: bool
    instructions: int
    command_ms: float
    median_ms: float
    worst_ms: float
    cycles_per_instruction: float
    heap_live: int
    heap_peak: int
    allocated: int
    stack: int


def measure(
    navigator: str, world: str, timeout_s: float, variant: str
) -> tuple[Measured, BoardHello]:
    """Run one trial on a counted board, and in this process for comparison."""
    trial = Trial(world=load(world), navigator=navigator, seed=1, timeout_s=timeout_s)
    reports: list[BoardReport] = []

    def watch(plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        assert isinstance(onboard.core, BoardCore)
        assert onboard.core.cost is not None
        reports.append(onboard.core.cost)

    with counted(IMAGES[variant].elf) as found:
        outcome = run_trial(trial, watch, partial(BoardCore, found.board))
        hello = found.board.hello
    equal = outcome.digest == run_trial(trial).digest
    return summary(trial, equal, reports, found), hello


def summary(
    trial: Trial, equal: bool, reports: Sequence[BoardReport], found: CountedBoard
) -> Measured:
    """Return the figures of a trial; the first tick also sets the core up and is left out."""
    ticks = found.ticks[1:]
    cycles = sum(tick.whole_cycles for tick in ticks)
    instructions = sum(tick.whole_instructions for tick in ticks)
    return Measured(
        navigator=trial.navigator,
        world=trial.world.name,
        ticks=len(reports),
        equal=equal,
        instructions=max(tick.whole_instructions for tick in ticks),
        command_ms=max(milliseconds(tick.command_cycles) for tick in ticks),
        median_ms=median(milliseconds(tick.whole_cycles) for tick in ticks),
        worst_ms=max(milliseconds(tick.whole_cycles) for tick in ticks),
        cycles_per_instruction=cycles / instructions,
        heap_live=max(report.heap_live_bytes for report in reports),
        heap_peak=max(report.heap_peak_bytes for report in reports[1:]),
        allocated=max(report.allocated_bytes for report in reports[1:]),
        stack=reports[-1].stack_peak_bytes,
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, write the results and print them; exit code 1 if a trajectory differs."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.board.measure", description=__doc__)
    parser.add_argument("--worlds", default=",".join(shipped()), help="comma-separated names")
    parser.add_argument("--navigators", default=",".join(NAVIGATORS), help="comma-separated names")
    parser.add_argument("--timeout", type=float, default=60.0, help="simulated seconds of a trial")
    parser.add_argument("--variant", choices=IMAGES, default=IMAGE.name)
    parser.add_argument("--output", type=Path, default=RESULTS)
    options = parser.parse_args(argv)
    rows: list[Measured] = []
    for navigator in options.navigators.split(","):
        for world in options.worlds.split(","):
            row, hello = measure(navigator, world, options.timeout, options.variant)
            rows.append(row)
            print(row, flush=True)
    image = {
        "variant": options.variant,
        "flash": hello.flash_bytes,
        "static": hello.static_bytes,
        "heap": hello.heap_bytes,
        "stack": hello.stack_bytes,
        "timeout_s": options.timeout,
    }
    results = {"image": image, "trials": [asdict(row) for row in rows]}
    options.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return 0 if all(row.equal for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
