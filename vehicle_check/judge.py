"""The results of a check as text, as JSON and as JUnit XML."""

from collections import Counter
from collections.abc import Sequence
from textwrap import shorten
from xml.etree import ElementTree

from vehicle_check.vehicle_under_test import CheckOutcome, Judged, RowStatus, restore_text

WIDTH = 200


def as_text(outcome: CheckOutcome) -> str:
    """Return a line per row, the clients that each failure affects, and the totals."""
    lines = []
    for (number, title, suffers, _), (status, evidence) in outcome.rows:
        lines.append(f"{number:>3}  {status:<14}  {title}")
        if evidence:
            lines.append(f"{'':21}{shorten(_printable(evidence), WIDTH, placeholder=' ...')}")
        if status is RowStatus.FAIL:
            lines.append(f"{'':21}suffers: {suffers}")
    changes = restore_text(outcome.restored, outcome.not_restored)
    return "\n".join([*lines, *([changes] if changes else []), summary(outcome.rows)])


def summary(judged: Sequence[Judged]) -> str:
    """Return the number of rows with each verdict."""
    counts = Counter(one.verdict.status for one in judged)
    parts = [f"{counts[status]} {status}" for status in RowStatus if counts[status]]
    return f"{len(judged)} rows: {', '.join(parts)}"


def is_good(judged: Sequence[Judged]) -> bool:
    """Return True if no row has failed."""
    return all(one.verdict.status is not RowStatus.FAIL for one in judged)


def as_dict(endpoint: str, outcome: CheckOutcome) -> dict[str, object]:
    """Return the results as a JSON object."""
    return {
        "ok": is_good(outcome.rows),
        "endpoint": endpoint,
        "rows": [
            {
                "row": row.number,
                "title": row.title,
                "status": str(verdict.status),
                "evidence": verdict.evidence,
                "suffers": row.suffers,
            }
            for row, verdict in outcome.rows
        ],
        "restored": outcome.restored,
        "not_restored": outcome.not_restored,
    }


def as_junit(endpoint: str, judged: Sequence[Judged]) -> bytes:
    """Return a JUnit file with a test case per row; rows that were not judged are skipped."""
    counts = Counter(one.verdict.status for one in judged)
    skipped = counts[RowStatus.NOT_APPLICABLE] + counts[RowStatus.NOT_TRIED]
    suite = ElementTree.Element(
        "testsuite",
        name=f"mavlink check {endpoint}",
        tests=str(len(judged)),
        failures=str(counts[RowStatus.FAIL]),
        errors="0",
        skipped=str(skipped),
    )
    for row, (status, evidence) in judged:
        name = f"{row.number} {row.title}"
        case = ElementTree.SubElement(suite, "testcase", classname="mavlink", name=name)
        text = _printable(evidence)
        if status is RowStatus.FAIL:
            failure = ElementTree.SubElement(case, "failure", message=text)
            failure.text = f"suffers: {row.suffers}"
        elif status is not RowStatus.PASS:
            ElementTree.SubElement(case, "skipped", message=f"{status}: {text}")
        else:
            ElementTree.SubElement(case, "system-out").text = text
    found: bytes = ElementTree.tostring(suite, encoding="utf-8", xml_declaration=True)
    return found


def _printable(text: str) -> str:
    """Replace unprintable characters from the vehicle, for terminals and XML."""
    return "".join(one if one.isprintable() else "?" for one in text)
