"""Speed of a trial, plant and core in one process, compared with ir-sim without controller.

ir-sim gets the same world, robot, forty rays to 3 m and 50 ms step, and drives in a small circle at
the robot's start. The two take turns.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from time import process_time

from checks.harness.figures import Figure, Report, ratios
from checks.speed import irsim as irsim_peer
from plant.world.file import load
from protocol.world import World
from study.trial.trial import Trial, run_trial

AT_LEAST = 400.0
AT_MOST_US = 125.0
PERIOD_S = 0.05
PEER_STEPS = 150
WORLDS = ("forest_medium", "forest_dense")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS))
    parser.add_argument("--repetitions", type=int, default=7)
    parser.add_argument("--no-peer", action="store_true", help="measure without ir-sim")
    parser.add_argument(
        "--venv",
        type=Path,
        default=Path(".bench-venv"),
        help="virtual environment of ir-sim",
    )


def measure(options: argparse.Namespace) -> Report:
    """Measure trials and ir-sim in each world."""
    figures: list[Figure] = []
    notes: list[str] = []
    for name in options.worlds:
        world = load(name)
        if options.no_peer:
            pairs = [(*run(world), 0.0) for _ in range(options.repetitions)]
        else:
            with irsim_peer.running(world, options.venv) as peer:
                pairs = list(in_turn(world, peer, options.repetitions))
                notes.append(f"{name}: {len(world.obstacles)} obstacles; ir-sim {peer.version}")
        figures += figures_of(name, pairs)
    return Report(benchmark="trial", figures=tuple(figures), notes=tuple(notes))


def in_turn(
    world: World, peer: irsim_peer.IrSim, repetitions: int
) -> Iterator[tuple[float, float, float]]:
    """Yield pace and cost of a trial and the pace of ir-sim, in turn."""
    for _ in range(repetitions):
        _, peer_wall_s = peer.run(PEER_STEPS)
        yield *run(world), PEER_STEPS * PERIOD_S / peer_wall_s


def run(world: World) -> tuple[float, float]:
    """Return pace (x real time, drive loop) and CPU time in us per tick, set-up included."""
    begun_s = process_time()
    outcome = run_trial(Trial(world=world))
    spent_s = process_time() - begun_s
    return outcome.time_s / outcome.wall_s, spent_s * 1e6 / outcome.ticks


def figures_of(name: str, pairs: list[tuple[float, float, float]]) -> Iterator[Figure]:
    """Yield the figures of one world."""
    ours, costs, peers = (list(column) for column in zip(*pairs, strict=True))
    yield Figure(name=f"{name}, real time", unit="x", values=tuple(ours), at_least=AT_LEAST)
    yield Figure(
        name=f"{name}, CPU with set-up", unit="us/tick", values=tuple(costs), at_most=AT_MOST_US
    )
    if all(peers):
        yield Figure(name=f"{name}, ir-sim real time", unit="x", values=tuple(peers))
        yield Figure(name=f"{name}, ours / ir-sim", unit="x", values=ratios(ours, peers))
