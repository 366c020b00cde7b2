"""This tree and an older commit, measured in turn: trials, steps of the core, the robot process.

The commit is unpacked from the history and runs with the packages of this environment. One script
(`trial_costs.py`) measures the trials of both, and of this tree with compiled modules. Ratios are
those of neighbours in time, so that a load slows both. The robot process is measured by each
commit's own `bench robot`, because the frames that it needs have changed.

With valgrind, cachegrind counts the machine instructions of a tick: those of one trial more in the
same process. They are exact, and differ with the compiler of Python and of the modules.
"""

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final

from checks.built import ROOT, BuildError, install_compiled
from checks.harness.figures import BenchmarkReport, Figure, figure, ratios
from checks.same_bits.__main__ import unpack
from checks.speed.trials import Ask, json_child
from runtime.errors import UserError

BASELINE: Final = "25df5621"
"""The commit of 22 November 2026 whose figures stood on the page for six days."""

FOLDER: Final = ROOT / "build" / "speed"
SCRIPT: Final = Path(__file__).with_name("trial_costs.py")
WORLD: Final = "forest_dense"
TRIALS: Final = ("vgm", "vgm_memory")
NOW, BEFORE, COMPILED = "now", "before", "compiled"
ROBOT_FIGURES: Final = {
    "CPU of one core at 20 Hz": ("robot at 20 Hz, CPU", "%"),
    "resident": ("robot at 20 Hz, memory", "MB"),
    "imports, fresh process": ("robot, imports", "s"),
}
"""Figures of `bench robot`, in every commit so far, with name and unit here."""

ATTEMPTS: Final = 4

