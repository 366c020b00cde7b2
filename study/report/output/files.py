"""The files of the report: an HTML page, Markdown with its figures, and the summary as data."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from runtime.errors import UserError
from study.report.build import ReportRequest, page_of
from study.report.groups import apart_of, main_of
from study.report.output.html import html
from study.report.output.markdown import markdown
from study.report.page import figures_of, numbered
from study.report.paper.claims import Claim, claims
from study.report.paper.evidence import Evidence
from study.report.paper.targets import targets
from study.report.summary import as_json, numbers, summaries
from study.report.trials import Trials, distinct, trials_of

FIGURES: Final = "figures"
SUMMARY: Final = "summary.json"


def write(table: pa.Table, directory: Path, request: ReportRequest | None = None) -> list[Path]:
    """Write all files of the report; equal tables give equal bytes.

    Raises UserError for a table of another version and a directory that cannot be written.
    """
    request = request or ReportRequest()
    page = numbered(page_of(table, request))
    summary = summary_of(table, request)
    texts = {
        "report.html": html(page),
        "report.md": markdown(page, FIGURES),
        SUMMARY: json.dumps(summary, indent=1, ensure_ascii=False) + "\n",
        "summary.csv": _csv([numbers(one) for one in summaries(_corpus_of(table))]),
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
        "figures_to_reach": _targets(whole, request.evidence),
        "claims": [_claim(claim) for claim in claims(trials, request.runs)],
    }


def _corpus_of(table: pa.Table) -> Trials:
    return main_of(distinct(trials_of(table)))


def _claim(claim: Claim) -> dict[str, str]:
    fields = asdict(claim)
    return {"says": fields.pop("statement"), **fields}


def _targets(trials: Trials, found: Evidence) -> list[Mapping[str, str]]:
    return [asdict(target) for target in targets(trials, found)]


def _csv(rows: Sequence[Mapping[str, object]]) -> str:
    """Return rows as CSV, empty where a value is unknown; nothing without rows."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else (), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
