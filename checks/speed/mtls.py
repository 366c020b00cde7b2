"""Cost of mutual TLS and access control in the closed loop, compared with an open bus.

Three robot processes run 20 times a second and a third of a period apart, so that all meet the same
load. Each has a substitute for plant and operator. One is open, one is locked with mutual TLS and
access control on every sample, and one also logs rejected clients, as is the default. Their order
rotates with each block.
"""

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from checks.harness.figures import Figure, Report, percentile, ratios
from checks.harness.processes import ROBOT, cpu_s, robot_process
from checks.harness.stand_in import PlantStandIn, driving, paced, wait_until
from plant.world.file import load
from runtime.units import NS_PER_S, PERIOD_NS

MAX_RATIO: Final = 1.10
WARM_UP: Final = 60
SHARE_OF_TURN: Final = 0.9  # of the time until the next robot's turn
KINDS: Final = ("open", "locked", "logging")
VALID: Final = timedelta(days=1)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--blocks", type=int, default=24)
    parser.add_argument("--ticks", type=int, default=200, help="in each block")


def measure(options: argparse.Namespace) -> Report:
    """Measure the three robots in turn."""
    world = load(options.world)
    with (
        TemporaryDirectory(prefix="sidestep-") as folder,
        robot_process(world) as plain,
        robot_process(
            world, keys=made_keys(Path(folder) / "silent", logs_refusals=False)
        ) as locked,
        robot_process(
            world, keys=made_keys(Path(folder) / "logging", logs_refusals=True)
        ) as logging,
        driving(world, plain, lockstep=False) as open_plant,
        driving(world, locked, lockstep=False) as locked_plant,
        driving(world, logging, lockstep=False) as logging_plant,
    ):
        pids = (plain.pid, locked.pid, logging.pid)
        robots = (open_plant, locked_plant, logging_plant)
        in_turn(robots, WARM_UP, first=0)
        before = [cpu_s(pid) for pid in pids]
        blocks = [in_turn(robots, options.ticks, first=block) for block in range(options.blocks)]
        spent = [cpu_s(pid) - was for pid, was in zip(pids, before, strict=True)]
    ticks = options.blocks * options.ticks
    lost = [
        sum(options.ticks - len(block[robot]) for block in blocks) for robot in range(len(KINDS))
    ]
    figures = [*figures_of(blocks, "p50", 0.5, MAX_RATIO), *figures_of(blocks, "p99", 0.99)]
    figures += [
        Figure(name=f"CPU of the robot per tick, {name}", unit="us", values=(cpu / ticks * 1e6,))
        for name, cpu in zip(KINDS, spent, strict=True)
    ]
    missing = ", ".join(f"{count} {name}" for name, count in zip(KINDS, lost, strict=True))
    notes = (
        f"{options.blocks} blocks of {options.ticks} ticks at 20 Hz, in turn",
        f"commands not in time: {missing}",
    )
    return Report(benchmark="mtls", figures=tuple(figures), notes=notes)


def made_keys(folder: Path, *, logs_refusals: bool) -> Path:
    """Make certificates for this run."""
    from ground.certificates.folder import make  # its library is optional for other benchmarks

    now = datetime.now(UTC)
    make(folder, [ROBOT], {}, now - VALID, now + VALID)
    if not logs_refusals:
        with (folder / f"robot-{ROBOT}.toml").open("a", encoding="utf-8") as config:
            config.write("tell_refusals = false\n")
    return folder


def in_turn(robots: Sequence[PlantStandIn], ticks: int, *, first: int) -> list[list[float]]:
    """Return the times in us from samples to command of each robot."""
    took: list[list[float]] = [[] for _ in robots]
    share_ns = PERIOD_NS // len(robots)
    for due_ns in paced(ticks):
        for place in range(len(robots)):
            wait_until(due_ns + place * share_ns)
            robot = (first + place) % len(robots)
            ns = robots[robot].tick(patience_s=share_ns * SHARE_OF_TURN / NS_PER_S)
            if ns is not None:
                took[robot].append(ns / 1e3)
    return took


def figures_of(
    blocks: Sequence[Sequence[list[float]]], name: str, share: float, at_most: float | None = None
) -> list[Figure]:
    """Return the ratios, of which that of mutual TLS has a threshold, and their terms."""
    values = [[percentile(block[robot], share) for block in blocks] for robot in range(len(KINDS))]
    plain, locked, logging = values
    locked_ratio = f"locked / open, {name}"
    logging_ratio = f"locked with log of refusals / open, {name}"
    return [
        Figure(name=locked_ratio, unit="x", values=ratios(locked, plain), at_most=at_most),
        Figure(name=logging_ratio, unit="x", values=ratios(logging, plain)),
        *(
            Figure(name=f"sense to command, {kind}, {name}", unit="us", values=tuple(found))
            for kind, found in zip(KINDS, values, strict=True)
        ),
    ]
