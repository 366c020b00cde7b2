"""`sidestep study report DIR`: write the report of a study.

It is an HTML page, Markdown with its figures, the summary as data, and the comparison in the
README, between two markers.
"""

import argparse
import csv
import io
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from os import cpu_count
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from protocol.options import whole
from runtime.cli.parsers import new_subcommand_parser
from runtime.errors import UserError
from study.intervals import CONFIDENT
from study.report.build import ReportRequest, page_of
from study.report.drives import SEEDS, run_paper
from study.report.evidence import read_evidence
from study.report.gallery import PER_NAVIGATOR
from study.report.page import (
    DASH,
    PageTable,
    count_text,
    figures_of,
    html_of,
    markdown_of,
    numbered,
    table_lines,
    with_text,
)
from study.report.paper import Claim, claims
from study.report.summary import HEAD, as_json, numbers, summaries
from study.report.targets import OWN
from study.report.trials import NOISES, PLANNER, apart_of, distinct, main_of, trials_of
from study.runner.plan import world_of
from study.runner.store import commands_of, own_of, read

FIGURES: Final = "figures"
SUMMARY: Final = "summary.json"


def write_files(
    table: pa.Table, directory: Path, request: ReportRequest | None = None
) -> list[Path]:
    """Write all files of the report; equal tables give equal bytes.

    Raises UserError for a table of another version and a directory that cannot be written.
    """
    request = request or ReportRequest()
    page = numbered(page_of(table, request))
    summary = summary_of(table, request)
    trials = main_of(distinct(trials_of(table)))
    texts = {
        "report.html": html_of(page),
        "report.md": markdown_of(page, FIGURES),
        SUMMARY: json.dumps(summary, indent=1, ensure_ascii=False) + "\n",
        "summary.csv": _csv([numbers(one) for one in summaries(trials)]),
    }
    for figure in figures_of(page.sections):
        texts[f"{FIGURES}/{figure.name}.svg"] = figure.drawing.alone()
    try:
        (directory / FIGURES).mkdir(parents=True, exist_ok=True)
        for old in (directory / FIGURES).glob("*.svg"):
            if f"{FIGURES}/{old.name}" not in texts:
                old.unlink()
        for name, text in texts.items():
            (directory / name).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise UserError(f"{error.filename or directory}: {error.strerror}") from None
    return [directory / name for name in texts]


def summary_of(table: pa.Table, request: ReportRequest) -> dict[str, Any]:
    """Return the summary that is committed, from which the README is generated.

    Its rows and counts are of the corpus; other groups of worlds are in `rows_apart`. `clustered`:
    the intervals allow for several trials in one world.
    """
    every = trials_of(table)
    whole, counted = distinct(every), main_of(every)
    trials = main_of(whole)
    apart = apart_of(whole)
    return {
        "command": request.command,
        "commits": [commit for commit in every.values("commit") if commit],
        "trials": len(counted),
        "worlds": counted.worlds,
        "families": len(counted.values("family")),
        "clustered": True,
        "rows": as_json(summaries(trials)),
        "rows_apart": {group: as_json(summaries(some)) for group, some in apart.items()},
        "figures_to_reach": [asdict(target) for target in request.targets(whole)],
        "claims": [_claim(claim) for claim in claims(trials, request.runs)]
        if request.runs.figures
        else [],
    }


def _claim(claim: Claim) -> dict[str, str]:
    fields = asdict(claim)
    return {"says": fields.pop("statement"), **fields}


