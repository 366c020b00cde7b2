"""One run of the judge, and its results as text, as JSON and as JUnit XML.

The run connects, judges the rows, and restores changed values and plans.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from textwrap import shorten
from typing import Final, NamedTuple
from xml.etree import ElementTree

from runtime.units import NS_PER_S
from vehicle_check.ground_stations import TimeSpentError
from vehicle_check.mavlink_frames import mavlink
from vehicle_check.networks import VehicleNetwork
from vehicle_check.rows import (
    command_rows,
    control_rows,
    identity_rows,
    log_rows,
    mission_rows,
    motion_rows,
    parameter_rows,
    robustness_rows,
    telemetry_rows,
)
from vehicle_check.vehicle_under_test import (
    EMERGENCY,
    ROWS,
    AcceptanceRow,
    CheckOptions,
    RowStatus,
    RowVerdict,
    VehicleCheck,
    VehicleProfile,
    failed,
    not_applicable,
    not_tried,
)

WIDTH = 200
TIMES: Final = 3
"""How often a row is judged whose verdict is uncertain because this machine is busy."""
MAX_ROW_S: Final = 120.0
"""How long a row may take: more than any takes with a vehicle that answers nothing."""

THEMES: Final = (
    identity_rows,
    telemetry_rows,
    parameter_rows,
    mission_rows,
    log_rows,
    control_rows,
    robustness_rows,
    command_rows,
    motion_rows,
)
"""In the order of execution: rows that only receive first, rows that restart last."""


class Judged(NamedTuple):
    """A row with its verdict."""

    row: AcceptanceRow
    verdict: RowVerdict


class CheckOutcome(NamedTuple):
    """The rows in the order of numbers, and what was put back, or not."""

    rows: list[Judged]
    restored: list[str]
    not_restored: list[str]


def rows() -> Mapping[int, AcceptanceRow]:
    """Return all rows, in the order in which they are judged."""
    return {
        row.number: row
        for theme in THEMES
        for row in ROWS.values()
        if row.judge.__module__ == theme.__name__
    }


def judge(
    network: VehicleNetwork,
    options: CheckOptions,
    rows: Sequence[AcceptanceRow],
    progress: Callable[[str], None] = lambda text: None,
) -> CheckOutcome:
    """Judge a vehicle, and put back what the check has changed; RemoteError if there is none."""
    check = VehicleCheck(network, options)
    check.find()
    try:
        found = list(_all_judged(check, rows, progress))
    except KeyboardInterrupt as error:
        progress("interrupted: putting back what the check has changed")
        restored, not_restored = _put_back(check)
        error.add_note(restore_text(restored, not_restored))
        raise
    progress("putting back what the check has changed")
    return CheckOutcome(sorted(found, key=lambda one: one.row.number), *_put_back(check))


def _all_judged(
    check: VehicleCheck, rows: Sequence[AcceptanceRow], progress: Callable[[str], None]
) -> Iterator[Judged]:
    gone = ""
    for row in rows:
        if check.spent_s >= check.options.limit_s:
            gone = gone or over_limit(check)
        if gone:
            yield Judged(row, not_tried(gone))
            continue
        progress(f"row {row.number}: {row.title}")
        verdict = _judged(row, check)
        if check.is_silent():
            gone = f"the vehicle is silent since row {row.number}"
            verdict = failed(f"the vehicle fell silent; {verdict.evidence}")
        yield Judged(row, verdict)


def _put_back(check: VehicleCheck) -> tuple[list[str], list[str]]:
    """Undo the changes, the last one first; return the names of those undone, and of the others."""
    restored: list[str] = []
    not_restored: list[str] = []
    is_gone = check.is_silent()
    if check.options.allow_motion and not is_gone:
        _stop(check)
    for name, undo in reversed(check.restore):
        (restored if not is_gone and undo() else not_restored).append(name)
    return restored, not_restored


def _stop(check: VehicleCheck) -> None:
    """Disarm the vehicle, and clear an emergency stop, if a row has been interrupted."""
    if check.is_armed:
        check.main.result_of(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        check.station.wait(1.0, lambda: not check.is_armed)
    if check.heartbeat.system_status == EMERGENCY and not check.was_stopped:
        check.main.result_of(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0)


def restore_text(restored: Sequence[str], not_restored: Sequence[str]) -> str:
    """Return what was put back, and what was not, in words."""
    words = [f"put back: {', '.join(restored)}"] if restored else []
    words += [f"NOT put back: {', '.join(not_restored)}"] if not_restored else []
    return "; ".join(words)


def over_limit(check: VehicleCheck) -> str:
    """Return why a row was not tried at the end of the time that the options give."""
    return f"the time of the check was over: --limit {check.options.limit_s:g}"


def _judged(row: AcceptanceRow, check: VehicleCheck) -> RowVerdict:
    """Judge a row within its time, or within that which is left of the whole check."""
    row_s = MAX_ROW_S * (2 if check.station.is_lossy else 1)
    left_s = min(row_s, check.options.limit_s - check.spent_s)
    check.station.deadline_ns = check.station.now_ns + round(left_s * NS_PER_S)
    if check.options.profile not in row.profiles:
        return not_applicable(f"not for {check.options.profile}: it follows {row.source}")
    try:
        for _ in range(TIMES):
            verdict = row.judge(check)
            if verdict.status is not RowStatus.UNCERTAIN:
                break
        return verdict
    except TimeSpentError:
        return (
            failed(f"not finished in {row_s:g} s")
            if left_s == row_s
            else not_tried(over_limit(check))
        )
    except (AttributeError, IndexError, KeyError, ValueError, OverflowError, TypeError) as error:
        # A hostile vehicle must not end the judge: rows receive its values unchecked.
        return failed(f"unusable answer: {type(error).__name__}: {error}")
    finally:
        check.station.deadline_ns = None


def as_text(outcome: CheckOutcome) -> str:
    """Return a line per row, the clients that each failure affects, and the totals."""
    lines = []
    for row, (status, evidence) in outcome.rows:
        lines.append(f"{row.number:>3}  {status:<14}  {row.title}")
        if evidence:
            lines.append(f"{'':21}{shorten(_printable(evidence), WIDTH, placeholder=' ...')}")
        if status is RowStatus.FAIL:
            lines.append(f"{'':21}suffers: {row.suffers}")
            lines.append(f"{'':21}source:  {row.source}")
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


def as_dict(
    endpoint: str, outcome: CheckOutcome, profile: VehicleProfile = VehicleProfile.ROVER
) -> dict[str, object]:
    """Return the results as a JSON object."""
    return {
        "ok": is_good(outcome.rows),
        "endpoint": endpoint,
        "profile": str(profile),
        "rows": [
            {
                "row": row.number,
                "title": row.title,
                "status": str(verdict.status),
                "evidence": verdict.evidence,
                "suffers": row.suffers,
                "source": row.source,
            }
            for row, verdict in outcome.rows
        ],
        "restored": outcome.restored,
        "not_restored": outcome.not_restored,
    }


def as_junit(endpoint: str, judged: Sequence[Judged]) -> bytes:
    """Return a JUnit file with a test case per row; rows that were not judged are skipped."""
    counts = Counter(one.verdict.status for one in judged)
    skipped = len(judged) - counts[RowStatus.PASS] - counts[RowStatus.FAIL]
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
            failure.text = f"suffers: {row.suffers}\nsource: {row.source}"
        elif status is not RowStatus.PASS:
            ElementTree.SubElement(case, "skipped", message=f"{status}: {text}")
        else:
            ElementTree.SubElement(case, "system-out").text = text
    found: bytes = ElementTree.tostring(suite, encoding="utf-8", xml_declaration=True)
    return found


def _printable(text: str) -> str:
    """Replace unprintable characters from the vehicle, for terminals and XML."""
    return "".join(one if one.isprintable() else "?" for one in text)
