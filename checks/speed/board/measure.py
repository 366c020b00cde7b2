"""Measure the core on the emulated board: `python -m checks.speed.board.measure`.

Trials drive with every navigator through all worlds, and the scenarios found by `hardest` follow.
Each tick's instructions are counted and its cycles modelled by the plugin; the board itself reports
heap, allocation and stack. The state of a navigator is counted in this process. A drive that was
measured with the same image is not repeated. Exits with 1 if a trajectory differs from that of the
core in this process, or a ceiling is exceeded.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from time import monotonic
from typing import Final

from checks.same_bits.on_board import SHOWN, image_hash
from checks.speed.board import hardest
from checks.speed.board.counted import CountedBoard, counted, milliseconds
from checks.speed.board.results import COSTS, Build, Cost, Costs, excesses, read, write
from checks.speed.board.scenarios import Scenario, run_scenario
from checks.speed.board.state_size import state_bytes
from firmware.board import Board
from firmware.host import BoardCore
from firmware.image import IMAGE
from plant.sim.simulation import Plant
from plant.world.file import load, shipped
from protocol.wire.messages import BoardReport
from robot.core.values import Outputs
from robot.hosting import InProcessCore
from study.trial.core_loop import CoreLoop
from study.trial.trial import NAVIGATORS, Trial, run_trial

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
    scenario = Scenario(navigator, number)
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
    parser.add_argument("--scenarios", type=int, default=hardest.SCENARIOS, help="to search")
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
            costs.searched = options.scenarios * hardest.TICKS
            found = pool.map(partial(hardest.search, count=options.scenarios), NAVIGATORS)
            picked = [one for scenarios in found for one in scenarios]
            scenarios = [pool.submit(measure_scenario, *one, hardest.TICKS) for one in picked]
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
