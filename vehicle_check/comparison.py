"""Compare two reports of the judge: which rows have become better, and which worse."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from runtime.errors import UserError
from runtime.files import bytes_in
from vehicle_check.vehicle_under_test import RowStatus

MAX_BYTES: Final = 4_000_000
ABSENT: Final = "absent"


class ReportedRow(msgspec.Struct, frozen=True):
    """A row of a report."""

    row: int
    title: str
    status: RowStatus
    evidence: str = ""


class Report(msgspec.Struct, frozen=True):
    """The JSON output of the judge, as far as it is compared."""

    rows: list[ReportedRow]
    endpoint: str = ""
    profile: str = ""


def read_report(path: Path) -> Report:
    """Read a report; UserError names what is wrong."""
    try:
        return msgspec.json.decode(bytes_in(path, MAX_BYTES), type=Report)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}") from error
    except msgspec.DecodeError as error:
        hint = "write one with `sidestep mavlink check ENDPOINT --json >FILE`"
        raise UserError(f"{path}: is no report of the judge ({error}): {hint}") from error


class RowChange(NamedTuple):
    """A row whose status differs between two reports."""

    row: int
    title: str
    before: str
    after: str
    evidence: str

    @property
    def is_worse(self) -> bool:
        """True if it fails now."""
        return self.after == RowStatus.FAIL

    @property
    def is_better(self) -> bool:
        """True if it failed, and passes now."""
        return self.before == RowStatus.FAIL and self.after == RowStatus.PASS


def changes(before: Report, after: Report) -> list[RowChange]:
    """Return the rows that differ, in the order of their numbers."""
    old = {one.row: one for one in before.rows}
    new = {one.row: one for one in after.rows}
    found = []
    for number in sorted({*old, *new}):
        first, second = old.get(number), new.get(number)
        known = second or first
        assert known is not None, "the row is in one of them"
        was, now = (ABSENT if one is None else str(one.status) for one in (first, second))
        if was != now:
            found.append(RowChange(number, known.title, was, now, known.evidence))
    return found


def as_text(found: Sequence[RowChange], *, same: int) -> str:
    """Return a line per change, the worse ones first, and the totals."""
    lines = []
    worse = [one for one in found if one.is_worse]
    better = [one for one in found if one.is_better]
    others = [one for one in found if not one.is_worse and not one.is_better]
    for one in (*worse, *better, *others):
        lines.append(f"{one.row:>3}  {one.before} -> {one.after}  {one.title}")
        if one.evidence:
            lines.append(f"{'':5}{one.evidence}")
    counts = f"{len(worse)} worse, {len(better)} better, {len(others)} other, {same} the same"
    return "\n".join([*lines, counts])


def as_dict(found: Sequence[RowChange], *, same: int) -> dict[str, object]:
    """Return the changes as a JSON object."""
    return {
        "ok": not any(one.is_worse for one in found),
        "changes": [one._asdict() for one in found],
        "same": same,
    }
