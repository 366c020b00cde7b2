"""`sidestep study report DIR`: write the report of a study.

It is an HTML page, Markdown with its figures, the summary as data, and the comparison in the
README, between two markers.
"""

import argparse
import csv
import io
import json
import sys
from collections.abc import Mapping, Sequence
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
    figures_of,
    html_of,
    markdown_of,
    numbered,
    table_lines,
    with_text,
)
from study.report.paper import Claim, claims
from study.report.summary import HEAD, as_json, numbers, summaries
from study.report.targets import targets
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

    Its rows and counts are of the corpus; other groups of worlds are in `rows_apart`.
    """
    every = trials_of(table)
    whole, counted = distinct(every), main_of(every)
    trials = main_of(whole)
    apart = apart_of(whole)
    return {
        "command": request.command,
        "commits": [commit for commit in every.values("commit") if commit],
        "trials": len(counted),
        "worlds": len(set(counted.texts("world_digest").tolist())),
        "families": len(counted.values("family")),
        "rows": as_json(summaries(trials)),
        "rows_apart": {group: as_json(summaries(some)) for group, some in apart.items()},
        "figures_to_reach": [asdict(target) for target in targets(whole, request.evidence)],
        "claims": [_claim(claim) for claim in claims(trials, request.runs)],
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
NAVIGATOR, NOISE, SUCCESS, TOUCHED, ERROR, RATIO = (
    *("navigator", "noise", "success %", "touched something %"),
    *("true error m, median / 95th", "path / shortest, median (90th)"),
)
RECOGNISED, WRONGED = "unreachable recognised %", "wrongly called %"
REST: Final = (TOUCHED, RATIO, ERROR, RECOGNISED, WRONGED)
assert {NAVIGATOR, NOISE, SUCCESS, *REST} <= set(HEAD)

Rows = Sequence[Mapping[str, Any]]


def lines_of(rows: Rows) -> str:
    """Return a Markdown row per navigator: success at each noise, the rest at the default noise."""
    noises = [noise for noise in NOISES if any(row[NOISE] == noise for row in rows)]
    noises += sorted({str(row[NOISE]) for row in rows} - set(NOISES))
    usual = DEFAULT_NOISE if DEFAULT_NOISE in noises or not noises else noises[0]
    head = (
        *(NAVIGATOR, *(f"success %, {noise}" for noise in noises)),
        *(f"{name}, {usual}" for name in REST),
    )
    body = []
    labels = dict.fromkeys(str(row[NAVIGATOR]) for row in rows)
    for label in (one for one in labels if one != PLANNER):
        at = {row[NOISE]: row for row in rows if row[NAVIGATOR] == label}
        successes = [str(at[noise][SUCCESS]) if noise in at else DASH for noise in noises]
        rest = [str(at[usual][name]) if usual in at else DASH for name in REST]
        body.append((label, *successes, *rest))
    return table_lines(PageTable("", head, tuple(body)))


def block(summary: Mapping[str, Any]) -> str:
    """Return the text between the markers."""
    note = (
        f"{summary['trials']:,} trials in {summary['worlds']:,} worlds of {summary['families']} "
        f"families; in brackets {CONFIDENT} intervals.\nSuccess: reached the goal by its own "
        "estimate and touched nothing, in worlds with a path.\nRecognised: reported `unreachable` "
        "in worlds without one; wrongly called: in worlds with one."
    )
    return f"{lines_of(summary['rows'])}\n\n{note}"


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
    paper_seeds: int = SEEDS,
    evidence: Path | None = None,
) -> list[Path]:
    """Write the report of a study, finished or not; return the files written.

    `evidence` is the directory with the figures of other tools, if the report is to show them.
    """
    table, found = read(study), read_evidence(evidence)
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
        help="also show the figures of other tools, from the JSON files in it (default none)",
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
        default=SEEDS,
        metavar="N",
        help=f"of the paper's figures at each noise level ({SEEDS}); 0 for none",
    )
    return made
