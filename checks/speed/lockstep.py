"""Time per tick of plant, robot and ground as three processes in lockstep over Zenoh.

Wall time counts from the start of simulated time to the message that the goal has ended. The lower
bound is the tick of a trial in one process, plus one round trip of a bare Zenoh ping-pong: the same
computation, and the same two messages. The three are measured in turn.
"""

import argparse
from statistics import median
from typing import NamedTuple

from checks.harness.figures import Figure, Report
from checks.harness.lockstep_stack import lockstep_run
from checks.speed.latency import sizes, trip_us
from checks.speed.pingpong import PingPong, ping_pong
from plant.world.file import load
from study.trial.trial import Trial, run_trial

AT_LEAST = 100.0
AT_MOST = 1.5
ROUND_TRIPS = 1000


class Costs(NamedTuple):
    """Wall times in us: a tick of the three processes, a tick of a trial, a bare round trip."""

    lockstep_us: float
    trial_us: float
    round_trip_us: float

    @property
    def ratio(self) -> float:
        """The tick of the three processes over its lower bound."""
        return self.lockstep_us / (self.trial_us + self.round_trip_us)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=["forest_medium", "forest_dense"])
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--router", action="store_true", help="use a router instead of the hub")


def measure(options: argparse.Namespace) -> Report:
    """Measure the time per tick in each world."""
    figures: list[Figure] = []
    with ping_pong(*sizes()) as pings:
        for name in options.worlds:
            trial = Trial(world=load(name))
            runs = [
                run_once(name, trial, pings, router=options.router)
                for _ in range(options.repetitions)
            ]
            figures += figures_of(name, runs, router=options.router)
    way = "by a router, two hops" if options.router else "the robot is the hub, one hop"
    return Report(benchmark="lockstep", figures=tuple(figures), notes=(way,))


def run_once(name: str, trial: Trial, pings: PingPong, *, router: bool) -> Costs:
    """Measure the three processes, the trial and the ping-pong, in turn."""
    run = lockstep_run(name, trial, router=router)
    alone = run_trial(trial)
    round_trip_us = median(trip_us(pings) for _ in range(ROUND_TRIPS))
    return Costs(
        run.wall_s * 1e6 / run.score.ticks, alone.wall_s * 1e6 / alone.ticks, round_trip_us
    )


def figures_of(name: str, runs: list[Costs], *, router: bool) -> list[Figure]:
    """Return the figures of one world. Only the three processes without a router have limits."""
    paces = tuple(50_000.0 / run.lockstep_us for run in runs)
    return [
        Figure(
            name=f"{name}, real time",
            unit="x",
            values=paces,
            at_least=None if router else AT_LEAST,
        ),
        Figure(
            name=f"{name}, tick / (trial's tick + round trip)",
            unit="x",
            values=tuple(run.ratio for run in runs),
            at_most=None if router else AT_MOST,
        ),
        Figure(name=f"{name}, wall", unit="us/tick", values=tuple(run.lockstep_us for run in runs)),
        Figure(
            name=f"{name}, wall of a trial",
            unit="us/tick",
            values=tuple(run.trial_us for run in runs),
        ),
        Figure(
            name=f"{name}, bare round trip, p50",
            unit="us",
            values=tuple(run.round_trip_us for run in runs),
        ),
    ]
