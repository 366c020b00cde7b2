"""What locked doors cost the closed loop: a locked robot and an open one in the same run.

Two robot processes, each with a stand-in for plant and operator, twenty times a second and half a
period apart, so both meet the same machine. The locked one has mutual TLS, access control on every
sample, and the watch on whom it keeps out. Which of the two comes first changes with each block.
"""

import argparse
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from benchmarks.figures import Figure, Report, percentile, ratios
from benchmarks.pace import PERIOD_NS, paced, wait_until
from benchmarks.robot import cpu_s
from benchmarks.standin import ROBOT, Standin, driving, robot_process
from plant.world_file import load

AT_MOST: Final = 1.10
WARM_UP: Final = 60
VALID: Final = timedelta(days=1)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--blocks", type=int, default=10)
    parser.add_argument("--ticks", type=int, default=200, help="in each block")


def measure(options: argparse.Namespace) -> Report:
    world = load(options.world)
    with (
        TemporaryDirectory(prefix="sidestep-") as folder,
        robot_process(world) as plain,
        robot_process(world, keys=made_keys(Path(folder))) as locked,
        driving(world, plain, lockstep=False) as open_door,
        driving(world, locked, lockstep=False) as locked_door,
    ):
        doors = (open_door, locked_door)
        in_turn(doors, WARM_UP, swapped=False)
        spent_before = [cpu_s(plain.pid), cpu_s(locked.pid)]
        blocks = [
            in_turn(doors, options.ticks, swapped=bool(block % 2))
            for block in range(options.blocks)
        ]
        spent = [
            cpu_s(robot.pid) - before
            for robot, before in zip((plain, locked), spent_before, strict=True)
        ]
    ticks = options.blocks * options.ticks
    lost = [sum(options.ticks - len(block[door]) for block in blocks) for door in (0, 1)]
    figures = [*compared(blocks, "p50", 0.5, AT_MOST), *compared(blocks, "p99", 0.99)]
    figures += [
        Figure(
            name=f"CPU of the robot for each tick, {name}", unit="us", values=(cpu / ticks * 1e6,)
        )
        for name, cpu in zip(("open", "locked"), spent, strict=True)
    ]
    notes = (
        f"{options.blocks} blocks of {options.ticks} ticks at 20 Hz, in turn",
        f"commands not in time: {lost[0]} open, {lost[1]} locked",
    )
    return Report(benchmark="mtls", figures=tuple(figures), notes=notes)


def made_keys(folder: Path) -> Path:
    """A set of this run's own."""
    from ground.keys.folder import make  # its library need not be there for other measurements

    now = datetime.now(UTC)
    make(folder / "keys", [ROBOT], [], now - VALID, now + VALID)
    return folder / "keys"


def in_turn(
    doors: tuple[Standin, Standin], ticks: int, *, swapped: bool
) -> tuple[list[float], list[float]]:
    """Microseconds from senses to command, open and locked."""
    took: tuple[list[float], list[float]] = ([], [])
    order = (1, 0) if swapped else (0, 1)
    for due_ns in paced(ticks):
        for place, door in enumerate(order):
            wait_until(due_ns + place * PERIOD_NS // 2)
            ns = doors[door].tick(patience_s=PERIOD_NS / 2.5e9)
            if ns is not None:
                took[door].append(ns / 1e3)
    return took


def compared(
    blocks: list[tuple[list[float], list[float]]],
    name: str,
    share: float,
    at_most: float | None = None,
) -> list[Figure]:
    plain = [percentile(block[0], share) for block in blocks]
    locked = [percentile(block[1], share) for block in blocks]
    return [
        Figure(
            name=f"locked / open, {name}", unit="x", values=ratios(locked, plain), at_most=at_most
        ),
        Figure(name=f"sense to command, open, {name}", unit="us", values=tuple(plain)),
        Figure(name=f"sense to command, locked, {name}", unit="us", values=tuple(locked)),
    ]
