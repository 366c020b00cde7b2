"""`sidestep falsify`: search for worlds in which a navigator violates what is stated about it."""

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from importlib.util import find_spec
from os import cpu_count
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from plant.corpus.generate import ADVERSARIAL_FAMILIES
from plant.model.configuration import LEVELS
from protocol.navigators import NAVIGATORS, is_own
from protocol.options import above_zero, whole
from robot.own_navigator import load
from runtime.cli.parsers import new_parser
from runtime.errors import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, UserError
from study.cli.study import INSTALL, NEEDED
from study.falsify.climb import VARIED
from study.falsify.properties import DETOUR, LETTERS, PROPERTIES
from study.trial.trial import SIDES

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from study.falsify.findings import Finding
    from study.falsify.search import Search

EXIT_FOUND: Final = EXIT_FAILURE
OUTPUT: Final = "findings"
USUAL_S: Final = 600.0
MAX_UNITS: Final = 1e6
MIN_DETOUR: Final = 1.0
DETAILS: Final = "\n".join(
    (
        "properties:",
        *(f"  {one.letter}  {one.states}" for one in PROPERTIES),
        "",
        "Give the same command again to continue. Exit code 1: failures were found.",
    )
)


def main(argv: Sequence[str]) -> int:
    """Return 0 without a finding, 1 with findings, 130 when interrupted, 2 for wrong usage.

    Raises UserError or WorldError for a search that cannot be run.
    """
    if find_spec(NEEDED) is None:
        raise UserError(f"{NEEDED} missing; {INSTALL}")
    options = parser().parse_args(list(argv))
    if options.starts and not options.replay:
        raise UserError("--starts: only with --replay; add --replay and files of findings")
    return replay(options) if options.replay else search(options)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("falsify", details=DETAILS)
    names = ", ".join(NAVIGATORS)
    told = f"one of {names}, or a file such as my_nav.py; the side is left by default"
    made.add_argument("navigator", metavar="NAVIGATOR[:SIDE]", help=told)
    made.add_argument(
        "--properties",
        type=_letters,
        default=LETTERS,
        metavar="LETTERS",
        help=f"properties to violate, as listed below (default {LETTERS})",
    )
    made.add_argument("--noise", choices=tuple(LEVELS), default="none", help="default none")
    made.add_argument(
        "--families",
        nargs="+",
        choices=ADVERSARIAL_FAMILIES,
        metavar="F",
        default=list(ADVERSARIAL_FAMILIES),
        help=f"families of worlds (all: {' '.join(ADVERSARIAL_FAMILIES)})",
    )
    made.add_argument(
        "--vary",
        nargs="*",
        choices=VARIED,
        default=["robots"],
        help="parts that vary besides the walls (default robots)",
    )
    made.add_argument(
        "--detour",
        type=_detour,
        default=DETOUR,
        metavar="K",
        help=f"longest way for property e, as a multiple of the shortest (default {DETOUR:g})",
    )
    _add_how(made)
    return made


def _add_how(made: argparse.ArgumentParser) -> None:
    span = above_zero(MAX_UNITS)
    usual = f"time to search; the three add up (default {USUAL_S / 60.0:g} minutes)"
    for name, unit in (("hours", "H"), ("minutes", "M"), ("seconds", "S")):
        made.add_argument(f"--{name}", type=span, default=0.0, metavar=unit, help=usual)
    made.add_argument(
        "--trials", type=whole(1), metavar="N", help="end after N trials; no time is set by default"
    )
    made.add_argument(
        "--jobs",
        type=whole(1),
        default=cpu_count() or 1,
        help="processes (default all cores); without effect with --dask",
    )
    made.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="run on all threads of this Dask cluster, as in tcp://10.0.0.5:8786",
    )
    made.add_argument("--seed", type=whole(0), default=1, help="of the search (default 1)")
    made.add_argument(
        "--output", type=Path, default=Path(OUTPUT), metavar="DIR", help=f"default {OUTPUT}"
    )
    made.add_argument(
        "--replay",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="run the trials of these findings, or of directories of them, with this navigator",
    )
    made.add_argument(
        "--starts",
        type=whole(1),
        metavar="N",
        help="with --replay: repeat each trial N times, from near starts and with other seeds",
    )
    made.add_argument("--json", action="store_true", help="print one JSON object")


def _letters(text: str) -> str:
    unknown = sorted(set(text) - set(LETTERS))
    if unknown or not text:
        raise argparse.ArgumentTypeError(f"{text!r}: use letters of {LETTERS}")
    return "".join(sorted(set(text)))


def _detour(text: str) -> float:
    value = float(text)
    if not MIN_DETOUR < value <= MAX_UNITS:
        raise argparse.ArgumentTypeError(f"{text} is not above {MIN_DETOUR:g}")
    return value


