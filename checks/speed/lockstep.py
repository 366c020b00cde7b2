"""Time per tick of plant, robot and ground as three processes in lockstep over Zenoh.

Wall time counts from the start of simulated time to the message that the goal has ended. The lower
bound is the tick of a trial in one process, plus one round trip of a bare Zenoh ping-pong: the same
computation, and the same two messages. The three are measured in turn.

The breakdown shows where the time of a tick goes. The stages of the closed loop follow one another
and add up to the time per tick; ticks of unusual duration are left out. Work beside them, such as
the robot's telemetry after its wheel command, shows only in the CPU times of threads. Each process
of the loop notes when it passes the points below, on the monotonic clock that all processes of a
computer share: `python -m checks.speed.lockstep FILE ARGS...` runs `sidestep ARGS...` so, and FILE
receives the notes as JSON when it ends. A note costs about 0.3 us.

One trajectory is equal in every mode: in-process, over Zenoh by hub and by router. A digest is a
SHA-256 over time stamp and true pose of every tick as 64-bit floats, so equal means bit-identical.
Another seed must give another digest, otherwise equality would prove nothing.
"""

import argparse
import json
import os
import runpy
import sys
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from statistics import mean, median
from tempfile import TemporaryDirectory
from time import monotonic_ns
from typing import Any, Final, NamedTuple

from checks.harness.figures import BenchmarkFunctions, BenchmarkReport, Figure, figure
from checks.harness.processes import GoalDriver, LockstepRun, lockstep_run, stack
from checks.speed.latency import PingPong, ping_pong, sizes, trip_us
from plant.process import Process
from plant.world.file import load
from protocol.bus.mailbox import Mailbox
from protocol.bus.publisher import Publisher
from protocol.topics import CLOCK, DRIVE
from robot.process import RobotProcess
from robot.vehicle import RobotVehicle
from runtime.units import NS_PER_US
from study.trial.trial import Trial, run_trial

AT_LEAST = 100.0
AT_MOST = 1.5
ROUND_TRIPS = 1000


class TickCosts(NamedTuple):
    """Wall times in us: a tick of the three processes, a tick of a trial, a bare round trip."""

    lockstep_us: float
    trial_us: float
    round_trip_us: float

    @property
    def ratio(self) -> float:
        """The tick of the three processes over its lower bound."""
        return self.lockstep_us / (self.trial_us + self.round_trip_us)


def add_lockstep_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=["forest_medium", "forest_dense"])
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--router", action="store_true", help="use a router instead of the hub")


def measure_lockstep(options: argparse.Namespace) -> BenchmarkReport:
    """Measure the time per tick in each world."""
    figures: list[Figure] = []
    with ping_pong(*sizes()) as pings:
        for name in options.worlds:
            trial = Trial(world=load(name))
            runs = [
                run_beside_peers(name, trial, pings, router=options.router)
                for _ in range(options.repetitions)
            ]
            figures += figures_of(name, runs, router=options.router)
    way = "by a router, two hops" if options.router else "the robot is the hub, one hop"
    return BenchmarkReport(benchmark="lockstep", figures=tuple(figures), notes=(way,))


def run_beside_peers(name: str, trial: Trial, pings: PingPong, *, router: bool) -> TickCosts:
    """Measure the three processes, the trial and the ping-pong, in turn."""
    run = lockstep_run(name, trial, router=router)
    alone = run_trial(trial)
    round_trip_us = median(trip_us(pings) for _ in range(ROUND_TRIPS))
    return TickCosts(
        run.wall_s * 1e6 / run.score.ticks, alone.wall_s * 1e6 / alone.ticks, round_trip_us
    )


def figures_of(name: str, runs: list[TickCosts], *, router: bool) -> list[Figure]:
    """Return the figures of one world. Only the three processes without a router have limits."""
    paces = tuple(50_000.0 / run.lockstep_us for run in runs)
    return [
        figure(f"{name}, real time", paces, "x", at_least=None if router else AT_LEAST),
        figure(
            f"{name}, tick / (trial's tick + round trip)",
            [run.ratio for run in runs],
            "x",
            at_most=None if router else AT_MOST,
        ),
        figure(f"{name}, wall", [run.lockstep_us for run in runs], "us/tick"),
        figure(f"{name}, wall of a trial", [run.trial_us for run in runs], "us/tick"),
        figure(f"{name}, bare round trip, p50", [run.round_trip_us for run in runs], "us"),
    ]


STAGES: Final = (
    ("plant: make and put the sensor frames", f"sent {CLOCK.path}"),
    ("Zenoh: plant to robot", f"arrived {CLOCK.path}"),
    ("robot: hand-over to the control thread", "cycle"),
    ("robot: requests and inputs", "step"),
    ("robot: core", "stepped"),
    ("robot: encode the wheel command", f"put {DRIVE.path}"),
    ("Zenoh: robot to plant", f"arrived {DRIVE.path}"),
    ("plant: hand-over to its loop", "advance"),
    ("plant: advance one period", "publish"),
)
"""Each stage ends at the point of the second column; the first begins at `publish`."""

