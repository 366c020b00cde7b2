"""`python -m benchmarks NAME`: a table from name to the module that measures it."""

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, cast

from benchmarks import machine
from benchmarks.figures import Report

BENCHMARKS = {
    "trial": "a run in one process, x real time, and ir-sim beside it",
    "core": "CPU time of one step of the control core",
    "budget": "one step on the LPC1768, modelled: operations counted, times cycles; its state",
    "codec": "encode and decode, pymavlink beside it",
    "lockstep": "plant, robot and ground over Zenoh as fast as they can, x real time",
    "latency": "sense published to wheel command received, a bare ping-pong beside it",
    "mtls": "what mutual TLS and access control cost the closed loop, without them beside it",
    "robot": "the robot process at 20 Hz: CPU, memory, growth, import time",
    "jitter": "wall-clock driving: missed ticks and lateness, with and without SCHED_FIFO",
    "nees": "whether the odometry's covariance fits its errors, per noise level",
    "arrival": "pose and last turn at the goal in the open, go-then-align beside it",
    "map": "a frame of the map on 100 x 40 cells, textual-plotext beside it",
    "soak": "a fleet with faults for a long time: what grows, what slows, what is lost",
    "ground": "the app on a terminal: CPU, bytes, first paint, key to robot, a flood of log lines",
    "restarts": "a process of `up` killed, until robot and plant are heard again",
    "faults": "what the robot does when something breaks, the fault matrix (docs/faults.md)",
    "fuzz": "broken inputs for every decoder: none may crash, hang or take much memory",
    "flood": "a robot under attack of ten kinds: key to standing wheels, missed ticks, memory",
    "simulate": "the whole stack on simulated time, network and disk: faults by seed, invariants",
    "digest": "the same trajectory in every way of running, another one for another seed",
}


class Benchmark(Protocol):
    """What each module offers."""

    def add_options(self, parser: argparse.ArgumentParser) -> None: ...

    def measure(self, options: argparse.Namespace) -> Report: ...


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; 0 when every threshold was met, 1 when one was missed, 2 wrong usage."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(prog="sidestep bench", description=__doc__, epilog=table())
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("name", choices=BENCHMARKS, metavar="NAME")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    benchmark = named(arguments)
    if benchmark:
        benchmark.add_options(parser)
    options = parser.parse_args(arguments)
    if benchmark is None:  # argparse has refused the name; this line only says so to mypy
        return 2
    load_before = machine.load()
    report = benchmark.measure(options)
    report = replace(report, machine=machine.described(load_before))
    print(json.dumps(report.as_json()) if options.json else report.text())
    return 0 if report.met else 1


def named(arguments: Sequence[str]) -> Benchmark | None:
    """The module of the first word that is a name: each has options of its own."""
    for word in arguments:
        if word in BENCHMARKS:
            return cast(Benchmark, importlib.import_module(f"benchmarks.{word}"))
    return None


def table() -> str:
    return "\n".join(f"  {name:<10} {says}" for name, says in BENCHMARKS.items())


if __name__ == "__main__":
    sys.exit(main())
