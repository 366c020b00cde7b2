"""Runs of many seeds: their number, their cost, and the seeds that violate an invariant."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from multiprocessing import get_context
from time import process_time
from typing import Final, NamedTuple

from checks.simulation.coverage import Coverage
from checks.simulation.defects import DEFECTS, Defect
from checks.simulation.draw import draw_scenario
from checks.simulation.events import EventScenario
from checks.simulation.simulation import RunResult, run

CHUNK: Final = 20
CHUNKS_EACH: Final = 10
"""A process is replaced after this many chunks, because each run leaves some memory behind."""

MOST_HUNTED: Final = 2000
"""A defect that was put back must be found within this many seeds."""


class BatchResult(NamedTuple):
    """The results of some seeds: CPU time, failed runs and coverage."""

    seeds: int
    simulated_ns: int
    cpu_s: float
    failed: tuple[RunResult, ...]
    coverage: Coverage


class Campaign(NamedTuple):
    """What seeds stand for: how a scenario is drawn and run, and the defects that can be put back.

    `name` is that of the benchmark, `failure` names its figure of seeds that fail, and `pace` is
    the least simulated time per CPU time.
    """

    name: str
    draw: Callable[[int], EventScenario]
    run: Callable[[EventScenario, str], RunResult]
    defects: Mapping[str, Defect]
    failure: str = "seeds that violate an invariant"
    pace: float | None = None

    def result_of(self, seed: int, defect: str = "") -> RunResult:
        """Run a seed."""
        return self.run(self.draw(seed), defect)


SIMULATE: Final = Campaign("simulate", draw_scenario, run, DEFECTS, pace=100)


def run_seeds(
    seeds: Iterable[int], result_of: Callable[[int], RunResult] = SIMULATE.result_of
) -> BatchResult:
    """Run seeds in this process, one after the other."""
    began_s, count, simulated_ns = process_time(), 0, 0
    failed: list[RunResult] = []
    coverage = Coverage()
    for seed in seeds:
        result = result_of(seed)
        count += 1
        simulated_ns += result.simulated_ns
        coverage.add(result.coverage)
        if result.violation is not None:
            failed.append(result)
    return BatchResult(count, simulated_ns, process_time() - began_s, tuple(failed), coverage)


def run_drawn(
    draw: Callable[[int], EventScenario],
    execute: Callable[[EventScenario, str], RunResult],
    seed: int,
) -> RunResult:
    """Run a seed, in another process: defects are functions that do not pass to it."""
    return execute(draw(seed), "")


def run_in_processes(
    campaign: Campaign, first: int, count: int, jobs: int
) -> Iterator[BatchResult]:
    """Run seeds in `jobs` processes and yield the batches in the order of the seeds."""
    starts = range(first, first + count, CHUNK)
    chunks = [range(start, min(start + CHUNK, first + count)) for start in starts]
    with get_context("spawn").Pool(jobs, maxtasksperchild=CHUNKS_EACH) as pool:
        result_of = partial(run_drawn, campaign.draw, campaign.run)
        yield from pool.imap(partial(run_seeds, result_of=result_of), chunks)


class DefectSearch(NamedTuple):
    """The search for a defect: the number of seeds, and the failed run if one was found."""

    defect: str
    seeds: int
    found: RunResult | None


def search_defect(
    defect: str, first: int = 0, most: int = MOST_HUNTED, campaign: Campaign = SIMULATE
) -> DefectSearch:
    """Put a fixed defect back and run seeds until one violates an invariant."""
    for number, seed in enumerate(range(first, first + most), 1):
        result = campaign.result_of(seed, defect)
        if result.violation is not None:
            return DefectSearch(defect, number, result)
    return DefectSearch(defect, most, None)
