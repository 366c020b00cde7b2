"""`python -m checks NAME`: run a benchmark."""

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol, cast

from checks.harness import figures
from checks.harness.figures import BenchmarkReport
from runtime.cli.parsers import new_parser


class BenchmarkEntry(NamedTuple):
    """The module of a benchmark and what it measures; `part` names one of several in a module."""

    module: str
    title: str
    part: str = ""


BENCHMARKS = {
    "trial": BenchmarkEntry(
        "checks.speed.trials",
        "a trial in one process, x real time, compared with ir-sim",
        "TRIAL",
    ),
    "compiled": BenchmarkEntry(
        "checks.speed.trials",
        "a trial with compiled modules, in pure Python, and of ir-sim, stage by stage",
        "COMPILED",
    ),
    "core": BenchmarkEntry(
        "checks.speed.trials",
        "CPU time of one step of the control core",
        "STEP",
    ),
    "against": BenchmarkEntry(
        "checks.speed.against",
        "trials, steps of the core and the robot process, compared with an older commit",
    ),
    "codec": BenchmarkEntry(
        "checks.speed.codec",
        "encode and decode, compared with pymavlink",
    ),
    "lockstep": BenchmarkEntry(
        "checks.speed.lockstep",
        "plant, robot and ground over Zenoh at full speed, compared with a trial and a ping-pong",
        "LOCKSTEP",
    ),
    "breakdown": BenchmarkEntry(
        "checks.speed.lockstep",
        "where the time of a tick in lockstep goes: stages, CPU time of threads, switches, frames",
        "BREAKDOWN",
    ),
    "latency": BenchmarkEntry(
        "checks.speed.latency",
        "sensor sample published to wheel command received, compared with a ping-pong",
    ),
    "mtls": BenchmarkEntry(
        "checks.speed.robot_process",
        "closed loop with mutual TLS and access control, compared with an open bus",
        "MTLS",
    ),
    "robot": BenchmarkEntry(
        "checks.speed.robot_process",
        "the robot process at 20 Hz: CPU, memory, growth, import time",
        "ROBOT_PROCESS",
    ),
    "jitter": BenchmarkEntry(
        "checks.speed.robot_process",
        "wall-clock driving: missed ticks and lateness, with and without SCHED_FIFO",
        "JITTER",
    ),
    "nees": BenchmarkEntry(
        "checks.speed.accuracy",
        "consistency of the odometry's covariance with its errors, per noise level",
        "NEES",
    ),
    "arrival": BenchmarkEntry(
        "checks.speed.accuracy",
        "pose and last turn at the goal in the open, compared with go-then-align",
        "ARRIVAL",
    ),
    "map": BenchmarkEntry(
        "checks.speed.map_drawing",
        "a frame of the map on 100 x 40 cells, compared with textual-plotext",
    ),
    "soak": BenchmarkEntry(
        "checks.endurance.soak",
        "long run of a fleet with faults: memory growth, latency drift, lost messages",
    ),
    "ground": BenchmarkEntry(
        "checks.speed.app_figures",
        "the app on a terminal: CPU, bytes, first paint, key to robot, a flood of log lines",
    ),
    "fleet": BenchmarkEntry(
        "checks.speed.fleet_cost",
        "1 to 100 robots: speed in lockstep, missed ticks in wall time, a model of their cost",
    ),
    "stop_all": BenchmarkEntry(
        "checks.speed.fleet",
        "stop of all robots: key in the terminal to the last wheel standing",
    ),
    "gateway": BenchmarkEntry(
        "checks.speed.gateway.gateway_figures",
        "the MAVLink gateway: latency, cost, slow line, forgery, time-outs, readiness, floods",
    ),
    "restarts": BenchmarkEntry(
        "checks.faults.restarts",
        "time from killing a process of `up` until robot and plant publish again",
    ),
    "faults": BenchmarkEntry(
        "checks.faults.fault_matrix",
        "reaction of the robot to faults: the fault matrix (docs/evidence/faults.md)",
    ),
    "fuzz": BenchmarkEntry(
        "checks.fuzz.hunt",
        "invalid inputs for every decoder: none may crash, hang or use much memory",
    ),
    "flood": BenchmarkEntry(
        "checks.flood.under_attack",
        "a robot under each kind of attack: key to wheels at zero, missed ticks, memory",
    ),
    "stop_ways": BenchmarkEntry(
        "checks.flood.stop_ways",
        "stops under all attacks at once and without a link: app and fresh estop to wheels at zero",
    ),
    "simulate": BenchmarkEntry(
        "checks.simulation.campaign",
        "the whole stack on simulated time, network and disk: faults by seed, invariants",
    ),
    "contradictions": BenchmarkEntry(
        "checks.simulation.contradictions.observe",
        "the words of two persons' programs, compared with what was: outcomes, leases, texts",
    ),
    "digest": BenchmarkEntry(
        "checks.speed.lockstep",
        "equal trajectories in every mode of running, another one for another seed",
        "DIGEST",
    ),
}


class Benchmark(Protocol):
    """The interface of a benchmark module."""

    def add_options(self, parser: argparse.ArgumentParser, /) -> None:
        """Add the options of this benchmark."""

    def measure(self, options: argparse.Namespace, /) -> BenchmarkReport:
        """Run the benchmark and return its figures."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a benchmark.

    Return 0 when every threshold is met, 1 when one is missed, 2 for wrong usage.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    benchmark = benchmark_of(arguments)
    options = parser(benchmark).parse_args(arguments)
    if benchmark is None:  # for mypy: argparse has refused the name
        return 2
    load_before = figures.machine_load()
    report = benchmark.measure(options)
    report = replace(report, machine=figures.describe_machine(load_before))
    print(json.dumps(report.as_json()) if options.json else report.text())
    return 0 if report.met else 1


def parser(benchmark: Benchmark | None = None) -> argparse.ArgumentParser:
    """Return the parser of the verb, with the options of a benchmark."""
    made = new_parser("bench", details=table(), allow_abbrev=True)
    made.add_argument("name", choices=BENCHMARKS, metavar="NAME")
    made.add_argument("--json", action="store_true", help="print one JSON object")
    if benchmark:
        benchmark.add_options(made)
    return made


def benchmark_of(arguments: Sequence[str]) -> Benchmark | None:
    """Return the module of the first benchmark name among the arguments, or None."""
    for word in arguments:
        if word in BENCHMARKS:
            entry = BENCHMARKS[word]
            module = importlib.import_module(entry.module)
            return cast(Benchmark, getattr(module, entry.part) if entry.part else module)
    return None


def table() -> str:
    """Return the list of benchmarks for the help."""
    return "\n".join(f"  {name:<10} {entry.title}" for name, entry in BENCHMARKS.items())


if __name__ == "__main__":
    sys.exit(main())
