"""Modelled cost of a tick of the core on the LPC1768: counted operations times a cycle table.

Per navigator the recorded drives (worlds x noise levels) are repeated on a copy of the core that
counts its operations (`counted_core`). Synthetic worst-case ticks follow (`hardest`). The table and
its accuracy are in `mcu`. Nothing is timed, so the figures are always the same.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from benchmarks.core import recorded
from benchmarks.mcu_cost.counted_core import CountedCore
from benchmarks.mcu_cost.hardest import SCENARIOS, TICKS, scenarios
from benchmarks.mcu_cost.mcu import INSTRUCTIONS, UNCOUNTED_FACTOR, milliseconds, share_percent
from benchmarks.mcu_cost.memory_size import heap_bytes
from benchmarks.mcu_cost.operation_counter import instructions
from plant.world.file import load
from robot.core.perception.from_messages import goal_of
from robot.core.values import Inputs
from study.trial.trial import NAVIGATORS, Trial, start_of, wire_goal_of
from verification.harness.figures import Figure, Report, percentile

BASELINE_PERCENT = 75.0
"""Limit of the baseline navigators: with the other work of a controller they must fit into the
period."""
LIMITS_PERCENT = {
    "bug": 35.0,
    "vgm": 35.0,
    "bug1": BASELINE_PERCENT,
    "bug2": BASELINE_PERCENT,
    "distbug": BASELINE_PERCENT,
}
LIMIT_PERCENT = 50.0
STATE_BYTES = 4096
WORLDS = ("box", "forest_medium", "u_trap")
NOISES = ("none", "default", "harsh")
SECONDS = 30.0
MAX_LISTED = 8


@dataclass(frozen=True, slots=True)
class TickCost:
    """Cost of one tick by function and by operation."""

    functions: dict[str, float]
    operations: Counter[str]
    heap_bytes: int

    @property
    def instructions(self) -> float:
        """Instructions of all functions."""
        return sum(self.functions.values())


@dataclass(slots=True)
class TickCosts:
    """Costs of many ticks, and the largest memory of the navigator."""

    ticks: list[TickCost] = field(default_factory=list)
    memory_bytes: int = 0

    def quantile(self, of: float) -> float:
        """Return a quantile of the instructions."""
        return percentile([tick.instructions for tick in self.ticks], of)

    def worst(self) -> TickCost:
        """Return the most expensive tick."""
        return max(self.ticks, key=lambda tick: tick.instructions)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--noises", nargs="+", default=NOISES)
    parser.add_argument("--navigators", nargs="+", choices=NAVIGATORS, default=list(NAVIGATORS))
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each drive")
    parser.add_argument("--stories", type=int, default=SCENARIOS, help="of synthetic ticks")
    parser.add_argument("--dearest", action="store_true", help="list the costs of the worst tick")


def measure(options: argparse.Namespace) -> Report:
    """Model the selected navigators."""
    figures: list[Figure] = []
    notes = [
        "modelled, accurate to 25 %: MicroPython, Cortex-M3 without FPU, 96 MHz, period 50 ms; "
        "garbage is collected between the ticks",
        f"{len(options.worlds)} worlds x {len(options.noises)} noise levels, at most "
        f"{options.seconds:g} s each; {options.stories} scenarios of synthetic ticks",
    ]
    for name in options.navigators:
        driven = driven_ticks(name, options.worlds, options.noises, options.seconds)
        hardest = worst_case_ticks(name, options.stories)
        figures += figures_of(name, driven, hardest)
        if options.dearest:
            worst = max(driven.worst(), hardest.worst(), key=lambda tick: tick.instructions)
            notes += cost_breakdown(name, worst)
    return Report(benchmark="budget", figures=tuple(figures), notes=tuple(notes))


def figures_of(name: str, driven: TickCosts, hardest: TickCosts) -> Iterator[Figure]:
    """Yield the figures of one navigator."""
    shares = {"median": 0.5, "p99": 0.99, "worst": 1.0}
    for label, quantile in shares.items():
        value = milliseconds(driven.quantile(quantile))
        yield Figure(name=f"{name}, {label} of {len(driven.ticks)}", unit="ms", values=(value,))
    synthetic_ms = milliseconds(hardest.quantile(1.0))
    yield Figure(
        name=f"{name}, worst of {len(hardest.ticks)} synthetic", unit="ms", values=(synthetic_ms,)
    )
    worst = max(driven.quantile(1.0), hardest.quantile(1.0))
    limit = LIMITS_PERCENT.get(name, LIMIT_PERCENT)
    percent = share_percent(worst)
    yield Figure(name=f"{name}, worst of all", unit="%", values=(percent,), at_most=limit)
    state = max(driven.memory_bytes, hardest.memory_bytes)
    yield Figure(name=f"{name}, state", unit="bytes", values=(state,), at_most=STATE_BYTES)
    garbage = max(tick.heap_bytes for tick in driven.ticks + hardest.ticks)
    yield Figure(name=f"{name}, garbage of a tick", unit="bytes", values=(garbage,))


def driven_ticks(
    name: str, worlds: Iterable[str], noises: Sequence[str], seconds: float
) -> TickCosts:
    """Return the costs of the drives in these worlds."""
    costs = TickCosts()
    for world in worlds:
        for noise in noises:
            trial = Trial(world=load(world), navigator=name, noise=noise, timeout_s=seconds)
            count_drive(trial, recorded(trial), costs)
    return costs


def count_drive(trial: Trial, inputs: Sequence[Inputs], costs: TickCosts) -> None:
    """Add the costs of a drive, from the first tick with a goal to the last."""
    core = CountedCore()
    brain, modes = core["brain"], core["modes"]
    params = core["parameters"].DEFAULTS._replace(navigator=NAVIGATORS[trial.navigator])
    state = brain.State(params)
    state.odometry.pose = core["values"].Pose(*start_of(trial.world))
    brain.step(state, inputs[0], params)
    modes.arm(state.machine)
    goal = core["values"].Goal(*goal_of(*wire_goal_of(trial.world)))
    modes.goto(state.machine, goal, core["states"].AUTO, inputs[0].now_ms)
    core.take()
    for one in inputs[1:]:
        brain.step(state, one, params)
        record_tick(core, state.memory, costs)


def worst_case_ticks(
    name: str, count: int, ticks: int = TICKS, core: CountedCore | None = None
) -> TickCosts:
    """Return the costs of synthetic scenarios, on a new core unless one is given."""
    core, costs = core or CountedCore(), TickCosts()
    params = core["parameters"].DEFAULTS._replace(navigator=NAVIGATORS[name])
    for state in scenarios(core, params, count=count, ticks=ticks):
        record_tick(core, state.memory, costs)
    return costs


def record_tick(core: CountedCore, memory: object, costs: TickCosts) -> None:
    """Add the cost of the last tick."""
    garbage, counted = core.counter.heap_bytes, core.take()
    functions = {name: UNCOUNTED_FACTOR * instructions(counts) for name, counts in counted.items()}
    total = Counter[str]()
    for counts in counted.values():
        total.update(counts)
    costs.ticks.append(TickCost(functions, +total, garbage))
    costs.memory_bytes = max(costs.memory_bytes, heap_bytes(memory))


def cost_breakdown(name: str, worst: TickCost) -> list[str]:
    """Return the most expensive functions and operations of a tick."""
    kinds = {
        f"{count} x {kind}": UNCOUNTED_FACTOR * INSTRUCTIONS[kind] * count
        for kind, count in worst.operations.items()
    }
    return [
        f"{name}, worst: {milliseconds(spent[what]):5.2f} ms {what}"
        for spent in (worst.functions, kinds)
        for what in sorted(spent, key=lambda what: -spent[what])[:MAX_LISTED]
    ]
