"""Measure trials and steps of the core, with the packages that the search path gives.

It runs with this tree, with its compiled modules, and with a commit since 22 November 2026: modules
that have moved since then are found under either name. Each line on standard input has a world and
a navigator, and each reply is one JSON line with CPU times per tick in us. With the arguments
WORLD NAVIGATOR COUNT it only runs so many trials, for a program that counts instructions.
"""

import json
import sys
from collections.abc import Callable
from importlib import import_module
from statistics import median
from time import thread_time_ns
from typing import Any

from robot.core import brain


def imported(*names: str) -> Any:
    """Return the first module that is there; raise ModuleNotFoundError if none is."""
    for name in names[:-1]:
        try:
            return import_module(name)
        except ModuleNotFoundError:
            continue
    return import_module(names[-1])


TRIALS = imported("study.trial.trial", "study.trial")
LOAD = imported("plant.world.file", "plant.world_file").load


def measured(world: str, navigator: str) -> dict[str, Any]:
    """Return the cost of a trial, set-up included, and of a step; 0 for a compiled step."""
    trial = TRIALS.Trial(world=LOAD(world), navigator=navigator)
    begun_ns = thread_time_ns()
    outcome = TRIALS.run_trial(trial)
    trial_us = (thread_time_ns() - begun_ns) / 1e3 / outcome.ticks
    costs_us: list[float] = []
    untimed = brain.step
    brain.step = timed(untimed, costs_us)
    try:
        TRIALS.run_trial(trial)
    finally:
        brain.step = untimed
    return {"trial_us": trial_us, "step_us": median(costs_us) if costs_us else 0.0}


def timed(function: Callable[..., Any], costs_us: list[float]) -> Callable[..., Any]:
    """Return a function that adds the CPU time of each call to a list."""

    def run(*arguments: Any) -> Any:
        begun_ns = thread_time_ns()
        found = function(*arguments)
        costs_us.append((thread_time_ns() - begun_ns) / 1e3)
        return found

    return run


def main() -> None:
    """Answer on standard output, or run trials and print the ticks of one."""
    if sys.argv[1:]:
        world, navigator, count = sys.argv[1:]
        trial = TRIALS.Trial(world=LOAD(world), navigator=navigator)
        ticks = [TRIALS.run_trial(trial).ticks for _ in range(int(count))]
        print(ticks[-1])
        return
    for line in sys.stdin:
        print(json.dumps(measured(*line.split())), flush=True)


if __name__ == "__main__":
    main()
