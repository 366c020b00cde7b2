"""The breakdown of a tick in stages, and the page that compares two of them."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.lockstep.breakdown import STAGES, Cost, Usage, difference, points_ns, stages_us
from benchmarks.lockstep.page import BEGIN, END, main, merged, table, with_tables

TICK_NS = 100_000
POINTS = [point for _, point in STAGES[:-1]]


def notes_of(ticks: int) -> dict[str, list[tuple[str, int]]]:
    """Return notes that are 10 us apart."""
    notes: list[tuple[str, int]] = []
    for tick in range(ticks):
        begin_ns = tick * TICK_NS
        notes.append(("publish", begin_ns))
        notes += [(point, begin_ns + 10_000 * place) for place, point in enumerate(POINTS, 1)]
    return {"plant": notes, "robot": []}


def test_stages_add_up_to_the_tick() -> None:
    stages = stages_us(notes_of(9))
    assert stages == [10.0] * len(POINTS) + [20.0]
    assert sum(stages) * 1e3 == TICK_NS


def test_ticks_without_one_of_the_points_are_left_out() -> None:
    notes = notes_of(9)
    whole = stages_us(notes)
    notes["plant"] = [note for index, note in enumerate(notes["plant"]) if index != 3]
    assert stages_us(notes) == whole
    passed = [(point, time_ns) for time_ns, point in enumerate(POINTS)]
    assert points_ns(passed, 100) is not None
    assert points_ns(passed[1:], 100) is None
    assert points_ns([*passed, passed[-1]], 100) is None


def test_stage_ends_at_the_latest_when_the_next_one_does() -> None:
    passed = [(point, 10 * time_ns) for time_ns, point in enumerate(POINTS)]
    passed[0] = (passed[0][0], 15)
    ends = points_ns(passed, 200)
    assert ends is not None
    assert ends[:3] == [10, 10, 20]


def test_usage_is_the_difference_of_two_readings() -> None:
    before, after = Usage(Cost(5, 1), Cost(7, 2)), Usage(Cost(50, 11), Cost(17, 3))
    assert difference(after, before) == Usage(Cost(45, 10), Cost(10, 1))


def report(value: float, *names: str) -> dict[str, Any]:
    figures = [{"name": name, "unit": "us", "values": [1.0, value, 9.0]} for name in names]
    return {
        "benchmark": "breakdown",
        "figures": figures,
        "notes": ["a note"],
        "machine": {"load": f"{value:g}"},
    }


def files_of(folder: Path, *reports: dict[str, Any]) -> list[Path]:
    files = [folder / f"{place}.json" for place in range(len(reports))]
    for file, one in zip(files, reports, strict=True):
        file.write_text(json.dumps(one), encoding="utf-8")
    return files


def test_table_shows_what_both_reports_have() -> None:
    text = table(report(4.0, "tick"), report(2.0, "tick", "new"))
    assert "| tick (us) | 4 (1 to 9) | 2 (1 to 9) |" in text
    assert "new" not in text
    assert "- before: load 4\n- after: load 2" in text


def test_repetitions_of_several_files_are_merged_by_benchmark(tmp_path: Path) -> None:
    other = report(7.0, "wall") | {"benchmark": "lockstep"}
    found = merged(files_of(tmp_path, report(4.0, "tick"), other, report(5.0, "tick")))
    assert found["breakdown"]["figures"][0]["values"] == [1.0, 4.0, 9.0, 1.0, 5.0, 9.0]
    assert found["breakdown"]["machine"]["load"] == "4, 5"
    assert found["lockstep"]["figures"][0]["values"] == [1.0, 7.0, 9.0]


def test_page_keeps_its_text_around_the_tables(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"# Title\n{BEGIN}old\n{END}the end\n", encoding="utf-8")
    before, after = files_of(tmp_path, report(4.0, "tick"), report(2.0, "tick"))
    assert main(["--before", str(before), "--after", str(after), "--page", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"# Title\n{BEGIN}\n## sidestep bench breakdown\n")
    assert text.endswith(f"{END}the end\n")
    assert "| tick (us) | 4 (1 to 9) | 2 (1 to 9) |" in text
    assert "old" not in text


def test_page_without_marks_is_an_error() -> None:
    with pytest.raises(ValueError, match="has no <!-- begin"):
        with_tables("# Title\n", {}, {})
