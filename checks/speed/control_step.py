"""CPU time of one step of the control core, over a recorded drive through a forest.

The garbage collector stays enabled after `gc.freeze()`, as on the robot. The cost of reading the
clock is included and reported. Each repetition replays the same inputs from the start; a longer
drive repeats the recorded one.
"""

import argparse
import gc
from time import thread_time_ns

from checks.harness.figures import Figure, Report, percentile
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.wire.messages import SonarScan, WheelTicks
from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS
from robot.core.values import Goal, Inputs, Outputs, Pose, goal_of, now_ms_of, scan_of, wheels_of
from study.trial.core_loop import CoreLoop
from study.trial.trial import (
    NAVIGATORS,
    USUAL_NAVIGATOR,
    Trial,
    run_trial,
    start_of,
    wire_goal_of,
)

MEDIAN_US, WORST_US = 60.0, 200.0
STEPS = 10_000


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--navigator", choices=NAVIGATORS, default=USUAL_NAVIGATOR)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--repetitions", type=int, default=5)


def measure(options: argparse.Namespace) -> Report:
    """Measure the steps of a recorded drive."""
    world = load(options.world)
    inputs = recorded(Trial(world=world, navigator=options.navigator))
    start, goal = start_of(world), goal_of(*wire_goal_of(world))
    navigator = NAVIGATORS[options.navigator]
    gc.freeze()
    try:
        runs = [
            costs_us(inputs, start, goal, navigator, options.steps)
            for _ in range(options.repetitions)
        ]
    finally:
        gc.unfreeze()
    shares = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "worst": 1.0}
    limits = {"median": MEDIAN_US, "worst": WORST_US}
    figures = [
        Figure(
            name=f"brain.step, {name} of {options.steps}",
            unit="us",
            values=tuple(percentile(run, share) for run in runs),
            at_most=limits.get(name),
        )
        for name, share in shares.items()
    ]
    notes = (
        f"{options.world}, {options.navigator}: {len(inputs)} recorded ticks, repeated",
        "CPU time of the thread; garbage collector on after gc.freeze(), as on the robot",
        f"reading the clock costs {percentile(idle_us(), 0.5):.2f} us of each",
    )
    return Report(benchmark="core", figures=tuple(figures), notes=notes)


def recorded(trial: Trial) -> list[Inputs]:
    """Return the inputs of the core, tick by tick, from the tick of the goal on."""
    inputs: list[Inputs] = []

    def watch(plant: Plant, _onboard: CoreLoop, _outputs: Outputs) -> None:
        wheels, scan = plant.senses()
        inputs.append(given(plant.now_ns, wheels, scan))

    run_trial(trial, watch)
    return inputs


def given(now_ns: int, wheels: WheelTicks | None, scan: SonarScan | None) -> Inputs:
    """Return the inputs of one tick."""
    return Inputs(
        now_ms_of(now_ns),
        None if wheels is None else wheels_of(wheels),
        None if scan is None else scan_of(scan, 0),
        None,
    )


def costs_us(
    inputs: list[Inputs], start: Pose, goal: Goal, navigator: int, steps: int
) -> list[float]:
    """Return the CPU time in us of this many steps."""
    costs: list[float] = []
    while len(costs) < steps:
        costs += drive_us(inputs, start, goal, navigator)
    return costs[:steps]


def drive_us(inputs: list[Inputs], start: Pose, goal: Goal, navigator: int) -> list[float]:
    """Return the CPU times of one drive without its last tick, which ends the goal."""
    params = DEFAULTS._replace(navigator=navigator)
    state = brain.State(params)
    state.odometry.pose = start
    brain.step(state, inputs[0], params)
    modes.arm(state.machine)
    modes.goto(state.machine, goal, states.AUTO, inputs[0].now_ms)
    costs: list[float] = []
    for one in inputs[1:-1]:
        begun_ns = thread_time_ns()
        brain.step(state, one, params)
        costs.append((thread_time_ns() - begun_ns) / 1e3)
    return costs


def idle_us() -> list[float]:
    """Return the CPU times of reading the clock."""
    costs: list[float] = []
    for _ in range(1000):
        begun_ns = thread_time_ns()
        costs.append((thread_time_ns() - begun_ns) / 1e3)
    return costs
