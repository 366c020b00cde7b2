"""One call of `sidestep study`: prepare, run the missing trials, write results and report."""

import argparse
import json
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import cpu_count
from pathlib import Path
from shlex import join
from time import monotonic
from typing import Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from plant.cli import PER_FAMILY
from plant.model.configuration import LEVELS
from protocol.options import add_param_option, whole
from robot.own_navigator import load
from robot.parameter_table import OutOfRangeError, UnknownParameterError
from runtime.cli.parsers import new_parser
from runtime.errors import EXIT_INTERRUPTED, UserError
from study.cli.trial import seconds
from study.runner import workers
from study.runner.conduct import (
    Collector,
    StudyProgress,
    collect,
    finish,
    missing_tasks,
    recover,
    stored_rows,
)
from study.runner.plan import (
    CORPUS,
    DETOUR_FACTOR,
    EVERY_NAVIGATOR,
    FIXED,
    MIN_TIMEOUT_S,
    UNREACHABLE_TIMEOUT_S,
    ListedWorld,
    StudySettings,
    TrialTask,
    WorldSelection,
    listed,
    navigator_of,
    noise_of,
    tasks_of,
)
from study.runner.rows import FAILED, code, machine
from study.runner.run_task import StudyContext, trial_of
from study.runner.store import check_settings, commands_of, exclusive, keep, settings_of
from study.runner.workers import Pool
from study.trial.trial import params_of

OUTPUT: Final = "study-results"
QUICK_OUTPUT: Final = "study-quick"
QUICK_NOISE: Final = ("none", "default")
CORPUS_SEED: Final = 1

DETAILS: Final = (
    "Runs navigators x worlds x noise levels x seeds and writes results.parquet and a report.\n"
    "Give the same command again to continue an interrupted study. `sidestep study report DIR`\n"
    "writes the report again."
)


def parser() -> argparse.ArgumentParser:
    """Return the parser of `sidestep study`."""
    made = new_parser("study", details=DETAILS)
    made.add_argument(
        "--quick",
        action="store_true",
        help="the committed worlds, all navigators, noise none and default: a few minutes",
    )
    _add_worlds(made)
    _add_what(made)
    _add_how(made)
    return made


def _add_worlds(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--worlds",
        nargs="+",
        metavar="WHERE",
        help=f"{CORPUS} (generated), {FIXED} (committed), shipped, names of shipped worlds, .toml"
        f" files, or directories of .toml files; {CORPUS} by default",
    )
    made.add_argument("--families", nargs="+", metavar="F", help="only worlds of these families")
    made.add_argument(
        "--per-family",
        type=whole(1),
        default=PER_FAMILY,
        metavar="N",
        help=f"worlds generated of each family (default {PER_FAMILY})",
    )
    made.add_argument(
        "--corpus-seed",
        type=whole(0),
        default=CORPUS_SEED,
        help=f"for generated worlds (default {CORPUS_SEED})",
    )


def _add_what(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--navigators",
        nargs="+",
        metavar="NAME[:SIDE]",
        help=f"navigators to run, also files of your own such as my_nav.py"
        f" ({' '.join(EVERY_NAVIGATOR)})",
    )
    made.add_argument(
        "--seeds",
        type=whole(1),
        metavar="N",
        help="runs of each trial with different noise (1); one run without noise",
    )
    made.add_argument(
        "--noise", nargs="+", metavar="LEVEL", help=f"noise levels to run (all: {' '.join(LEVELS)})"
    )
    made.add_argument(
        "--timeout",
        type=seconds,
        metavar="S",
        help=f"simulated time; by default for {DETOUR_FACTOR:g} times the shortest path,"
        f" at least {MIN_TIMEOUT_S:g} s, and {UNREACHABLE_TIMEOUT_S:g} s where there is no path",
    )
    add_param_option(made)
    made.add_argument(
        "--uncalibrated", action="store_true", help="do not calibrate robots for their noise"
    )


