"""docs/evidence/faults.md: misses first, medians and worst values, all rows."""

from typing import Any

from checks.faults.cases import FAULTS
from checks.faults.results import Repetition, Results, page


def page_of(*repetitions: Repetition, before: str = "") -> str:
    results = Results(None)
    for one in repetitions:
        results.add(one)
    return page(results, {"cores": 2}, before)


def killed(number: int, stood_s: float, **more: Any) -> Repetition:
    return Repetition(
        fault="robot killed", way="wall", number=number, stood_s=stood_s, distance_m=0.045, **more
    )


def test_every_fault_has_a_row() -> None:
    text = page_of()
    for fault in FAULTS:
        assert f"| {fault.name.replace('|', chr(92) + '|')} |" in text


def test_page_states_that_no_row_missed() -> None:
    assert "## Rows that miss their limit\n\nNone.\n" in page_of(killed(0, 0.15))


def test_missing_row_is_listed_first_with_count_and_excess() -> None:
    text = page_of(killed(0, 0.15), killed(1, 0.25))
    named = "- **robot killed** in wall, 1 of 2: stopped after 250 ms, not 200"
    assert text.index(named) < text.index("## Processes")
    assert "**1 of 2 missed**" in text


def test_cell_has_median_worst_and_path() -> None:
    row = next(
        line
        for line in page_of(*map(killed, range(3), (0.1, 0.12, 0.18))).splitlines()
        if line.startswith("| robot killed")
    )
    assert "120 / 180 (3)" in row
    assert "4.5 cm" in row


def test_log_column_is_that_of_the_worst_repetition() -> None:
    text = page_of(
        killed(0, 0.1, logged=100, lost=0, lost_events=1), killed(1, 0.1, logged=90, lost=10)
    )
    assert "10 of 100, 1 events" in text


def test_arrivals_are_counted_with_reasons_of_the_others() -> None:
    arrived = Repetition(fault="20 % lost", way="lockstep", number=0, reached=True)
    stopped = Repetition(fault="20 % lost", way="lockstep", number=1, reason="TICKS_LOST")
    assert "1 arrived, else TICKS_LOST (2)" in page_of(arrived, stopped)


def test_missed_ticks_are_counted() -> None:
    name = "disk slow: fsync takes 2 s"
    found = [
        Repetition(fault=name, way="wall", number=number, reached=True, missed_ticks=missed)
        for number, missed in enumerate((0, 0, 2))
    ]
    assert "2 arrived, 0 ticks missed (2)" in page_of(*found[:2])
    text = page_of(*found)
    assert "3 arrived, 2 ticks missed **1 of 3 missed**" in text
    assert f"- **{name}** in wall, 1 of 3: missed 2 ticks" in text


def test_rows_not_measured_now_are_kept() -> None:
    cut = Repetition(fault="robot | plant", way="wall", number=0, stood_s=0.33, known_s=0.2)
    before = page_of(killed(0, 0.15), cut)
    after = page_of(killed(0, 0.19), before=before)
    assert "150 / 150 (1)" not in after
    assert "190 / 190 (1)" in after
    (row,) = [line for line in before.splitlines() if line.startswith("| robot \\| plant |")]
    assert "330 / 330" in row
    assert row in after.splitlines()
    assert len(after.splitlines()) == len(before.splitlines()) + 2
    assert "- **robot | plant** in wall, 1 of 1: " in after
    assert "- Apart from the others, on 20" in after
    assert "(cores 2): robot killed." in after
