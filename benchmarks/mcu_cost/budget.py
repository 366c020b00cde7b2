"""What a tick of the core would cost on the LPC1768: operations counted, times a table of cycles.

Per navigator the recorded drives (worlds x noise levels) are run again on a copy of the core that
counts its operations (`weighed`), then made-up ticks that want the most of it (`hardest`). The
table and how far it can be trusted: `mcu`. Nothing here is timed: the figures are always the same.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from benchmarks.core import recorded
from benchmarks.mcu_cost.counted_core import WeighedCore
from benchmarks.mcu_cost.hardest import STORIES, TICKS, stories
from benchmarks.mcu_cost.mcu import INSTRUCTIONS, UNSEEN, milliseconds, share_percent
from benchmarks.mcu_cost.memory_size import heap_bytes
from benchmarks.mcu_cost.operation_counter import instructions
from plant.world.file import load
from robot.core.perception.from_messages import goal_of
from robot.core.values import Inputs
from study.trial.trial import NAVIGATORS, Trial, start_of, wire_goal_of
from verification.harness.figures import Figure, Report, percentile

BASELINE_PERCENT = 75.0
"""No limit is asked of the baselines that others are compared with; they must not outgrow the
period with what else a controller has to do in it."""
LIMITS_PERCENT = {
    "bug": 25.0,
    "vgm": 25.0,
    "bug1": BASELINE_PERCENT,
    "bug2": BASELINE_PERCENT,
    "distbug": BASELINE_PERCENT,
}
LIMIT_PERCENT = 50.0
STATE_BYTES = 4096
WORLDS = ("box", "forest_medium", "u_trap")
NOISES = ("none", "default", "harsh")
SECONDS = 30.0
DEAREST = 8


@dataclass(frozen=True, slots=True)
class Weight:
    """Of one tick."""

    functions: dict[str, float]
    operations: Counter[str]
    heap_bytes: int

    @property
    def instructions(self) -> float:
        return sum(self.functions.values())


@dataclass(slots=True)
class Weights:
    """Of many ticks, and the largest memory that the navigator had."""

    ticks: list[Weight] = field(default_factory=list)
    memory_bytes: int = 0

    def share(self, of: float) -> float:
        return percentile([tick.instructions for tick in self.ticks], of)

    def worst(self) -> Weight:
        return max(self.ticks, key=lambda tick: tick.instructions)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--noises", nargs="+", default=NOISES)
    parser.add_argument("--navigators", nargs="+", choices=NAVIGATORS, default=list(NAVIGATORS))
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each drive")
    parser.add_argument("--stories", type=int, default=STORIES, help="of made-up ticks")
    parser.add_argument("--dearest", action="store_true", help="what the worst tick is made of")


def measure(options: argparse.Namespace) -> Report:
    figures: list[Figure] = []
    notes = [
        "modelled, good to 25 %: MicroPython, Cortex-M3 without FPU, 96 MHz, period 50 ms; "
        "garbage is collected between the ticks",
        f"{len(options.worlds)} worlds x {len(options.noises)} noise levels, at most "
        f"{options.seconds:g} s each; {options.stories} stories of made-up ticks",
    ]
    for name in options.navigators:
        driven = drives(name, options.worlds, options.noises, options.seconds)
        hardest = hard_ticks(name, options.stories)
        figures += figures_of(name, driven, hardest)
        if options.dearest:
            worst = max(driven.worst(), hardest.worst(), key=lambda tick: tick.instructions)
            notes += made_of(name, worst)
    return Report(benchmark="budget", figures=tuple(figures), notes=tuple(notes))


def figures_of(name: str, driven: Weights, hardest: Weights) -> Iterator[Figure]:
    shares = {"median": 0.5, "p99": 0.99, "worst": 1.0}
    for says, share in shares.items():
        value = milliseconds(driven.share(share))
        yield Figure(name=f"{name}, {says} of {len(driven.ticks)}", unit="ms", values=(value,))
    made_up = milliseconds(hardest.share(1.0))
    yield Figure(
        name=f"{name}, worst of {len(hardest.ticks)} made up", unit="ms", values=(made_up,)
    )
    worst = max(driven.share(1.0), hardest.share(1.0))
    limit = LIMITS_PERCENT.get(name, LIMIT_PERCENT)
    percent = share_percent(worst)
    yield Figure(name=f"{name}, worst of all", unit="%", values=(percent,), at_most=limit)
    state = max(driven.memory_bytes, hardest.memory_bytes)
    yield Figure(name=f"{name}, state", unit="bytes", values=(state,), at_most=STATE_BYTES)
    garbage = max(tick.heap_bytes for tick in driven.ticks + hardest.ticks)
    yield Figure(name=f"{name}, garbage of a tick", unit="bytes", values=(garbage,))


def drives(name: str, worlds: Iterable[str], noises: Sequence[str], seconds: float) -> Weights:
    weights = Weights()
    for world in worlds:
        for noise in noises:
            trial = Trial(world=load(world), navigator=name, noise=noise, timeout_s=seconds)
            weigh_drive(trial, recorded(trial), weights)
    return weights


def weigh_drive(trial: Trial, inputs: Sequence[Inputs], weights: Weights) -> None:
    """From the first tick with a goal to the last with one."""
    core = WeighedCore()
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
        note(core, state.memory, weights)


def hard_ticks(name: str, count: int, ticks: int = TICKS) -> Weights:
    core, weights = WeighedCore(), Weights()
    params = core["parameters"].DEFAULTS._replace(navigator=NAVIGATORS[name])
    for state in stories(core, params, count=count, ticks=ticks):
        note(core, state.memory, weights)
    return weights


def note(core: WeighedCore, memory: object, weights: Weights) -> None:
    garbage, counted = core.scale.heap_bytes, core.take()
    functions = {name: UNSEEN * instructions(counts) for name, counts in counted.items()}
    total = sum(counted.values(), Counter[str]())
    weights.ticks.append(Weight(functions, total, garbage))
    weights.memory_bytes = max(weights.memory_bytes, heap_bytes(memory))


def made_of(name: str, worst: Weight) -> list[str]:
    """Which functions and which operations are dearest in this tick."""
    kinds = {
        f"{count} x {kind}": UNSEEN * INSTRUCTIONS[kind] * count
        for kind, count in worst.operations.items()
    }
    return [
        f"{name}, worst: {milliseconds(spent[what]):5.2f} ms {what}"
        for spent in (worst.functions, kinds)
        for what in sorted(spent, key=lambda what: -spent[what])[:DEAREST]
    ]
