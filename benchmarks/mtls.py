"""What locked doors cost the closed loop: locked robots and an open one in the same run.

Three robot processes, each with a stand-in for plant and operator, twenty times a second and a
third of a period apart, so all meet the same machine: an open one, a locked one with mutual TLS and
access control on every sample, and one that also tells in its log whom it keeps out, as is usual.
Which comes first changes with each block.
"""

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from plant.world.file import load
from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S
from verification.harness.figures import Figure, Report, percentile, ratios
from verification.harness.pace import paced, wait_until
from verification.harness.process_stats import cpu_s
from verification.harness.processes import ROBOT, robot_process
from verification.harness.stand_in import PlantStandIn, driving

AT_MOST: Final = 1.10
WARM_UP: Final = 60
PATIENCE: Final = 0.9  # of the time until it is the next door's turn
KINDS: Final = ("open", "locked", "telling")
VALID: Final = timedelta(days=1)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--blocks", type=int, default=24)
    parser.add_argument("--ticks", type=int, default=200, help="in each block")


def measure(options: argparse.Namespace) -> Report:
    world = load(options.world)
    with (
        TemporaryDirectory(prefix="sidestep-") as folder,
        robot_process(world) as plain,
        robot_process(world, keys=made_keys(Path(folder) / "silent", tells=False)) as locked,
        robot_process(world, keys=made_keys(Path(folder) / "telling", tells=True)) as telling,
        driving(world, plain, lockstep=False) as open_door,
        driving(world, locked, lockstep=False) as locked_door,
        driving(world, telling, lockstep=False) as telling_door,
    ):
        pids = (plain.pid, locked.pid, telling.pid)
        doors = (open_door, locked_door, telling_door)
        in_turn(doors, WARM_UP, first=0)
        before = [cpu_s(pid) for pid in pids]
        blocks = [in_turn(doors, options.ticks, first=block) for block in range(options.blocks)]
        spent = [cpu_s(pid) - was for pid, was in zip(pids, before, strict=True)]
    ticks = options.blocks * options.ticks
    lost = [sum(options.ticks - len(block[door]) for block in blocks) for door in range(len(KINDS))]
    figures = [*compared(blocks, "p50", 0.5, AT_MOST), *compared(blocks, "p99", 0.99)]
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


def made_keys(folder: Path, *, tells: bool) -> Path:
    """A set of this run's own."""
    from ground.certificates.folder import (
        make,  # its library need not be there for other measurements
    )

    now = datetime.now(UTC)
    make(folder, [ROBOT], {}, now - VALID, now + VALID)
    if not tells:
        with (folder / f"robot-{ROBOT}.toml").open("a", encoding="utf-8") as config:
            config.write("tell_refusals = false\n")
    return folder


def in_turn(doors: Sequence[PlantStandIn], ticks: int, *, first: int) -> list[list[float]]:
    """Microseconds from senses to command at each door."""
    took: list[list[float]] = [[] for _ in doors]
    share_ns = PERIOD_NS // len(doors)
    for due_ns in paced(ticks):
        for place in range(len(doors)):
            wait_until(due_ns + place * share_ns)
            door = (first + place) % len(doors)
            ns = doors[door].tick(patience_s=share_ns * PATIENCE / NS_PER_S)
            if ns is not None:
                took[door].append(ns / 1e3)
    return took


def compared(
    blocks: Sequence[Sequence[list[float]]], name: str, share: float, at_most: float | None = None
) -> list[Figure]:
    """The ratios, of which that of mutual TLS is judged, and what they are made of."""
    values = [[percentile(block[door], share) for block in blocks] for door in range(len(KINDS))]
    plain, locked, telling = values
    ratio = f"locked / open, {name}"
    tells = f"locked and told of refusals / open, {name}"
    return [
        Figure(name=ratio, unit="x", values=ratios(locked, plain), at_most=at_most),
        Figure(name=tells, unit="x", values=ratios(telling, plain)),
        *(
            Figure(name=f"sense to command, {kind}, {name}", unit="us", values=tuple(found))
            for kind, found in zip(KINDS, values, strict=True)
        ),
    ]
