"""One call of `sidestep study`: what is asked, what is there already, the rest run, the end."""

import argparse
import json
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from shlex import join
from time import monotonic
from typing import Any, Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from robot.parameters.table import OutOfRange, Unknown
from runtime.errors import UserError
from study.cli.study_options import QUICK_PAPER_SEEDS, output_of, parser, wanted_of
from study.cli.study_options import settings_of as settings_asked
from study.runner import on_dask
from study.runner.conduct import Collector, collect, finish, finished, open_tasks, recover
from study.runner.plan import StudySettings, TrialTask, tasks_of
from study.runner.pool import Pool
from study.runner.progress import StudyProgress
from study.runner.provenance import code, machine
from study.runner.rows import FAILED
from study.runner.run_task import StudyContext, trial_of
from study.runner.sources import ListedWorld, keep, listed
from study.runner.store import commands_of
from study.runner.study_settings import alone, settings_of, settle
from study.trial.trial import params_of

EXIT_INTERRUPTED: Final = 130


class Study(NamedTuple):
    """Everything that is settled before anything runs."""

    directory: Path
    worlds: list[ListedWorld]
    settings: StudySettings
    tasks: list[TrialTask]
    context: StudyContext
    command: str


def run(argv: Sequence[str]) -> int:
    """Raises UserError or WorldError, before anything has run, for what cannot be done."""
    options = parser().parse_args(argv)
    study = prepare(options, argv)
    with alone(study.directory), ended_by_signals():
        for line in tidied(study, options.mixed):
            print(f"sidestep study: {line}", file=sys.stderr)
        there = finished(study.directory)
        tasks = open_tasks(study.tasks, there)
        progress = StudyProgress(
            len(study.tasks), len(study.tasks) - len(tasks), sys.stderr, monotonic
        )
        try:
            work(study, options, tasks, progress)
            summary = conclude(study, progress)
            if not options.no_report:
                report(study.directory, jobs=options.jobs, quick=options.quick)
        except KeyboardInterrupt:
            return interrupted(study, progress)
        print(json.dumps(summary) if options.json else in_words(summary))
        return 1 if FAILED in summary["outcomes"] else 0


def prepare(options: argparse.Namespace, argv: Sequence[str]) -> Study:
    settings = settings_asked(options)
    worlds = listed(wanted_of(options))
    made_by, directory = code(), output_of(options)
    context = StudyContext(
        study=directory.resolve().name, code=made_by, worlds=[one.world for one in worlds]
    )
    tasks = tasks_of(worlds, settings, made_by.version)
    _check_parameters(tasks, context)
    return Study(directory, worlds, settings, tasks, context, join(["sidestep", "study", *argv]))


def _check_parameters(tasks: list[TrialTask], context: StudyContext) -> None:
    """Raises UserError: what the robot refuses in one trial of a world it refuses in all."""
    for task in {task.place: task for task in tasks}.values():
        try:
            params_of(trial_of(task, context.worlds[task.place]))
        except (Unknown, OutOfRange) as error:
            name = context.worlds[task.place].name
            raise UserError(f"--param or the [robot] of world {name}: {error}") from None


def tidied(study: Study, mixed: bool) -> Iterator[str]:
    """The directory as it must be to begin or to go on; says what was out of order."""
    made_by = study.context.code
    stored = settings_of(study.worlds, study.settings, made_by, machine())
    differing = settle(study.directory, stored, made_by, mixed=mixed)
    if differing:
        yield f"--mixed: going on although {'; '.join(differing)}"
    keep(study.worlds, study.directory)
    yield from recover(study.directory)


def work(
    study: Study, options: argparse.Namespace, tasks: list[TrialTask], progress: StudyProgress
) -> None:
    """Run what is open, on the cluster or in processes of our own."""
    if not tasks:
        return
    collector = Collector(study.directory, monotonic)
    if options.dask is not None:
        with on_dask.cluster(options.dask) as client:
            collect(on_dask.run(client, study.context, tasks), collector, progress)
        return
    with Pool(min(options.jobs, len(tasks)), study.context) as pool:
        collect(pool.run(tasks), collector, progress)


def interrupted(study: Study, progress: StudyProgress) -> int:
    done = progress.before + progress.now
    print(
        f"sidestep study: stopped; {done} of {progress.total} trials are in {study.directory}. "
        f"To go on, the same again:\n  {study.command}",
        file=sys.stderr,
    )
    return EXIT_INTERRUPTED


def conclude(study: Study, progress: StudyProgress) -> dict[str, Any]:
    """All results in one file; what they come to."""
    stored = settings_of(study.worlds, study.settings, study.context.code, machine())
    earlier = commands_of(study.directory).splitlines()
    provenance = {
        "command": "\n".join([*(one for one in earlier if one != study.command), study.command]),
        "settings": json.dumps(stored),
        "commit": study.context.code.commit,
        "dirty": json.dumps(study.context.code.dirty),
    }
    results = finish(study.directory, provenance)
    table = finished(study.directory)
    assert table is not None
    return summary_of(study, table, results, progress)


def report(directory: Path, *, jobs: int, quick: bool) -> None:
    from study.report import cli  # draws, which takes long to import
    from study.report.paper import runs  # draws, which takes long to import

    paper_seeds = QUICK_PAPER_SEEDS if quick else runs.SEEDS
    file, *_ = cli.report(directory, directory, jobs=jobs, paper_seeds=paper_seeds)
    print(f"sidestep study: {file}", file=sys.stderr)


def in_words(summary: dict[str, Any]) -> str:
    ends = ", ".join(f"{number} {name}" for name, number in summary["outcomes"].items())
    return f"{summary['results']}: {summary['trials']} trials: {ends}"


def summary_of(
    study: Study, table: pa.Table, results: Path, progress: StudyProgress
) -> dict[str, Any]:
    """Of all that is in the results, and how fast this call was. A trial's CPU time is told too:
    unlike its pace it does not say how busy the machine was with other things."""
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
def ended_by_signals() -> Iterator[None]:
    """SIGTERM ends a study as Ctrl-C does."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
