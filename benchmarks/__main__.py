"""`python -m benchmarks NAME`: a table from name to the module that measures it."""

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol, cast

from runtime.cli.verb_table import VERBS
from verification.harness import machine
from verification.harness.figures import Report


class Entry(NamedTuple):
    """`module` measures it, `title` says what."""

    module: str
    title: str


BENCHMARKS = {
    "trial": Entry(
        "benchmarks.trial",
        "a run in one process, x real time, and ir-sim beside it",
    ),
    "core": Entry(
        "benchmarks.core",
        "CPU time of one step of the control core",
    ),
    "budget": Entry(
        "benchmarks.mcu_cost.budget",
        "one step on the LPC1768, modelled: operations counted, times cycles; its state",
    ),
    "codec": Entry(
        "benchmarks.codec",
        "encode and decode, pymavlink beside it",
    ),
    "lockstep": Entry(
        "benchmarks.lockstep",
        "plant, robot and ground over Zenoh as fast as they can, x real time",
    ),
    "latency": Entry(
        "benchmarks.latency",
        "sense published to wheel command received, a bare ping-pong beside it",
    ),
    "mtls": Entry(
        "benchmarks.mtls",
        "what mutual TLS and access control cost the closed loop, without them beside it",
    ),
    "robot": Entry(
        "benchmarks.robot",
        "the robot process at 20 Hz: CPU, memory, growth, import time",
    ),
    "jitter": Entry(
        "benchmarks.jitter",
        "wall-clock driving: missed ticks and lateness, with and without SCHED_FIFO",
    ),
    "nees": Entry(
        "benchmarks.nees",
        "whether the odometry's covariance fits its errors, per noise level",
    ),
    "arrival": Entry(
        "benchmarks.arrival",
        "pose and last turn at the goal in the open, go-then-align beside it",
    ),
    "map": Entry(
        "benchmarks.map_drawing.main",
        "a frame of the map on 100 x 40 cells, textual-plotext beside it",
    ),
    "soak": Entry(
        "verification.soak.main",
        "long run of a fleet with faults: memory growth, latency drift, lost messages",
    ),
    "ground": Entry(
        "benchmarks.ground_station.main",
        "the app on a terminal: CPU, bytes, first paint, key to robot, a flood of log lines",
    ),
    "restarts": Entry(
        "verification.restarts",
        "time from killing a process of `up` until robot and plant publish again",
    ),
    "faults": Entry(
        "verification.faults_matrix.main",
        "what the robot does when something breaks, the fault matrix (docs/evidence/faults.md)",
    ),
    "fuzz": Entry(
        "verification.fuzz.main",
        "broken inputs for every decoder: none may crash, hang or take much memory",
    ),
    "flood": Entry(
        "verification.flood.main",
        "a robot under attack of ten kinds: key to standing wheels, missed ticks, memory",
    ),
    "simulate": Entry(
        "verification.simulate",
        "the whole stack on simulated time, network and disk: faults by seed, invariants",
    ),
    "digest": Entry(
        "benchmarks.digest",
        "the same trajectory in every way of running, another one for another seed",
    ),
}


class Benchmark(Protocol):
    """What each module offers."""

    def add_options(self, parser: argparse.ArgumentParser) -> None: ...

    def measure(self, options: argparse.Namespace) -> Report: ...


def main(argv: Sequence[str] | None = None) -> int:
    """Measure; 0 when every threshold was met, 1 when one was missed, 2 wrong usage."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(
        prog="sidestep bench", description=VERBS["bench"].summary, epilog=table()
    )
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
            return cast(Benchmark, importlib.import_module(BENCHMARKS[word].module))
    return None


def table() -> str:
    return "\n".join(f"  {name:<10} {entry.title}" for name, entry in BENCHMARKS.items())


if __name__ == "__main__":
    sys.exit(main())