Notes = list[tuple[str, int]]


class ThreadCost(NamedTuple):
    """CPU time in ns and context switches of a thread."""

    cpu_ns: int
    switches: int


class Usage(NamedTuple):
    """Costs of the main thread of a process, and of its other threads together."""

    main: ThreadCost
    others: ThreadCost


class Breakdown(NamedTuple):
    """One run: us per stage, usage per process, and notes of plant and robot."""

    run: LockstepRun
    stages_us: list[float]
    usages: dict[str, Usage]
    notes: dict[str, Notes]


def add_breakdown_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument(
        "--all-topics", action="store_true", help="subscribe to all topics, as a recorder does"
    )


def measure_breakdown(options: argparse.Namespace) -> BenchmarkReport:
    """Measure the stages of some runs in one world."""
    runs = [
        run_with_notes(options.world, all_topics=options.all_topics)
        for _ in range(options.repetitions)
    ]
    figures = [
        figure("tick", [sum(run.stages_us) for run in runs], "us"),
        *(
            figure(name, [run.stages_us[index] for run in runs], "us")
            for index, (name, _) in enumerate(STAGES)
        ),
        *usage_figures(runs),
        *(
            figure(f"{name}: frames put", [frames_per_tick(run, name) for run in runs], "/tick")
            for name in ("plant", "robot")
        ),
    ]
    topics = "all topics" if options.all_topics else "the robot's status"
    notes = (f"{options.world}; the ground process subscribes to {topics}",)
    return BenchmarkReport(benchmark="breakdown", figures=tuple(figures), notes=notes)


def usage_figures(runs: list[Breakdown]) -> Iterator[Figure]:
    """Yield CPU time and context switches per tick of the threads of each process."""
    for name in runs[0].usages:
        for part, label in (("main", "main thread"), ("others", "other threads")):
            costs: list[ThreadCost] = [getattr(run.usages[name], part) for run in runs]
            ticks = [run.run.score.ticks for run in runs]
            pairs = list(zip(costs, ticks, strict=True))
            yield figure(
                f"{name}: CPU, {label}",
                [cost.cpu_ns / NS_PER_US / count for cost, count in pairs],
                "us/tick",
            )
            yield figure(
                f"{name}: context switches, {label}",
                [cost.switches / count for cost, count in pairs],
                "/tick",
            )


def run_with_notes(name: str, *, all_topics: bool) -> Breakdown:
    """Drive to the goal of a world with probes in plant and robot."""
    trial = Trial(world=load(name))
    with TemporaryDirectory() as folder:
        files = {role: Path(folder, role) for role in ("plant", "robot")}

        def program(role: str) -> tuple[str, ...]:
            return "checks.speed.lockstep", str(files[role])

        with stack(name, trial, router=False, program=program) as processes:
            pids = {**processes.pids, "ground": os.getpid()}
            before: dict[str, Usage] = {}
            if all_topics:
                processes.bus.stream_all(lambda _key, _frame, _ns: None)
            driver = GoalDriver(processes.bus)
            run = driver.drive(trial.world, lambda: before.update(usages(pids)))
            after = usages(pids)
        notes = {
            role: [
                (point, time_ns) for point, time_ns in json.loads(file.read_text(encoding="utf-8"))
            ]
            for role, file in files.items()
        }
    used = {role: difference(after[role], before[role]) for role in pids}
    return Breakdown(run, stages_us(notes), used, notes)


