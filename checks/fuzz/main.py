"""Fuzz every decoder with broken inputs: none may crash, hang or take too much memory.

`--again FILE` runs an input that was kept, and shows its effect. The same `--seed` gives the same
inputs.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Final, NamedTuple

from checks.fuzz.hunt import TARGETS, Finding, FuzzTally, hunt
from checks.fuzz.target import FuzzTarget
from checks.harness.figures import Figure, Report
from runtime.errors import UserError

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


def measure(options: argparse.Namespace) -> Report:
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


def run_again(file: Path) -> Report:
    """Run an input that was kept; its errors are raised, for `sidestep --traceback`."""
    name = file.name.rpartition("-")[0]
    if name not in TARGETS:
        raise UserError(f"{file}: expected a name TARGET-NUMBER with one of: {', '.join(TARGETS)}")
    with TemporaryDirectory() as folder:
        accepted = TARGETS[name].accepts(file.read_bytes(), Path(folder))
    figure = Figure(name=f"{name}, accepted", unit="", values=(float(accepted),))
    return Report(benchmark="fuzz", figures=(figure,))


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
            find = Finding(one.name, one.begin, "the process died", where, b"")
            tallies.append(FuzzTally(one.name, finds=[find]))
            yield new_process()


def keep(finds: Sequence[Finding], folder: Path | None) -> None:
    """Write one input of each defect."""
    if folder is None or not finds:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for find in {(find.target, find.where): find for find in reversed(finds)}.values():
        (folder / f"{find.target}-{find.number}").write_bytes(find.data)


def report_of(tallies: Sequence[FuzzTally], finds: Sequence[Finding], wanted: int | None) -> Report:
    """Return the report of a hunt."""
    inputs, accepted, cpu_s = Counter[str](), Counter[str](), Counter[str]()
    for tally in tallies:
        inputs[tally.target] += tally.inputs
        accepted[tally.target] += tally.accepted
        cpu_s[tally.target] += round(tally.cpu_s * 1e6)
    figures = [
        Figure(name="inputs", unit="", values=(float(inputs.total()),), at_least=wanted),
        Figure(name="crashes, hangs, memory", unit="", values=(float(len(finds)),), at_most=0.0),
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
    return Report(benchmark="fuzz", figures=tuple(figures), notes=tuple(notes))
