"""Wall-clock driving: ticks missed and how late the others were, as the robot itself reports.

Lateness counts from the arrival of the scan that starts the tick. The stand-in that publishes the
scans is a process like any other: what it was late itself is shown too, for it is the machine's.
"""

import argparse
from collections.abc import Callable
from time import monotonic_ns

from plant.model.types import World
from plant.world.file import load
from protocol.topics import CYCLE
from protocol.wire.codec import decode
from protocol.wire.messages import CycleReport
from runtime.timing import CONTROL_HZ
from verification.harness.figures import Figure, Report, percentile
from verification.harness.pace import paced
from verification.harness.processes import ROBOT, robot_process
from verification.harness.stand_in import driving

SHARES = {"p50": 0.5, "p99": 0.99, "max": 1.0}


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repetitions", type=int, default=1)


def measure(options: argparse.Namespace) -> Report:
    figures: list[Figure] = []
    notes: list[str] = []
    for name, flags in (("normal", []), ("SCHED_FIFO", ["--realtime"])):
        runs = [Drive(load(options.world), flags) for _ in range(options.repetitions)]
        for run in runs:
            run.go(options.seconds)
        figures += of(name, runs)
        notes += {f"{name}: {line}" for run in runs for line in run.output if "warning" in line}
    return Report(benchmark="jitter", figures=tuple(figures), notes=tuple(notes))


class Drive:
    """One robot process, driven for some time, and every cycle report of it."""

    def __init__(self, world: World, flags: list[str]) -> None:
        self._world = world
        self._flags = flags
        self.output: list[str] = []
        self.published_late_us: list[float] = []
        self.reports: list[CycleReport] = []

    def go(self, seconds: float) -> None:
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
        return percentile([float(report.late_us) for report in self.reports], share)

    @property
    def missed(self) -> int:
        """From the first report to the last; before it the loop was still finding its beat."""
        return self.reports[-1].missed - self.reports[0].missed

    @property
    def overruns(self) -> int:
        return self.reports[-1].overruns - self.reports[0].overruns


def of(name: str, runs: list[Drive]) -> list[Figure]:
    def each(value: Callable[[Drive], float]) -> tuple[float, ...]:
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
    figures.append(Figure(name=f"{name}, the stand-in itself late, max", unit="us", values=own))
    return figures
