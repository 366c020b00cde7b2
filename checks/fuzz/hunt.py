"""Fuzz every decoder with broken inputs: none may crash, hang or take too much memory.

Inputs that do are kept. `--again FILE` runs such an input, and shows its effect. The same `--seed`
gives the same inputs.
"""

import argparse
import faulthandler
import os
import resource
import signal
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import inf
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from types import FrameType, MappingProxyType
from typing import Final, NamedTuple

from checks.fuzz.files import KEYS, MISSION, SETTING, TYPED, WORLDS
from checks.fuzz.gateway_frames import (
    PATHS,
    frames,
    payloads,
    raw,
    records,
    traffic,
    traffic_records,
)
from checks.fuzz.target import FuzzTarget
from checks.fuzz.wire import LOGS, WIRE
from checks.harness.figures import BenchmarkReport, figure
from runtime.errors import UserError

GATEWAY: Final = (
    FuzzTarget(name="gateway_frames", samples=frames, run=raw, weight=10),
    FuzzTarget(name="gateway_payloads", samples=records, run=payloads, words=PATHS, weight=20),
    FuzzTarget(name="gateway_traffic", samples=traffic_records, run=traffic, weight=20),
)


TARGETS: Final[Mapping[str, FuzzTarget]] = MappingProxyType(
    {one.name: one for one in (*WIRE, *WORLDS, *MISSION, *SETTING, *LOGS, *TYPED, *KEYS, *GATEWAY)}
)
"""Every place that reads bytes of other programs or of users."""

LONGEST_S: Final = 5.0
"""Limit of the CPU time of one input; a megabyte of TOML takes its parser 2 s."""

MOST_MB: Final = 256.0
DEAD_S: Final = 60.0
"""Limit of wall time, after which the process is killed because the alarm had no effect."""

ARMED_S: Final = 5.0
KB: Final = 1024.0


class CpuTimeError(BaseException):
    """An input took too much CPU time. A BaseException, so that decoders do not catch it."""


class FuzzFinding(NamedTuple):
    """A defect and its input; `where` is the same for the same defect."""

    target: str
    number: int
    what: str
    where: str
    data: bytes


@dataclass(slots=True)
class FuzzTally:
    """The results of a block of inputs."""

    target: str
    inputs: int = 0
    accepted: int = 0
    cpu_s: float = 0.0
    finds: list[FuzzFinding] = field(default_factory=list)


def hunt(name: str, seed: int, begin: int, end: int) -> FuzzTally:
    """Try the inputs of these numbers; called in a process of its own."""
    target, tally = TARGETS[name], FuzzTally(name)
    begun_s, armed_s = cpu_s(), -inf
    with TemporaryDirectory() as folder, silence(), watch():
        for index in range(begin, end):
            if monotonic() - armed_s > ARMED_S:
                faulthandler.dump_traceback_later(DEAD_S, exit=True)
                armed_s = monotonic()
            data = target.input(seed, index)
            what, where = try_input(target, data, Path(folder), tally)
            tally.inputs += 1
            if what:
                tally.finds.append(FuzzFinding(name, index, what, where, data))
    tally.cpu_s = cpu_s() - begun_s
    faulthandler.cancel_dump_traceback_later()
    return tally


def try_input(target: FuzzTarget, data: bytes, folder: Path, tally: FuzzTally) -> tuple[str, str]:
    """Return the defect and its place; empty if the input was accepted or properly refused."""
    before_mb = peak_mb()
    try:
        with limited(LONGEST_S):
            tally.accepted += target.accepts(data, folder)
    except KeyboardInterrupt:
        raise
    except CpuTimeError as error:
        return f"hangs: more than {LONGEST_S:g} s of CPU", place_of(error)
    except BaseException as error:
        return f"{type(error).__name__}: {error}"[:300], place_of(error)
    grown_mb = peak_mb() - before_mb
    return (f"takes {grown_mb:.0f} MB", "memory") if grown_mb > MOST_MB else ("", "")


