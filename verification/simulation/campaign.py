"""Many seeds: how many were run, what they cost, which of them violate an invariant."""

from collections.abc import Iterable, Iterator
from multiprocessing import get_context
from time import process_time
from typing import Final, NamedTuple

from verification.simulation.coverage import Coverage
from verification.simulation.draw import DURATION_NS, drawn
from verification.simulation.simulation import Result, run

CHUNK: Final = 20
CHUNKS_EACH: Final = 10
"""After so many a process is replaced: what a run leaves behind in memory adds up."""

MOST_HUNTED: Final = 2000
"""Seeds within which a defect that was put back is to be found."""


class Ran(NamedTuple):
    """Some seeds: CPU time of the process that ran them, and the results that violate."""

    seeds: int
    simulated_ns: int
    cpu_s: float
    failed: tuple[Result, ...]
    coverage: Coverage


def ran(seeds: Iterable[int], duration_ns: int = DURATION_NS) -> Ran:
    """Run seeds in this process, one after the other."""
    began_s, count, simulated_ns = process_time(), 0, 0
    failed: list[Result] = []
    coverage = Coverage()
    for seed in seeds:
        result = run(drawn(seed, duration_ns))
        count += 1
        simulated_ns += result.simulated_ns
        coverage.add(result.coverage)
        if result.violation is not None:
            failed.append(result)
    return Ran(count, simulated_ns, process_time() - began_s, tuple(failed), coverage)


def in_processes(first: int, count: int, jobs: int) -> Iterator[Ran]:
    """Run seeds in so many processes; what is done comes in the order of the seeds."""
    starts = range(first, first + count, CHUNK)
    chunks = [range(start, min(start + CHUNK, first + count)) for start in starts]
    with get_context("spawn").Pool(jobs, maxtasksperchild=CHUNKS_EACH) as pool:
        yield from pool.imap(ran, chunks)


class Hunted(NamedTuple):
    """How a defect was found: after how many seeds, by which of them, and which invariant."""

    defect: str
    seeds: int
    found: Result | None


def hunted(defect: str, first: int = 0, most: int = MOST_HUNTED) -> Hunted:
    """Put a mended defect back and run seeds until one violates an invariant."""
    for number, seed in enumerate(range(first, first + most), 1):
        result = run(drawn(seed), defect)
        if result.violation is not None:
            return Hunted(defect, number, result)
    return Hunted(defect, most, None)