def _add_how(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--jobs", type=whole(1), default=cpu_count() or 1, help="processes (default all cores)"
    )
    made.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="run on the Dask cluster of this scheduler, as in tcp://10.0.0.5:8786",
    )
    made.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help=f"{OUTPUT}, or {QUICK_OUTPUT} with --quick",
    )
    made.add_argument(
        "--mixed", action="store_true", help="continue even if settings or code have changed"
    )
    made.add_argument("--no-report", action="store_true", help="write results only")
    made.add_argument("--json", action="store_true", help="print one JSON object")


def selection_of(options: argparse.Namespace) -> WorldSelection:
    """Return the worlds that the options select."""
    places = options.worlds or ([FIXED] if options.quick else [CORPUS])
    return WorldSelection(places, options.families, options.per_family, options.corpus_seed)


def study_settings(options: argparse.Namespace) -> StudySettings:
    """Return the settings; raise UserError for an unknown navigator or noise level."""
    navigators = [navigator_of(text) for text in options.navigators or EVERY_NAVIGATOR]
    levels = options.noise or (QUICK_NOISE if options.quick else LEVELS)
    noise = [noise_of(text) for text in levels]
    return StudySettings(
        navigators=tuple(dict.fromkeys(navigators)),
        noise=tuple(dict.fromkeys(noise)),
        seeds=options.seeds or 1,
        timeout_s=options.timeout,
        parameters=dict(options.param),
        calibrated=not options.uncalibrated,
    )


def output_of(options: argparse.Namespace) -> Path:
    """Return the study's directory."""
    given: Path | None = options.output
    return given or Path(QUICK_OUTPUT if options.quick else OUTPUT)


class PreparedStudy(NamedTuple):
    """A study that is ready to run."""

    directory: Path
    worlds: list[ListedWorld]
    settings: StudySettings
    tasks: list[TrialTask]
    context: StudyContext
    command: str


def run(argv: Sequence[str]) -> int:
    """Run a study; raise UserError or WorldError before any trial if it cannot be run."""
    options = parser().parse_args(argv)
    study = prepare(options, argv)
    with exclusive(study.directory), interrupted_by_signals():
        for line in prepare_directory(study, options.mixed):
            print(f"sidestep study: {line}", file=sys.stderr)
        stored = stored_rows(study.directory)
        tasks = missing_tasks(study.tasks, stored)
        progress = StudyProgress(
            len(study.tasks), len(study.tasks) - len(tasks), sys.stderr, monotonic
        )
        try:
            run_tasks(study, tasks, progress, jobs=options.jobs, dask=options.dask)
            summary = write_results(study, progress)
            if not options.no_report:
                write_report(study.directory, jobs=options.jobs)
        except KeyboardInterrupt:
            return print_interruption(study, progress)
        print(json.dumps(summary) if options.json else as_text(summary))
        return 1 if FAILED in summary["outcomes"] else 0


def prepare(options: argparse.Namespace, argv: Sequence[str]) -> PreparedStudy:
    """Resolve the options to worlds, settings and tasks.

    Raises UserError or WorldError for what cannot be used.
    """
    settings = study_settings(options)
    worlds = listed(selection_of(options))
    code_version, directory = code(), output_of(options)
    context = StudyContext(
        study=directory.resolve().name,
        code=code_version,
        worlds=[one.world for one in worlds],
        own=settings.own(),
    )
    tasks = tasks_of(worlds, settings, code_version.version)
    _check_parameters(tasks, context)
    return PreparedStudy(
        directory, worlds, settings, tasks, context, join(["sidestep", "study", *argv])
    )


def _check_parameters(tasks: list[TrialTask], context: StudyContext) -> None:
    """Raise UserError for a navigator that cannot be loaded, or a parameter that a robot rejects.

    For parameters one trial per world is enough.
    """
    for file in context.own.values():
        load(file.reference)
    for task in {task.place: task for task in tasks}.values():
        try:
            params_of(trial_of(task, context.worlds[task.place], context.own))
        except (UnknownParameterError, OutOfRangeError) as error:
            name = context.worlds[task.place].name
            raise UserError(f"--param or the [robot] of world {name}: {error}") from None