def _csv(rows: Sequence[Mapping[str, object]]) -> str:
    """Return rows as CSV, empty where a value is unknown; nothing without rows."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else (), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


BEGIN: Final = "<!-- study:begin -->"
END: Final = "<!-- study:end -->"
DEFAULT_NOISE: Final = "default"
NAVIGATOR, NOISE, WORLDS, TRIALS, SUCCESS = "navigator", "noise", "worlds", "trials", "success %"
HARSH: Final = "harsh"
REST: Final = (
    *((DEFAULT_NOISE, name) for name in ("touched something %", "path / shortest, median (90th)")),
    (DEFAULT_NOISE, "true error m, median / 95th"),
    *((noise, "unreachable recognised %") for noise in (DEFAULT_NOISE, HARSH)),
    *((noise, "reached without a way %") for noise in (DEFAULT_NOISE, HARSH)),
    *((noise, "wrongly called %") for noise in (DEFAULT_NOISE, HARSH)),
)
"""What the README shows besides the success, at the noise levels that the study has."""

assert {NAVIGATOR, NOISE, WORLDS, TRIALS, SUCCESS, *(name for _, name in REST)} <= set(HEAD)

Rows = Sequence[Mapping[str, Any]]


def lines_of(rows: Rows) -> str:
    """Return two Markdown tables of the navigators: success at each noise level, and the rest.

    A value that the summary does not have, because an older version wrote it, has no column.
    """
    noises = [noise for noise in NOISES if any(row[NOISE] == noise for row in rows)]
    noises += sorted({str(row[NOISE]) for row in rows} - set(NOISES))
    rest = [pair for pair in REST if any(row[NOISE] == pair[0] and pair[1] in row for row in rows)]
    successes, others = [], []
    labels = dict.fromkeys(str(row[NAVIGATOR]) for row in rows)
    for label in (one for one in labels if one != PLANNER):
        at = {str(row[NOISE]): row for row in rows if row[NAVIGATOR] == label}
        counts = (span(at.values(), name) for name in (WORLDS, TRIALS))
        successes.append((label, *counts, *(cell(at, noise, SUCCESS) for noise in noises)))
        others.append((label, *(cell(at, noise, name) for noise, name in rest)))
    head = (NAVIGATOR, WORLDS, TRIALS, *(f"{SUCCESS}, {noise}" for noise in noises))
    rest_head = (NAVIGATOR, *(f"{name}, {noise}" for noise, name in rest))
    tables = (head, successes), (rest_head, others)
    return "\n\n".join(table_lines(PageTable("", head, tuple(rows))) for head, rows in tables)


def cell(at: Mapping[str, Mapping[str, Any]], noise: str, name: str) -> str:
    """Return a value at a noise level, a dash where there is none."""
    return str(at[noise].get(name, DASH)) if noise in at else DASH


def span(rows: Iterable[Mapping[str, Any]], name: str) -> str:
    """Return the least and the largest count of the rows of a navigator, at its noise levels."""
    counts = sorted({int(str(row[name]).replace(",", "")) for row in rows})
    return " to ".join(map(count_text, dict.fromkeys((counts[0], counts[-1]))))


def lines_apart(apart: Mapping[str, Rows]) -> str:
    """Return a Markdown row for each group of hard worlds and noise level, of the own navigator."""
    head = ("hard worlds", NOISE, WORLDS, TRIALS, f"{SUCCESS}, {OWN}", "touched something %")
    body = tuple(
        (group, *(str(row[name]) for name in (NOISE, WORLDS, TRIALS, SUCCESS, head[-1])))
        for group, rows in apart.items()
        for row in rows
        if row[NAVIGATOR] == OWN
    )
    return table_lines(PageTable("", head, body, names=2)) if body else ""


def block(summary: Mapping[str, Any]) -> str:
    """Return the text between the markers."""
    intervals = (
        "clustered by world"
        if summary.get("clustered")
        else "which count several seeds of one world as independent, so that they are too narrow"
    )
    note = (
        f"{summary['trials']:,} trials in {summary['worlds']:,} worlds of {summary['families']} "
        f"families; worlds and trials are those at one noise level.\nIn brackets {CONFIDENT} "
        f"intervals, {intervals}.\nSuccess: reached the goal by its own estimate and touched "
        "nothing, in worlds with a path.\nRecognised: reported `unreachable` in worlds without "
        "one; wrongly called: in worlds with one."
    )
    apart = lines_apart(summary["rows_apart"])
    return "\n\n".join(part for part in (lines_of(summary["rows"]), note, apart) if part)


def with_block(readme: str, text: str, file: str = "README.md") -> str:
    """Return the README with this text between its markers; UserError without markers."""
    try:
        return with_text(readme, BEGIN, END, f"\n\n{text}\n\n")
    except ValueError as error:
        raise UserError(f"{file}: {error}") from None


def update_readme(readme: Path, summary: Path) -> None:
    """Update the README from a summary; raise UserError when a file cannot be used."""
    try:
        found = json.loads(summary.read_text(encoding="utf-8"))
        text = with_block(readme.read_text(encoding="utf-8"), block(found), str(readme))
        readme.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{error.filename}: {error.strerror}") from None


MAX_FAILURES: Final = 50
MAX_JOBS: Final = 1000
MAX_SEEDS: Final = 1000


def main(argv: Sequence[str]) -> int:
    """Return 0, or 2 for wrong usage (argparse); raise UserError for unusable files."""
    options = parser().parse_args(argv)
    output = options.output or options.study
    files = report(
        options.study,
        output,
        failures=options.failures,
        jobs=options.jobs,
        paper_seeds=options.paper_seeds,
        evidence=options.evidence,
    )
    if options.readme is not None:
        update_readme(options.readme, output / SUMMARY)
    print(files[0])
    return 0


def report(
    study: Path,
    output: Path,
    *,
    failures: int = PER_NAVIGATOR,
    jobs: int = 1,
    paper_seeds: int = 0,
    evidence: Path | None = None,
) -> list[Path]:
    """Write the report of a study, finished or not; return the files written.

    With `evidence`, the directory with the figures of other tools, the project's own navigator is
    judged by its figures to reach.
    """
    table, found = read(study), None if evidence is None else read_evidence(evidence)
    if paper_seeds:
        print("sidestep study report: running the paper's figures", file=sys.stderr)
    request = ReportRequest(
        command=commands_of(study),
        runs=run_paper(jobs, paper_seeds),
        world_of=partial(world_of, directory=study),
        failures=failures,
        jobs=jobs,
        evidence=found,
        own=own_of(study),
    )
    return write_files(table, output, request)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_subcommand_parser("study", "report")
    made.add_argument("study", type=Path, metavar="DIR", help="the study's directory")
    made.add_argument("--output", type=Path, metavar="DIR", help="for the report (default DIR)")
    made.add_argument("--readme", type=Path, metavar="FILE", help="also update the table in it")
    made.add_argument(
        "--evidence",
        type=Path,
        metavar="DIR",
        help="also judge the project's own navigator by its figures to reach; those of other tools"
        " are read from the JSON files in it",
    )
    made.add_argument(
        "--failures",
        type=whole(0, MAX_FAILURES),
        default=PER_NAVIGATOR,
        metavar="N",
        help=f"failures drawn per navigator (default {PER_NAVIGATOR})",
    )
    made.add_argument(
        "--jobs",
        type=whole(1, MAX_JOBS),
        default=cpu_count() or 1,
        metavar="N",
        help="processes (default one per core)",
    )
    made.add_argument(
        "--paper-seeds",
        type=whole(0, MAX_SEEDS),
        default=0,
        metavar="N",
        help=f"also drive the paper's figures, with N seeds at each noise level, such as {SEEDS}",
    )
    return made
