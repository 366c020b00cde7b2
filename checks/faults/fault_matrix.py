"""`sidestep bench faults`: run every fault in simulated and in wall time, and write the page.

Each repetition is saved at once, so that an interrupted run continues from the file.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Final, NamedTuple

from checks.faults import simulated_time, wall_time
from checks.faults.cases import FAULTS, FaultCase, Repetition, Results, Way, page
from checks.harness.figures import BenchmarkReport, describe_machine, figure, machine_load
from runtime.errors import UserError

KEPT: Final = Path("faults.jsonl")
SHORT: Final = {Way.LOCKSTEP: 1, Way.WALL: 1}
SHORT_WALL: Final = ("robot killed", "robot stopped", "plant killed", "robot | router")
"""Only these use real processes in the short form: each takes some seconds."""
BY_NAME: Final = {fault.name: fault for fault in FAULTS}


class PlannedRepetition(NamedTuple):
    """A repetition that is to be run."""

    fault: str
    way: Way
    number: int


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench faults`."""
    parser.add_argument("--lockstep", type=int, default=20, metavar="N", help="repetitions (20)")
    parser.add_argument("--wall", type=int, default=5, metavar="N", help="repetitions (5)")
    parser.add_argument("--short", action="store_true", help="a minute: few repetitions")
    text = "only faults whose name contains one of these"
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help=text)
    parser.add_argument(
        "--page", type=Path, metavar="FILE", help="write the matrix to FILE; keep rows not measured"
    )
    text = f"file that keeps the repetitions ({KEPT}; the short form keeps none)"
    parser.add_argument("--keep", type=Path, default=KEPT, metavar="FILE", help=text)
    parser.add_argument("--afresh", action="store_true", help="discard the kept repetitions")
    cores = len(os.sched_getaffinity(0))
    text = "runs with real processes at a time (1; more disturb each other)"
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help=text)
    parser.add_argument("--cores", type=int, default=cores, metavar="N", help=argparse.SUPPRESS)


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Run the repetitions that are missing and report all; UserError for an unknown fault."""
    faults = chosen(options.only)
    load_before = machine_load()
    if options.afresh:
        options.keep.unlink(missing_ok=True)
    results = Results(None) if options.short else Results.kept_in(options.keep)
    for way, workers in ((Way.LOCKSTEP, options.cores), (Way.WALL, options.jobs)):
        jobs = [job for job in planned(faults, way, options) if not results.has(*job)]
        for one in done(jobs, workers, short=options.short):
            results.add(one)
            print_verdict(one)
    about = describe_machine(load_before)
    if options.page is not None:
        before = options.page.read_text(encoding="utf-8") if options.page.exists() else ""
        options.page.write_text(page(results, about, before), encoding="utf-8")
    return report(faults, results)


def chosen(names: Iterable[str]) -> tuple[FaultCase, ...]:
    """Return the faults with one of these words in their names; UserError if there is none."""
    wanted = tuple(names)
    found = tuple(
        fault for fault in FAULTS if not wanted or any(name in fault.name for name in wanted)
    )
    if not found:
        raise UserError(f"no fault is named {' or '.join(wanted)}; faults: {', '.join(BY_NAME)}")
    return found


def planned(
    faults: Iterable[FaultCase], way: Way, options: argparse.Namespace
) -> Iterator[PlannedRepetition]:
    """Yield each fault once, then again, so that an interrupted run covers all faults."""
    wanted = options.lockstep if way is Way.LOCKSTEP else options.wall
    for number in range(min(wanted, SHORT[way]) if options.short else wanted):
        for fault in faults:
            quick = way is Way.LOCKSTEP or fault.name in SHORT_WALL or not options.short
            if way in fault.ways and quick:
                yield PlannedRepetition(fault.name, way, number)


def done(jobs: list[PlannedRepetition], workers: int, *, short: bool) -> Iterator[Repetition]:
    """Yield repetitions as they finish, each run in a new process."""
    if not jobs:
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = [pool.submit(one, job, short) for job in jobs]
        try:
            for future in as_completed(running):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def one(job: PlannedRepetition, short: bool) -> Repetition:
    """Run a repetition; `short` drives a shorter way in simulated time."""
    if job.way is Way.LOCKSTEP:
        return simulated_time.run(BY_NAME[job.fault], job.number, short=short)
    return wall_time.run(BY_NAME[job.fault], job.number)


def print_verdict(one: Repetition) -> None:
    """Print whether a repetition meets its requirement."""
    misses = one.misses(BY_NAME[one.fault])
    how = "MISSED: " + "; ".join(misses) if misses else "as required"
    print(f"{one.way:8} {one.number:2} {one.fault}: {how}", file=sys.stderr, flush=True)


def report(faults: Iterable[FaultCase], results: Results) -> BenchmarkReport:
    """Report the rows that miss their limit, and the stopping times of all."""
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
                figures.append(figure(name, stood_ms, "ms"))
    rows = figure("rows that miss their limit", missing, at_most=0.0)
    return BenchmarkReport(benchmark="faults", figures=(rows, *figures), notes=tuple(notes))
