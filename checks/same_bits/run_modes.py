"""Equality of one trajectory in every mode: in-process, over Zenoh by hub and by router.

A digest is a SHA-256 over time stamp and true pose of every tick as 64-bit floats, so equal means
bit-identical. Another seed must give another digest, otherwise equality would prove nothing.
"""

import argparse

from checks.harness.figures import BenchmarkReport, Figure
from checks.harness.processes import lockstep_run
from plant.world.file import load
from study.trial.trial import Trial, run_trial


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--worlds", nargs="+", default=["box", "forest_medium"])


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Compare the digests of all modes."""
    figures: list[Figure] = []
    notes: list[str] = []
    for name in options.worlds:
        found = digests(name)
        first = found["in-process"]
        figures += [
            Figure(
                name=f"{name}, {way} = in-process",
                unit="",
                values=(float(digest == first),),
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