def search(options: argparse.Namespace) -> int:
    """Run a search and print its findings."""
    # Slow imports: pyarrow, and drawing.
    from study.cli.study_run import interrupted_by_signals
    from study.falsify.climb import SearchSettings
    from study.falsify.findings import open_search, settings_json
    from study.falsify.search import Search, SearchBudget, SearchLine
    from study.runner.rows import code
    from study.runner.workers import workers

    settings = SearchSettings(
        subject=_subject(options),
        properties=options.properties,
        families=tuple(dict.fromkeys(options.families)),
        varied=tuple(dict.fromkeys(options.vary)),
        seed=options.seed,
    )
    span_s = 3600.0 * options.hours + 60.0 * options.minutes + options.seconds
    budget = SearchBudget(
        span_s=None if options.trials and not span_s else span_s or USUAL_S, trials=options.trials
    )
    directory: Path = options.output
    with (
        open_search(directory, settings_json(settings, code().digest)) as progress,
        interrupted_by_signals(),
    ):
        running = Search(settings, directory, progress, monotonic)
        line = SearchLine(running, budget, sys.stderr, monotonic)
        try:
            with workers(options.jobs, options.dask) as pool:
                for _ in running.run(pool, budget):
                    line.show_if_due()
        except KeyboardInterrupt:
            return _interrupted(running, line, directory)
        running.save()
        line.close()
        return _summary(running, directory, as_json=options.json)


def _subject(options: argparse.Namespace) -> Any:
    from study.falsify.evaluate import Subject
    from study.runner.plan import navigator_of, split_side

    try:
        name, side = split_side(navigator_of(options.navigator))
    except UserError as error:
        raise UserError(str(error).removeprefix("--navigators").lstrip(": ")) from None
    assert side in SIDES
    if is_own(name):
        load(name)
    return Subject(navigator=name, side=side, noise=options.noise, detour=options.detour)


def _interrupted(running: "Search", line: Any, directory: Path) -> int:
    running.save()
    line.close()
    print(
        f"sidestep falsify: stopped; findings are in {directory}. To continue, give the same "
        "command again.",
        file=sys.stderr,
    )
    return EXIT_INTERRUPTED


def _summary(running: "Search", directory: Path, *, as_json: bool) -> int:
    progress = running.progress
    if as_json:
        classes = {
            name: {
                "seen": one.seen,
                "walls": one.walls,
                "after_s": round(one.after_s, 1),
                "sentence": one.sentence,
            }
            for name, one in sorted(progress.classes.items())
        }
        values = {
            "verb": "falsify",
            "trials": progress.trials,
            "climbs": progress.climbs,
            "simulated_h": round(progress.simulated_s / 3600.0, 3),
            "spent_s": round(progress.spent_s, 1),
            "output": str(directory),
            "classes": classes,
        }
        print(json.dumps(values))
    else:
        for name, one in sorted(progress.classes.items(), key=lambda item: -item[1].seen):
            print(f"{name}: seen {one.seen}, {one.walls} walls: {one.sentence}")
        found = len(progress.classes)
        print(f"classes of failure: {found} in {progress.trials} trials, in {directory}")
    return EXIT_FOUND if progress.classes else EXIT_OK


def replay(options: argparse.Namespace) -> int:
    """Run the trials of stored findings with a navigator; return 1 if one still violates."""
    from study.falsify.findings import read_finding
    from study.runner.workers import workers

    subject = _subject(options)
    still = 0
    many = workers(options.jobs, options.dask) if options.starts else nullcontext(None)
    with many as pool:
        for file in files_of(options.replay):
            stored = read_finding(file)
            tried = replace(subject, noise=stored.subject.noise, detour=stored.subject.detour)
            one = replace(stored, subject=tried)
            violates, seen = (
                _from_near_starts(one, options.starts, pool.executor) if pool else _once(one)
            )
            still += violates
            print(f"{'violates' if violates else 'holds'} {one.letter} {file}: {seen}", flush=True)
    return EXIT_FOUND if still else EXIT_OK


def _once(finding: "Finding") -> tuple[bool, str]:
    """Return whether the finding violates its property, and how its trial ends."""
    result = finding.replay()
    return finding.letter in result.violated, result.kind


def _from_near_starts(finding: "Finding", count: int, executor: "Executor") -> tuple[bool, str]:
    """Return whether a drive from a start near it violates the property, and how many do."""
    from study.falsify.findings import near, violates

    failed = sum(executor.map(violates, near(finding, count)))
    return failed > 0, f"violated in {failed} of {count} drives"


def files_of(places: Sequence[Path]) -> list[Path]:
    """Return the files of findings; raise UserError for a directory without one."""
    found: list[Path] = []
    for place in places:
        below = sorted(place.glob("*.toml")) if place.is_dir() else [place]
        if not below:
            raise UserError(f"--replay {place}: no .toml file in this directory")
        found += below
    return found
