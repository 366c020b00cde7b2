"""Missed ticks and lateness at wall-clock speed, as reported by the robot.

Lateness counts from the arrival of the scan that starts the tick. The lateness of the substitute
plant that publishes the scans is reported too, since it is caused by the machine.
"""

import argparse
from collections.abc import Callable
from time import monotonic_ns

from checks.harness.figures import Figure, Report, percentile
from checks.harness.processes import ROBOT, robot_process
from checks.harness.stand_in import driving, paced
from plant.world.file import load
from protocol.topics import CYCLE
from protocol.wire.codec import decode
from protocol.wire.messages import CycleReport
from protocol.world import World
from runtime.units import CONTROL_HZ

SHARES = {"p50": 0.5, "p99": 0.99, "max": 1.0}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repetitions", type=int, default=1)


def measure(options: argparse.Namespace) -> Report:
    """Measure with normal scheduling and with SCHED_FIFO."""
    figures: list[Figure] = []
    notes: list[str] = []
    for name, flags in (("normal", []), ("SCHED_FIFO", ["--realtime"])):
        runs = [TimedDrive(load(options.world), flags) for _ in range(options.repetitions)]
        for run in runs:
            run.go(options.seconds)
        figures += figures_of(name, runs)
        notes += {f"{name}: {line}" for run in runs for line in run.output if "warning" in line}
    return Report(benchmark="jitter", figures=tuple(figures), notes=tuple(notes))


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


def figures_of(name: str, runs: list[TimedDrive]) -> list[Figure]:
    """Return the figures of the drives."""

    def each(value: Callable[[TimedDrive], float]) -> tuple[float, ...]:
        return tuple(value(run) for run in runs)

    figures = [
        Figure(
            name=f"{name}, missed ticks",
            unit="",
            values=each(lambda run: run.missed),
            at_most=0.0,
        ),
        Figure(name=f"{name}, over budget", unit="", values=each(lambda run: run.overruns)),
        Figure(name=f"{name}, ticks", unit="", values=each(lambda run: len(run.reports))),
    ]
    for word, share in SHARES.items():
        late = tuple(run.late_us(share) for run in runs)
        figures.append(Figure(name=f"{name}, late {word}", unit="us", values=late))
    own = each(lambda run: percentile(run.published_late_us, 1.0))
    figures.append(Figure(name=f"{name}, the substitute plant late, max", unit="us", values=own))
    return figures
