"""`sidestep bench faults`: every fault, so many times in simulated and in wall time, and its page.

Each repetition is kept in a file as soon as it is there; an interrupted run goes on from it.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Final, NamedTuple

from runtime.errors import UserError
from verification.faults_matrix import lockstep, wall_time
from verification.faults_matrix.page import page
from verification.faults_matrix.results import Repetition, Results
from verification.faults_matrix.table import FAULTS, Fault, Way
from verification.harness import machine
from verification.harness.figures import Figure, Report

KEPT: Final = Path("faults.jsonl")
SHORT: Final = {Way.LOCKSTEP: 1, Way.WALL: 1}
SHORT_WALL: Final = ("robot killed", "robot stopped", "plant killed", "robot | router")
"""In the short form only these have real processes: each takes some seconds."""
BY_NAME: Final = {fault.name: fault for fault in FAULTS}


class Job(NamedTuple):
    fault: str
    way: Way
    number: int


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--lockstep", type=int, default=20, metavar="N", help="repetitions (20)")
    parser.add_argument("--wall", type=int, default=5, metavar="N", help="repetitions (5)")
    parser.add_argument("--short", action="store_true", help="a minute: few repetitions")
    says = "faults of which the name contains one of these"
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help=says)
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="write the matrix there; keep rows not measured"
    )
    says = f"where repetitions are kept, and found ({KEPT}; the short form keeps none)"
    parser.add_argument("--keep", type=Path, default=KEPT, metavar="FILE", help=says)
    parser.add_argument("--afresh", action="store_true", help="forget what is kept there")
    cores = len(os.sched_getaffinity(0))
    says = "runs with real processes at a time (1: they disturb each other)"
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help=says)
    parser.add_argument("--cores", type=int, default=cores, metavar="N", help=argparse.SUPPRESS)


def measure(options: argparse.Namespace) -> Report:
    """Raises UserError when no fault has such a name."""
    faults = chosen(options.only)
    load_before = machine.load()
    if options.afresh:
        options.keep.unlink(missing_ok=True)
    results = Results(None) if options.short else Results.kept_in(options.keep)
    for way, workers in ((Way.LOCKSTEP, options.cores), (Way.WALL, options.jobs)):
        jobs = [job for job in jobs_of(faults, way, options) if not results.has(*job)]
        for one in done(jobs, workers):
            results.add(one)
            tell(one)
    about = machine.described(load_before)
    if options.page is not None:
        before = options.page.read_text(encoding="utf-8") if options.page.exists() else ""
        options.page.write_text(page(results, about, before), encoding="utf-8")
    return report(faults, results)


def chosen(names: Iterable[str]) -> tuple[Fault, ...]:
    wanted = tuple(names)
    found = tuple(
        fault for fault in FAULTS if not wanted or any(name in fault.name for name in wanted)
    )
    if not found:
        raise UserError(f"no fault is called {' or '.join(wanted)}: {', '.join(BY_NAME)}")
    return found


def jobs_of(faults: Iterable[Fault], way: Way, options: argparse.Namespace) -> Iterator[Job]:
    """Each fault once, then each once more: an interrupted run knows something of all."""
    wanted = options.lockstep if way is Way.LOCKSTEP else options.wall
    for number in range(min(wanted, SHORT[way]) if options.short else wanted):
        for fault in faults:
            quick = way is Way.LOCKSTEP or fault.name in SHORT_WALL or not options.short
            if way in fault.ways and quick:
                yield Job(fault.name, way, number)


def done(jobs: list[Job], workers: int) -> Iterator[Repetition]:
    """As they are done, each in a process without a past."""
    if not jobs:
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(one, job) for job in jobs]
        try:
            for future in as_completed(running):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def one(job: Job) -> Repetition:
    run = lockstep.run if job.way is Way.LOCKSTEP else wall_time.run
    return run(BY_NAME[job.fault], job.number)


def tell(one: Repetition) -> None:
    misses = one.misses(BY_NAME[one.fault])
    how = "MISSED: " + "; ".join(misses) if misses else "as it must"
    print(f"{one.way:8} {one.number:2} {one.fault}: {how}", file=sys.stderr, flush=True)


def report(faults: Iterable[Fault], results: Results) -> Report:
    """The rows that miss are to be none; of the others the latencies, worst first in no order."""
    figures, notes, missing = [], [], 0
    for fault in faults:
        for way in fault.ways:
            found = results.of(fault, way)
            bad = [miss for one in found for miss in one.misses(fault)]
            missing += bool(bad)
            notes += [f"{fault.name}, {way.value}: {miss}" for miss in sorted(set(bad))]
            stood_ms = tuple(one.stood_s * 1e3 for one in found if one.stood_s is not None)
            if stood_ms and fault.stands_s is not None:
                name = f"{fault.name}, {way.value}"
                figures.append(Figure(name=name, unit="ms", values=stood_ms))
    rows = Figure(name="rows that miss their limit", unit="", values=(missing,), at_most=0.0)
    return Report(benchmark="faults", figures=(rows, *figures), notes=tuple(notes))