def stages_us(notes: dict[str, Notes]) -> list[float]:
    """Return the mean duration of each stage, over the middle half of the ticks by duration."""
    begins = [time_ns for point, time_ns in notes["plant"] if point == "publish"]
    ordered = sorted((time_ns, point) for role in notes for point, time_ns in notes[role])
    times = [time_ns for time_ns, _ in ordered]
    ticks: list[list[float]] = []
    for begin_ns, end_ns in pairwise(begins):
        passed = ordered[bisect_left(times, begin_ns) : bisect_left(times, end_ns)]
        found = points_ns([(point, time_ns) for time_ns, point in passed], end_ns)
        if found is not None:
            ends = pairwise([begin_ns, *found])
            ticks.append([(after - before) / NS_PER_US for before, after in ends])
    ticks.sort(key=sum)
    middle = ticks[len(ticks) // 4 : 3 * len(ticks) // 4]
    return [mean(column) for column in zip(*middle, strict=True)]


def points_ns(passed: Notes, end_ns: int) -> list[int] | None:
    """Return the ends of the stages of one tick, none before the previous; None if one lacks.

    A frame may arrive before its sender's call returns: the sender's stage then ends on arrival.
    """
    counts = Counter(point for point, _ in passed)
    wanted = [point for _, point in STAGES[:-1]]
    if any(counts[point] != 1 for point in wanted):
        return None
    time_of = dict(passed)
    ends = [*(time_of[point] for point in wanted), end_ns]
    for index in range(len(ends) - 2, -1, -1):
        ends[index] = min(ends[index], ends[index + 1])
    return ends


def frames_per_tick(run: Breakdown, role: str) -> float:
    """Return the number of frames that a process puts per tick."""
    points = Counter(point for point, _ in run.notes[role])
    puts = sum(count for point, count in points.items() if point.startswith("put "))
    return puts / points["publish" if role == "plant" else "cycle"]


def usages(pids: dict[str, int]) -> dict[str, Usage]:
    """Return what the threads of each process have used so far."""
    found = {}
    for role, pid in pids.items():
        costs = {int(task.name): cost_of(task) for task in Path(f"/proc/{pid}/task").iterdir()}
        main = costs.pop(pid)
        others = ThreadCost(
            sum(cost.cpu_ns for cost in costs.values()),
            sum(cost.switches for cost in costs.values()),
        )
        found[role] = Usage(main, others)
    return found


def cost_of(task: Path) -> ThreadCost:
    """Return CPU time and context switches of one thread."""
    cpu_ns = int((task / "schedstat").read_text(encoding="utf-8").split()[0])
    lines = (task / "status").read_text(encoding="utf-8").splitlines()
    return ThreadCost(
        cpu_ns, sum(int(line.split()[1]) for line in lines if "ctxt_switches" in line)
    )


def difference(after: Usage, before: Usage) -> Usage:
    """Return CPU time and context switches between two measurements."""
    pairs = zip(after, before, strict=True)
    return Usage(*(ThreadCost(a.cpu_ns - b.cpu_ns, a.switches - b.switches) for a, b in pairs))


NOTES: list[tuple[str, int]] = []


def note(point: str) -> None:
    """Note the time at a point."""
    NOTES.append((point, monotonic_ns()))


def watch(owner: type, name: str, begin: str, end: str = "") -> None:
    """Note the times at which a method begins and ends."""
    method: Callable[..., Any] = getattr(owner, name)

    def watched(*arguments: Any, **keywords: Any) -> Any:
        note(begin)
        try:
            return method(*arguments, **keywords)
        finally:
            if end:
                note(end)

    setattr(owner, name, watched)


def watch_topics(owner: type, name: str, begin: str, end: str) -> None:
    """Note the beginning and end of a method of an object with a topic, with the topic's path."""
    method: Callable[..., Any] = getattr(owner, name)

    def watched(self: Any, *arguments: Any) -> Any:
        path = self.topic.path
        note(f"{begin} {path}")
        try:
            return method(self, *arguments)
        finally:
            note(f"{end} {path}")

    setattr(owner, name, watched)


def run_probed(arguments: list[str]) -> None:
    """Run a verb with time stamps; raise SystemExit with its exit code."""
    file, *words = arguments
    watch(Process, "publish", "publish", "published")
    watch(Process, "advance", "advance")
    watch(RobotProcess, "cycle", "cycle", "cycled")
    watch(RobotVehicle, "step", "step", "stepped")
    watch_topics(Publisher, "put_frame", "put", "sent")
    watch_topics(Mailbox, "store", "arrived", "stored")
    sys.argv = ["sidestep", *words]
    try:
        runpy.run_module("sidestep", run_name="__main__")
    finally:
        Path(file).write_text(json.dumps(NOTES), encoding="utf-8")


def add_digest_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=["box", "forest_medium"])


def measure_digests(options: argparse.Namespace) -> BenchmarkReport:
    """Compare the digests of all modes."""
    figures: list[Figure] = []
    notes: list[str] = []
    for name in options.worlds:
        found = digests(name)
        first = found["in-process"]
        figures += [
            figure(
                f"{name}, {way} = in-process",
                digest == first,
                at_least=1.0 if way != OTHER else None,
                at_most=0.0 if way == OTHER else None,
            )
            for way, digest in found.items()
        ]
        notes += [f"{name}, {way}: {digest}" for way, digest in found.items()]
    return BenchmarkReport(benchmark="digest", figures=tuple(figures), notes=tuple(notes))


OTHER = "hub, another seed"


def digests(name: str) -> dict[str, str]:
    """Return the digest of a world in each mode."""
    trial, other = Trial(world=load(name)), Trial(world=load(name), seed=1)
    return {
        "in-process": run_trial(trial).digest,
        "in-process again": run_trial(trial).digest,
        "hub": lockstep_run(name, trial).digest,
        "hub again": lockstep_run(name, trial).digest,
        "router": lockstep_run(name, trial, router=True).digest,
        OTHER: lockstep_run(name, other).digest,
    }


DIGEST = BenchmarkFunctions(add_digest_options, measure_digests)
LOCKSTEP = BenchmarkFunctions(add_lockstep_options, measure_lockstep)
BREAKDOWN = BenchmarkFunctions(add_breakdown_options, measure_breakdown)


if __name__ == "__main__":
    run_probed(sys.argv[1:])
