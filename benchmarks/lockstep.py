"""Speed of plant, robot and ground as three processes in lockstep over Zenoh.

Real time counts from the start of simulated time to the message that the goal has ended.
"""

import argparse

from plant.world.file import load
from study.trial.trial import Trial
from verification.harness.figures import Figure, Report
from verification.harness.stack import lockstep_run

AT_LEAST = 100.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=["forest_medium", "forest_dense"])
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--router", action="store_true", help="use a router instead of the hub")


def measure(options: argparse.Namespace) -> Report:
    """Measure the pace in each world."""
    figures: list[Figure] = []
    at_least = None if options.router else AT_LEAST  # three processes; with a router they are four
    for name in options.worlds:
        trial = Trial(world=load(name))
        runs = [
            lockstep_run(name, trial, router=options.router) for _ in range(options.repetitions)
        ]
        paces = tuple(run.pace for run in runs)
        costs = tuple(run.wall_s * 1e6 / run.score.ticks for run in runs)
        figures += [
            Figure(name=f"{name}, real time", unit="x", values=paces, at_least=at_least),
            Figure(name=f"{name}, wall", unit="us/tick", values=costs),
        ]
    way = "by a router, two hops" if options.router else "the robot is the hub, one hop"
    return Report(benchmark="lockstep", figures=tuple(figures), notes=(way,))