def prepare_directory(study: PreparedStudy, mixed: bool) -> Iterator[str]:
    """Store settings and worlds, repair an interrupted study; yield what was out of order."""
    code_version = study.context.code
    stored = settings_of(study.worlds, study.settings, code_version, machine())
    differing = check_settings(study.directory, stored, code_version, mixed=mixed)
    if differing:
        yield f"--mixed: continuing although {'; '.join(differing)}"
    keep(study.worlds, study.directory)
    yield from recover(study.directory)


def run_tasks(
    study: PreparedStudy,
    tasks: list[TrialTask],
    progress: StudyProgress,
    *,
    jobs: int,
    dask: str | None = None,
) -> None:
    """Run the tasks on the cluster or in local worker processes."""
    if not tasks:
        return
    collector = Collector(study.directory, monotonic)
    if dask is not None:
        with workers.cluster(dask) as client:
            collect(workers.run_on_cluster(client, study.context, tasks), collector, progress)
        return
    with Pool(min(jobs, len(tasks)), study.context) as pool:
        collect(pool.run(tasks), collector, progress)


def print_interruption(study: PreparedStudy, progress: StudyProgress) -> int:
    """Print how to continue; return the exit code."""
    done = progress.before + progress.now
    print(
        f"sidestep study: stopped; {done} of {progress.total} trials are in {study.directory}. "
        f"To continue, give the same command again:\n  {study.command}",
        file=sys.stderr,
    )
    return EXIT_INTERRUPTED


def write_results(study: PreparedStudy, progress: StudyProgress) -> dict[str, Any]:
    """Merge all results into one file and return their summary."""
    stored = settings_of(study.worlds, study.settings, study.context.code, machine())
    earlier = commands_of(study.directory).splitlines()
    provenance = {
        "command": "\n".join([*(one for one in earlier if one != study.command), study.command]),
        "settings": json.dumps(stored),
        "commit": study.context.code.commit,
        "dirty": json.dumps(study.context.code.dirty),
    }
    results = finish(study.directory, provenance)
    table = stored_rows(study.directory)
    assert table is not None
    return summary_of(study, table, results, progress)


def write_report(directory: Path, *, jobs: int) -> None:
    """Write the report of the study and print its place."""
    from study.cli import report  # slow import: drawing

    file, *_ = report.report(directory, directory, jobs=jobs)
    print(f"sidestep study: {file}", file=sys.stderr)


def as_text(summary: dict[str, Any]) -> str:
    """Return the summary as a line of text."""
    ends = ", ".join(f"{number} {name}" for name, number in summary["outcomes"].items())
    return f"{summary['results']}: {summary['trials']} trials: {ends}"


def summary_of(
    study: PreparedStudy, table: pa.Table, results: Path, progress: StudyProgress
) -> dict[str, Any]:
    """Summarise all stored results and the speed of this call.

    The CPU time of the trials is included: unlike their pace it does not depend on other load.
    """
    driven = table.filter(pc.field("outcome") != FAILED)
    cpu_s, driven_s = (pc.sum(driven[name]).as_py() or 0.0 for name in ("cpu_s", "time_s"))
    counted = table.group_by("outcome").aggregate([("outcome", "count")]).to_pylist()
    outcomes = {one["outcome"]: one["outcome_count"] for one in counted}
    return {
        "study": study.context.study,
        "results": str(results),
        "trials": table.num_rows,
        "run_now": progress.now,
        "outcomes": dict(sorted(outcomes.items(), key=lambda one: -one[1])),
        "worlds": len(study.worlds),
        "simulated_h": round(progress.simulated_s / 3600.0, 3),
        "wall_s": round(progress.elapsed_s, 1),
        "simulated_h_per_min": round(progress.hours_per_minute, 2),
        "cpu_s_per_simulated_h": round(3600.0 * cpu_s / driven_s, 2) if driven_s else None,
    }


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Interrupt the study on SIGTERM as on Ctrl-C."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