def place_of(error: BaseException) -> str:
    """Return the innermost line of the project, and the type of the error."""
    root = str(Path(__file__).parents[2])
    ours = [
        one
        for one in traceback.extract_tb(error.__traceback__)
        if one.filename.startswith(root) and one.filename != __file__
    ]
    last = ours[-1] if ours else None
    place = "nowhere" if last is None else f"{Path(last.filename).relative_to(root)}:{last.lineno}"
    return f"{place} {type(error).__name__}"


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Limit the CPU time, which does not depend on the load of the machine.

    The alarm repeats, because Python ignores one that comes in a finalizer.
    """
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)


@contextmanager
def watch() -> Iterator[None]:
    """Raise at the alarm, treat warnings as errors, and limit the memory."""

    def too_long(_number: int, _frame: FrameType | None) -> None:
        raise CpuTimeError

    before = signal.signal(signal.SIGVTALRM, too_long)
    limits = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (4 << 30, limits[1]))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, limits)
        signal.signal(signal.SIGVTALRM, before)


@contextmanager
def silence() -> Iterator[None]:
    """Discard the output of decoders."""
    sys.stdout.flush()
    before, nowhere = (os.dup(1), os.dup(2)), os.open(os.devnull, os.O_WRONLY)
    try:
        for number in (1, 2):
            os.dup2(nowhere, number)
        yield
    finally:
        for number, old in enumerate(before, start=1):
            os.dup2(old, number)
            os.close(old)
        os.close(nowhere)


def cpu_s() -> float:
    """Return the CPU time of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def peak_mb() -> float:
    """Return the peak memory of this process in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KB


USUAL_INPUTS: Final = 100_000
BLOCK_COST: Final = 4000
"""Inputs of weight 1000 in a block; a slower decoder has fewer."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench fuzz`."""
    parser.add_argument(
        "--inputs", type=int, default=USUAL_INPUTS, metavar="N", help="number of inputs"
    )
    parser.add_argument("--seconds", type=float, metavar="S", help="end of new inputs")
    parser.add_argument("--targets", nargs="+", choices=TARGETS, metavar="NAME", help="(all)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, metavar="K", help="processes (2)")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder for inputs that fail")
    parser.add_argument("--again", type=Path, metavar="FILE", help="run a kept input")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Run a kept input, or hunt and report."""
    if options.again is not None:
        return run_again(options.again)
    names = options.targets or list(TARGETS)
    blocks = share_out([TARGETS[name] for name in names], options.inputs, options.seed)
    deadline_s = monotonic() + options.seconds if options.seconds else float("inf")
    tallies = hunt_blocks(blocks, options.jobs, deadline_s)
    finds = [find for tally in tallies for find in tally.finds]
    keep(finds, options.keep)
    return report_of(tallies, finds, options.inputs if options.seconds is None else None)


def run_again(file: Path) -> BenchmarkReport:
    """Run an input that was kept; its errors are raised, for `sidestep --traceback`."""
    name = file.name.rpartition("-")[0]
    if name not in TARGETS:
        raise UserError(f"{file}: expected a name TARGET-NUMBER with one of: {', '.join(TARGETS)}")
    with TemporaryDirectory() as folder:
        accepted = TARGETS[name].accepts(file.read_bytes(), Path(folder))
    return BenchmarkReport(benchmark="fuzz", figures=(figure(f"{name}, accepted", accepted),))


class Block(NamedTuple):
    """Inputs of one decoder, by their numbers."""

    name: str
    seed: int
    begin: int
    end: int


def share_out(targets: Sequence[FuzzTarget], inputs: int, seed: int) -> Iterator[Block]:
    """Yield blocks of all targets in turn, by weight, in a reproducible order."""
    whole = sum(target.weight for target in targets)
    wanted = {target.name: -(-inputs * target.weight // whole) for target in targets}
    done = Counter[str]()
    while any(done[name] < count for name, count in wanted.items()):
        for target in targets:
            name, begin = target.name, done[target.name]
            end = min(begin + max(20, BLOCK_COST * target.weight // 1000), wanted[target.name])
            if begin < end:
                done[name] = end
                yield Block(name, seed, begin, end)


def hunt_blocks(blocks: Iterator[Block], jobs: int, deadline_s: float) -> list[FuzzTally]:
    """Run blocks in processes; a block that kills its process is a finding."""
    tallies: list[FuzzTally] = []
    idle = [new_process() for _ in range(jobs)]
    running: dict[Future[FuzzTally], tuple[Block, ProcessPoolExecutor]] = {}
    try:
        for one in blocks:
            if monotonic() > deadline_s:
                break
            process = idle.pop()
            running[process.submit(hunt, *one)] = one, process
            if not idle:
                idle += collect(running, tallies)
        while running:
            idle += collect(running, tallies)
    finally:
        for process in (*idle, *(process for _, process in running.values())):
            process.shutdown(cancel_futures=True)
    return tallies


def new_process() -> ProcessPoolExecutor:
    """Start a process that runs blocks."""
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"))


def collect(
    running: dict[Future[FuzzTally], tuple[Block, ProcessPoolExecutor]], tallies: list[FuzzTally]
) -> Iterator[ProcessPoolExecutor]:
    """Wait for a block; yield the processes that are free again, new ones for dead ones."""
    for future in wait(running, return_when=FIRST_COMPLETED).done:
        one, process = running.pop(future)
        try:
            tallies.append(future.result())
            yield process
        except BrokenProcessPool:
            where = f"inputs {one.begin} to {one.end}"
            find = FuzzFinding(one.name, one.begin, "the process died", where, b"")
            tallies.append(FuzzTally(one.name, finds=[find]))
            yield new_process()


def keep(finds: Sequence[FuzzFinding], folder: Path | None) -> None:
    """Write one input of each defect."""
    if folder is None or not finds:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for find in {(find.target, find.where): find for find in reversed(finds)}.values():
        (folder / f"{find.target}-{find.number}").write_bytes(find.data)


def report_of(
    tallies: Sequence[FuzzTally], finds: Sequence[FuzzFinding], wanted: int | None
) -> BenchmarkReport:
    """Return the report of a hunt."""
    inputs, accepted, cpu_s = Counter[str](), Counter[str](), Counter[str]()
    for tally in tallies:
        inputs[tally.target] += tally.inputs
        accepted[tally.target] += tally.accepted
        cpu_s[tally.target] += round(tally.cpu_s * 1e6)
    figures = [
        figure("inputs", inputs.total(), at_least=wanted),
        figure("crashes, hangs, memory", len(finds), at_most=0.0),
    ]
    notes = [
        f"{name}: {count} inputs, {accepted[name]} accepted, {cpu_s[name] / count:.0f} us each"
        for name, count in inputs.items()
        if count
    ]
    counts = Counter((find.target, find.where, find.what) for find in finds)
    first = {(find.target, find.where): find for find in reversed(finds)}
    for (target, where), find in first.items():
        times = sum(n for key, n in counts.items() if key[:2] == (target, where))
        notes.append(f"FOUND {times} x {target} {find.number}: {where}: {find.what}")
    return BenchmarkReport(benchmark="fuzz", figures=tuple(figures), notes=tuple(notes))
