"""The robot process at 20 Hz: its cost, its lateness, and the cost of access control.

CPU and memory are the kernel's figures of the process, with a subscribed ground. Growth is measured
in lockstep, where ten simulated hours take minutes: `--hours 10`.

The robot reports missed ticks and lateness at wall-clock speed. Lateness counts from the arrival of
the scan that starts the tick. The lateness of the substitute plant that publishes the scans is
reported too, since it is caused by the machine.

For access control three robot processes run 20 times a second and a third of a period apart, so
that all meet the same load. Each has a substitute for plant and operator. One is open, one is
locked with mutual TLS and access control on every sample, and one also logs rejected clients, as is
the default. Their order rotates with each block.
"""

import argparse
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, monotonic_ns
from typing import Final

from checks.harness.figures import (
    BenchmarkFunctions,
    BenchmarkReport,
    Figure,
    figure,
    percentile,
    ratios,
)
from checks.harness.processes import ROBOT, cpu_s, made_keys, resident_mb, robot_process
from checks.speed.latency import PlantStandIn, driving, paced, wait_until
from plant.world.file import load
from protocol.bus.bus import open_bus
from protocol.topics import CYCLE
from protocol.wire.codec import decode
from protocol.wire.messages import CycleReport
from protocol.world import World
from runtime.units import CONTROL_HZ, NS_PER_S, PERIOD_NS

CPU_AT_MOST, RSS_AT_MOST, IMPORT_AT_MOST, GROWTH_AT_MOST = 5.0, 60.0, 0.3, 1.0
IMPORTING = "import time; t = time.perf_counter(); import robot.run; print(time.perf_counter() - t)"
TICKS_PER_HOUR = round(3600 * CONTROL_HZ)
SAMPLES = 40
LOCKSTEP_PATIENCE_S = 5.0


def add_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--seconds", type=float, default=15.0, help="per repetition, at 20 Hz")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--hours", type=float, default=1.0, help="simulated, for growth; 0: none")


def measure_robot(options: argparse.Namespace) -> BenchmarkReport:
    """Measure import time, CPU, memory and growth."""
    world = load(options.world)
    figures = [
        figure(
            "imports, fresh process", [import_s() for _ in range(7)], "s", at_most=IMPORT_AT_MOST
        ),
        *in_wall_time(world, options.seconds, options.repetitions),
    ]
    notes = ["a ground subscribes to all topics of the robot"]
    if options.hours > 0:
        growth, note = over_hours(world, options.hours)
        figures.append(growth)
        notes.append(note)
    return BenchmarkReport(benchmark="robot", figures=tuple(figures), notes=tuple(notes))


