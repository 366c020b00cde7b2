"""`sidestep study report DIR`: write the report of a study."""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from os import cpu_count
from pathlib import Path
from typing import Final

from protocol.options import whole
from runtime.cli.parsers import new_subcommand_parser
from study.report.build import ReportRequest
from study.report.charts.gallery import PER_NAVIGATOR
from study.report.output.files import SUMMARY, write
from study.report.output.readme import update
from study.report.paper.evidence import read_evidence
from study.report.paper.runs import SEEDS, run_paper
from study.runner.sources import world_of
from study.runner.store import commands_of, read

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
        update(options.readme, output / SUMMARY)
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
    )
    return write(table, output, request)


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
