"""Deterministic simulation of the whole stack: run seeds, and report speed and violations.

Each seed draws operators, faults and attacks over 20 simulated seconds. A seed that violates an
invariant is shrunk to the fewest events; `--events FILE` writes them, `--replay FILE` runs them.
`--defects` puts fixed defects back and counts the seeds that find each. `--seed S --replay` runs
one seed twice and compares the two runs bit by bit.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

from checks.harness.figures import Figure, Report
from checks.simulation.campaign import (
    MOST_HUNTED,
    SIMULATE,
    BatchResult,
    Campaign,
    run_in_processes,
    search_defect,
)
from checks.simulation.coverage import Coverage
from checks.simulation.events import from_json, to_json
from checks.simulation.shrink import shrink
from checks.simulation.simulation import RunResult
from runtime.units import NS_PER_S

MAX_SHOWN: Final = 5
AGAIN: Final = ""
"""`--replay` without a file."""


def add_options(parser: argparse.ArgumentParser, campaign: Campaign = SIMULATE) -> None:
    """Add the options of `bench simulate`, or of another campaign."""
    parser.add_argument("--seeds", type=int, default=500, metavar="N", help="number of seeds (500)")
    parser.add_argument(
        "--from", dest="first", type=int, default=0, metavar="S", help="first seed (0)"
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="K", help="processes (1)")
    parser.add_argument("--seed", type=int, metavar="S", help="run only this seed")
    parser.add_argument(
        "--replay",
        nargs="?",
        const=AGAIN,
        metavar="FILE",
        help="run the seed twice and compare; with FILE run its events",
    )
    parser.add_argument("--events", type=Path, metavar="FILE", help="file for the shrunk events")
    parser.add_argument(
        "--defects",
        nargs="*",
        choices=campaign.defects,
        metavar="NAME",
        help="put fixed defects back, these or all, and count the seeds that find each",
    )
    parser.add_argument("--no-shrink", action="store_true", help="keep the events as drawn")


def measure(options: argparse.Namespace, campaign: Campaign = SIMULATE) -> Report:
    """Run one scenario, many seeds, or the search for defects."""
    if options.defects is not None:
        return _report_of_defects(options, campaign)
    if options.replay not in (None, AGAIN):
        scenario = from_json(Path(options.replay).read_text("utf-8"))
        return _report_of_one(options, campaign, campaign.run(scenario, ""))
    if options.seed is not None:
        return _report_of_one(options, campaign, campaign.result_of(options.seed))
    done: list[BatchResult] = []
    for part in run_in_processes(campaign, options.first, options.seeds, options.jobs):
        done.append(part)
        _show_progress(done, options.seeds)
    return _report_of_many(options, campaign, done)


def _show_progress(done: list[BatchResult], wanted: int) -> None:
    seeds = sum(part.seeds for part in done)
    failed = sum(len(part.failed) for part in done)
    print(f"{seeds} of {wanted} seeds, {failed} violate", file=sys.stderr, flush=True)


def _report_of_many(
    options: argparse.Namespace, campaign: Campaign, done: list[BatchResult]
) -> Report:
    failed = [result for part in done for result in part.failed]
    cpu_s, simulated_ns = sum(p.cpu_s for p in done), sum(p.simulated_ns for p in done)
    coverage = Coverage()
    for part in done:
        coverage.add(part.coverage)
    notes = coverage.lines()
    for result in failed[:MAX_SHOWN]:
        notes += explain(result, options, campaign)
    if len(failed) > MAX_SHOWN:
        others = ", ".join(str(result.scenario.seed) for result in failed[MAX_SHOWN:][:50])
        notes.append(f"other seeds that violate: {others}")
    return Report(
        benchmark=campaign.name,
        figures=(
            Figure(name="seeds", unit="", values=(sum(part.seeds for part in done),)),
            Figure(name=campaign.failure, unit="", values=(len(failed),), at_most=0),
            Figure(
                name="simulated time per CPU time of one core",
                unit="x",
                values=(simulated_ns / NS_PER_S / cpu_s,),
                at_least=campaign.pace,
            ),
        ),
        notes=tuple(notes),
    )


def _report_of_one(options: argparse.Namespace, campaign: Campaign, result: RunResult) -> Report:
    failed = result.violation is not None
    figures = [Figure(name="violations", unit="", values=(int(failed),), at_most=0)]
    if options.replay == AGAIN:
        same = campaign.run(result.scenario, "").digest == result.digest
        figures.append(Figure(name="runs that differ", unit="", values=(int(not same),), at_most=0))
    return Report(
        benchmark=campaign.name,
        figures=tuple(figures),
        notes=(
            f"digest {result.digest} after {result.simulated_ns / NS_PER_S:.2f} s",
            *(explain(result, options, campaign) if failed else ()),
        ),
    )


def _report_of_defects(options: argparse.Namespace, campaign: Campaign) -> Report:
    """Report how many seeds find each defect, and by which invariant."""
    names = options.defects or tuple(campaign.defects)
    figures, notes = [], []
    for name in names:
        hunt = search_defect(name, options.first, campaign=campaign)
        words = "not found"
        if hunt.found is not None and hunt.found.violation is not None:
            words = f"seed {hunt.found.scenario.seed}: «{hunt.found.violation.invariant}»"
        notes.append(f"{name}, {campaign.defects[name].description}: {words}")
        print(f"{hunt.seeds:5} seeds  {notes[-1]}", file=sys.stderr, flush=True)
        seeds = hunt.seeds if hunt.found is not None else MOST_HUNTED + 1
        figures.append(
            Figure(
                name=f"seeds until {name} is found", unit="", values=(seeds,), at_most=MOST_HUNTED
            )
        )
    return Report(benchmark=campaign.name, figures=tuple(figures), notes=tuple(notes))


def explain(result: RunResult, options: argparse.Namespace, campaign: Campaign) -> list[str]:
    """Return seed, invariant, time, the fewest events, and the command that repeats the run."""
    small = result if options.no_shrink else shrink(result, lambda one: campaign.run(one, ""))
    violation, scenario = small.violation, small.scenario
    assert violation is not None
    if options.events is not None:
        options.events.write_text(to_json(scenario), encoding="utf-8")
    return [
        f"seed {scenario.seed} violates «{violation.invariant}» at "
        f"{violation.time_ns / NS_PER_S:.3f} s: {violation.words}",
        *(f"    {event}" for event in scenario.events),
        f"    again: sidestep bench {campaign.name} --seed {scenario.seed} --replay",
    ]
