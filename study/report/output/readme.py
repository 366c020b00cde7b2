"""The comparison in the README, between two markers, generated from `summary.json`."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from runtime.errors import UserError
from study.report.groups import PLANNER
from study.report.output.markdown import table_lines
from study.report.output.marks import with_text
from study.report.page import PageTable
from study.report.summary import HEAD
from study.report.trials import NOISES
from study.report.words import DASH
from study.statistics.intervals import CONFIDENT

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


def update(readme: Path, summary: Path) -> None:
    """Update the README from a summary; raise UserError when a file cannot be used."""
    try:
        found = json.loads(summary.read_text(encoding="utf-8"))
        text = with_block(readme.read_text(encoding="utf-8"), block(found), str(readme))
        readme.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{error.filename}: {error.strerror}") from None
