"""The comparison in the README: between two markers, and made of what `summary.json` holds."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from runtime.errors import UserError
from study.report.output.markdown import table_lines
from study.report.page import Table
from study.report.summary import HEAD, as_json, summaries
from study.report.trials import NOISES, distinct, trials_of
from study.report.words import DASH
from study.statistics.intervals import CONFIDENT

BEGIN: Final = "<!-- study:begin -->"
END: Final = "<!-- study:end -->"
USUAL: Final = "default"
NAVIGATOR, NOISE, SUCCESS, TOUCHED, ERROR, RATIO = (
    *("navigator", "noise", "success %", "touched something %"),
    *("true error m, median / 95th", "path / shortest, median (90th)"),
)
RECOGNISED: Final = "unreachable recognised %"
REST: Final = (TOUCHED, RATIO, ERROR, RECOGNISED)
assert {NAVIGATOR, NOISE, SUCCESS, *REST} <= set(HEAD)

Rows = Sequence[Mapping[str, Any]]


def summary_table(table: pa.Table) -> str:
    """A row per navigator: success at each noise, and the rest at the usual one, as Markdown."""
    return lines_of(as_json(summaries(distinct(trials_of(table)))))


def lines_of(rows: Rows) -> str:
    noises = [noise for noise in NOISES if any(row[NOISE] == noise for row in rows)]
    noises += sorted({str(row[NOISE]) for row in rows} - set(NOISES))
    usual = USUAL if USUAL in noises or not noises else noises[0]
    head = (
        *(NAVIGATOR, *(f"success %, {noise}" for noise in noises)),
        *(f"{name}, {usual}" for name in REST),
    )
    body = []
    for label in dict.fromkeys(str(row[NAVIGATOR]) for row in rows):
        at = {row[NOISE]: row for row in rows if row[NAVIGATOR] == label}
        successes = [str(at[noise][SUCCESS]) if noise in at else DASH for noise in noises]
        rest = [str(at[usual][name]) if usual in at else DASH for name in REST]
        body.append((label, *successes, *rest))
    return table_lines(Table("", head, tuple(body)))


def block(summary: Mapping[str, Any]) -> str:
    """What stands between the markers."""
    says = (
        f"{summary['trials']:,} trials in {summary['worlds']:,} worlds of {summary['families']} "
        f"families; in brackets {CONFIDENT} intervals.\nSuccess: arrived by its own belief "
        "and touched nothing, of worlds with a way. Recognised: said\nso where there is none."
    )
    return f"{lines_of(summary['rows'])}\n\n{says}"


def with_block(readme: str, text: str, file: str = "README.md") -> str:
    """The README with this between its markers. Raises UserError where they are not."""
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise UserError(f"{file}: has no {BEGIN} and {END}; add the two lines where the table goes")
    return f"{before}{BEGIN}\n\n{text}\n\n{END}{after}"


def update(readme: Path, summary: Path) -> None:
    """Raises UserError when either cannot be read or written."""
    try:
        found = json.loads(summary.read_text(encoding="utf-8"))
        text = with_block(readme.read_text(encoding="utf-8"), block(found), str(readme))
        readme.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{error.filename}: {error.strerror}") from None