def import_s() -> float:
    """Return the time to import the robot in a new process."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORTING], capture_output=True, check=True, text=True
    )
    return float(done.stdout)


def in_wall_time(world: World, seconds: float, repetitions: int) -> list[Figure]:
    """Measure CPU and memory at wall-clock speed."""
    shares: list[float] = []
    sizes: list[float] = []
    with (
        robot_process(world) as robot,
        open_bus(robot.network, None, "ground") as ground,
        driving(world, robot, lockstep=False) as standin,
    ):
        ground.stream_all(lambda _key, _frame, _ns: None)
        for _ in range(repetitions):
            shares.append(busy_percent(standin, robot.pid, seconds))
            sizes.append(resident_mb(robot.pid))
    return [
        figure("CPU of one core at 20 Hz", shares, "%", at_most=CPU_AT_MOST),
        figure("resident", sizes, "MB", at_most=RSS_AT_MOST),
    ]


def busy_percent(standin: PlantStandIn, pid: int, seconds: float) -> float:
    """Return the CPU share of a process while it drives."""
    begun_s, begun_cpu_s = monotonic(), cpu_s(pid)
    for _ in paced(round(seconds * CONTROL_HZ)):
        standin.tick()
    return 100.0 * (cpu_s(pid) - begun_cpu_s) / (monotonic() - begun_s)


def over_hours(world: World, hours: float) -> tuple[Figure, str]:
    """Return the growth of resident memory after the first tenth, which fills all buffers."""
    with (
        robot_process(world, "--lockstep") as robot,
        driving(world, robot, lockstep=True) as standin,
    ):
        sizes = []
        begun_s = monotonic()
        for _ in range(SAMPLES):
            for _ in range(round(hours * TICKS_PER_HOUR / SAMPLES)):
                if standin.tick(LOCKSTEP_PATIENCE_S) is None:
                    raise RuntimeError("the robot did not answer in lockstep")
            sizes.append(resident_mb(robot.pid))
        pace = hours * 3600 / (monotonic() - begun_s)
    growth = figure(
        f"growth over {hours:g} simulated h",
        sizes[-1] - sizes[SAMPLES // 10],
        "MB",
        at_most=GROWTH_AT_MOST,
    )
    shown = ", ".join(f"{size:.1f}" for size in sizes[:: SAMPLES // 10])
    return growth, f"resident at each tenth, MB: {shown}; {pace:.0f} x real time"


SHARES = {"p50": 0.5, "p99": 0.99, "max": 1.0}


def add_jitter_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repetitions", type=int, default=1)


def measure_jitter(options: argparse.Namespace) -> BenchmarkReport:
    """Measure with normal scheduling and with SCHED_FIFO."""
    figures: list[Figure] = []
    notes: list[str] = []
    for name, flags in (("normal", []), ("SCHED_FIFO", ["--realtime"])):
        runs = [TimedDrive(load(options.world), flags) for _ in range(options.repetitions)]
        for run in runs:
            run.go(options.seconds)
        figures += jitter_figures(name, runs)
        notes += {f"{name}: {line}" for run in runs for line in run.output if "warning" in line}
    return BenchmarkReport(benchmark="jitter", figures=tuple(figures), notes=tuple(notes))


class TimedDrive:
    """A robot process that drives for some time, and its cycle reports."""

    def __init__(self, world: World, flags: list[str]) -> None:
        self._world = world
        self._flags = flags
        self.output: list[str] = []
        self.published_late_us: list[float] = []
        self.reports: list[CycleReport] = []

    def go(self, seconds: float) -> None:
        """Drive for this many seconds."""
        frames: list[bytes] = []
        with (
            robot_process(self._world, *self._flags) as robot,
            driving(self._world, robot, lockstep=False) as standin,
        ):
            standin.bus.stream(CYCLE, lambda _key, frame, _ns: frames.append(frame), ROBOT)
            for due_ns in paced(round(seconds * CONTROL_HZ)):
                self.published_late_us.append((monotonic_ns() - due_ns) / 1e3)
                standin.tick()
            self.output = robot.output
        messages = (decode(frame).message for frame in frames)
        self.reports = [message for message in messages if isinstance(message, CycleReport)]

    def late_us(self, share: float) -> float:
        """Return a quantile of the lateness."""
        return percentile([float(report.late_us) for report in self.reports], share)

    @property
    def missed(self) -> int:
        """Missed ticks between the first and the last report; the start-up is excluded."""
        return self.reports[-1].missed - self.reports[0].missed

    @property
    def overruns(self) -> int:
        """Ticks over budget between the first and the last report."""
        return self.reports[-1].overruns - self.reports[0].overruns


def jitter_figures(name: str, runs: list[TimedDrive]) -> list[Figure]:
    """Return the figures of the drives."""

    def each(value: Callable[[TimedDrive], float]) -> tuple[float, ...]:
        return tuple(value(run) for run in runs)

    figures = [
        figure(f"{name}, missed ticks", each(lambda run: run.missed), at_most=0.0),
        figure(f"{name}, over budget", each(lambda run: run.overruns)),
        figure(f"{name}, ticks", each(lambda run: len(run.reports))),
    ]
    for word, share in SHARES.items():
        late = tuple(run.late_us(share) for run in runs)
        figures.append(figure(f"{name}, late {word}", late, "us"))
    own = each(lambda run: percentile(run.published_late_us, 1.0))
    figures.append(figure(f"{name}, the substitute plant late, max", own, "us"))
    return figures


MAX_RATIO: Final = 1.10
WARM_UP: Final = 60
SHARE_OF_TURN: Final = 0.9  # of the time until the next robot's turn
KINDS: Final = ("open", "locked", "logging")


def add_mtls_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--blocks", type=int, default=24)
    parser.add_argument("--ticks", type=int, default=200, help="in each block")


def measure_mtls(options: argparse.Namespace) -> BenchmarkReport:
    """Measure the three robots in turn."""
    world = load(options.world)
    with (
        TemporaryDirectory(prefix="sidestep-") as folder,
        robot_process(world) as plain,
        robot_process(world, keys=silent_keys(Path(folder) / "silent")) as locked,
        robot_process(world, keys=made_keys(Path(folder) / "logging")) as logging,
        driving(world, plain, lockstep=False) as open_plant,
        driving(world, locked, lockstep=False) as locked_plant,
        driving(world, logging, lockstep=False) as logging_plant,
    ):
        pids = (plain.pid, locked.pid, logging.pid)
        robots = (open_plant, locked_plant, logging_plant)
        turns_in_turn(robots, WARM_UP, first=0)
        before = [cpu_s(pid) for pid in pids]
        blocks = [
            turns_in_turn(robots, options.ticks, first=block) for block in range(options.blocks)
        ]
        spent = [cpu_s(pid) - was for pid, was in zip(pids, before, strict=True)]
    ticks = options.blocks * options.ticks
    lost = [
        sum(options.ticks - len(block[robot]) for block in blocks) for robot in range(len(KINDS))
    ]
    figures = [*mtls_figures(blocks, "p50", 0.5, MAX_RATIO), *mtls_figures(blocks, "p99", 0.99)]
    figures += [
        figure(f"CPU of the robot per tick, {name}", cpu / ticks * 1e6, "us")
        for name, cpu in zip(KINDS, spent, strict=True)
    ]
    missing = ", ".join(f"{count} {name}" for name, count in zip(KINDS, lost, strict=True))
    notes = (
        f"{options.blocks} blocks of {options.ticks} ticks at 20 Hz, in turn",
        f"commands not in time: {missing}",
    )
    return BenchmarkReport(benchmark="mtls", figures=tuple(figures), notes=notes)


def silent_keys(folder: Path) -> Path:
    """Make certificates for a robot that logs no refusals."""
    made_keys(folder)
    with (folder / f"robot-{ROBOT}.toml").open("a", encoding="utf-8") as config:
        config.write("tell_refusals = false\n")
    return folder


def turns_in_turn(robots: Sequence[PlantStandIn], ticks: int, *, first: int) -> list[list[float]]:
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


def mtls_figures(
    blocks: Sequence[Sequence[list[float]]], name: str, share: float, at_most: float | None = None
) -> list[Figure]:
    """Return the ratios, of which that of mutual TLS has a threshold, and their terms."""
    values = [[percentile(block[robot], share) for block in blocks] for robot in range(len(KINDS))]
    plain, locked, logging = values
    locked_ratio = f"locked / open, {name}"
    logging_ratio = f"locked with log of refusals / open, {name}"
    return [
        figure(locked_ratio, ratios(locked, plain), "x", at_most=at_most),
        figure(logging_ratio, ratios(logging, plain), "x"),
        *(
            figure(f"sense to command, {kind}, {name}", found, "us")
            for kind, found in zip(KINDS, values, strict=True)
        ),
    ]


ROBOT_PROCESS = BenchmarkFunctions(add_robot_options, measure_robot)
JITTER = BenchmarkFunctions(add_jitter_options, measure_jitter)
MTLS = BenchmarkFunctions(add_mtls_options, measure_mtls)