EXACT: Final = {"PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
"""With these the machine instructions are equal in each run."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--against", default=BASELINE, metavar="COMMIT", help="the older commit")
    parser.add_argument("--repetitions", type=int, default=9, help="of each trial")
    parser.add_argument("--robot-repetitions", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=15.0, help="of each robot, at 20 Hz")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure both, and compiled modules; raise UserError without the commit."""
    if problem := missing(options.against, ROOT):
        raise UserError(problem)
    folders = {NOW: ROOT, BEFORE: unpack(options.against, FOLDER / "before", ())}
    notes = [f"before: commit {options.against}; {WORLD}"]
    try:
        folders[COMPILED] = install_compiled(FOLDER / "compiled")
    except (BuildError, SystemExit) as error:
        notes.append(f"no compiled modules: {str(error).partition(chr(10))[0]}")
    figures = [*trial_figures(folders, options.repetitions)]
    try:
        figures += robot_figures(folders, options.robot_repetitions, options.seconds)
    except RuntimeError as error:
        notes.append(f"the robot process was not measured: {error}")
    if shutil.which("valgrind"):
        figures += instruction_figures(folders)
        notes.append(f"instructions: cachegrind, Python of {platform.python_compiler()}")
    else:
        notes.append("machine instructions were not counted, because valgrind is not installed")
    return BenchmarkReport(benchmark="against", figures=tuple(figures), notes=tuple(notes))


def missing(commit: str, root: Path) -> str:
    """Return why a commit cannot be unpacked; nothing if it can."""

    def git(*words: str) -> subprocess.CompletedProcess[str]:
        words = ("git", "-C", str(root), *words)
        return subprocess.run(words, capture_output=True, text=True, check=False)

    try:
        shallow = git("rev-parse", "--is-shallow-repository")
    except OSError:
        return f"commit {commit} is not here, because git is not installed"
    if shallow.returncode:
        return f"commit {commit} is not here, because this is no git checkout"
    if git("cat-file", "-e", f"{commit}^{{commit}}").returncode == 0:
        return ""
    if shallow.stdout.strip() == "true":
        return f"commit {commit} is not in this shallow clone: `git fetch --unshallow` fetches it"
    return f"commit {commit} is not in the history of this checkout"


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of a process that takes the packages of a folder."""
    return {**os.environ, "PYTHONPATH": str(folder)}


def trial_figures(folders: Mapping[str, Path], repetitions: int) -> Iterator[Figure]:
    """Yield the costs of trials and steps, and their ratios; all folders take turns."""
    with ExitStack() as stack:
        children: dict[str, Ask] = {}
        for name, folder in folders.items():
            words = (sys.executable, "-P", SCRIPT)
            child = json_child(words, cwd=folder, env=environment(folder))
            children[name] = stack.enter_context(child)
        for navigator in TRIALS:
            jobs = {name: partial(ask, f"{WORLD} {navigator}") for name, ask in children.items()}
            in_turn(jobs, 1)  # fills caches
            found = in_turn(jobs, repetitions)
            for kind, title in (("trial_us", "trial"), ("step_us", "core step")):
                costs = {name: [one[kind] for one in found[name]] for name in found}
                yield from compared(f"{title}, {navigator}", "us/tick", costs)


def in_turn(jobs: Mapping[str, Callable[[], Any]], repetitions: int) -> dict[str, list[Any]]:
    """Return what each job returns some times, in turn; every other turn goes backwards."""
    found: dict[str, list[Any]] = {name: [] for name in jobs}
    for turn in range(repetitions):
        for name in list(jobs)[:: -1 if turn % 2 else 1]:
            found[name].append(jobs[name]())
    return found


def compared(title: str, unit: str, costs: Mapping[str, Sequence[float]]) -> Iterator[Figure]:
    """Yield the ratios of a cost to that before, and of pure Python to compiled modules.

    The ratio of the least ones is the steadier where a load comes and goes.
    """
    now, before, compiled = (list(costs.get(name, ())) for name in (NOW, BEFORE, COMPILED))
    yield figure(f"{title}: now / before", ratios(now, before), "x")
    if len(now) > 1:
        yield figure(f"{title}: least now / least before", min(now) / min(before), "x")
    if compiled and all(compiled):
        yield figure(f"{title}: pure / compiled", ratios(now, compiled), "x")
    yield figure(f"{title}: now", now, unit)


def robot_figures(folders: Mapping[str, Path], repetitions: int, seconds: float) -> list[Figure]:
    """Return the cost of the robot process of both commits, which take turns."""
    jobs = {name: partial(robot_cost, folders[name], seconds) for name in (NOW, BEFORE)}
    found = in_turn(jobs, repetitions)
    figures: list[Figure] = []
    for name, (title, unit) in ROBOT_FIGURES.items():
        if all(name in report for reports in found.values() for report in reports):
            costs = {one: [report[name] for report in reports] for one, reports in found.items()}
            figures += compared(title, unit, costs)
    return figures


def robot_cost(folder: Path, seconds: float) -> dict[str, float]:
    """Return the figures of a commit's own `bench robot` by name.

    On a busy machine its robot may disarm itself, which ends the benchmarks of older commits: they
    are tried again. Raises RuntimeError with the last error.
    """
    package = "checks" if (folder / "checks" / "__main__.py").exists() else "benchmarks"
    options = ("--hours", "0", "--repetitions", "1", "--seconds", str(seconds), "--json")
    errors = ""
    for _ in range(ATTEMPTS):
        done = subprocess.run(
            [sys.executable, "-P", "-m", package, "robot", *options],
            cwd=folder,
            env=environment(folder),
            capture_output=True,
            text=True,
            check=False,
        )
        if done.stdout.startswith("{"):
            report = json.loads(done.stdout)
            return {figure["name"]: figure["median"] for figure in report["figures"]}
        errors = done.stderr.strip().rpartition("\n")[2]
    raise RuntimeError(f"{package} robot, {ATTEMPTS} times: {errors}")


def instruction_figures(folders: Mapping[str, Path]) -> Iterator[Figure]:
    """Yield the machine instructions of a tick, and their ratios."""
    for navigator in TRIALS:
        counts = {name: [instructions(folder, navigator) / 1e3] for name, folder in folders.items()}
        yield from compared(f"instructions, {navigator}", "k/tick", counts)


def instructions(folder: Path, navigator: str) -> float:
    """Return the machine instructions of a tick: those of a third trial in a process."""
    ticks, two = cachegrind(folder, navigator, 2)
    _, three = cachegrind(folder, navigator, 3)
    return (three - two) / ticks


def cachegrind(folder: Path, navigator: str, trials: int) -> tuple[int, int]:
    """Return the ticks of a trial, and the instructions of a process that runs some of them."""
    options = ("--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null")
    done = subprocess.run(
        ["valgrind", *options, sys.executable, "-P", SCRIPT, WORLD, navigator, str(trials)],
        cwd=folder,
        env={**environment(folder), **EXACT},
        capture_output=True,
        text=True,
        check=True,
    )
    line = next(line for line in done.stderr.splitlines() if "refs:" in line)
    return int(done.stdout), int(line.rpartition(":")[2].replace(",", ""))
