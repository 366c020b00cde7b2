"""The tables of real clients, from the results of their runs."""

import json
from pathlib import Path

import pytest

from checks.site.clients_table import BEGIN, END, WORDS, main


def result(client: str, line: str, failed: str = "", seconds: float = 1.0) -> str:
    steps = [{"step": one, "passed": one != failed, "seconds": seconds} for one in WORDS]
    return json.dumps({"client": client, "line": line, "seed": 1, "steps": steps})


def page_from(folder: Path, *results: str) -> str:
    page, file = folder / "page.md", folder / "results.jsonl"
    page.write_text(f"before\n{BEGIN}old\n{END}after\n", encoding="utf-8")
    file.write_text("\n".join(results) + "\n", encoding="utf-8")
    assert main(["--results", str(file), "--page", str(page)]) == 0
    return page.read_text(encoding="utf-8")


def test_tables_replace_what_is_between_the_marks(tmp_path: Path) -> None:
    text = page_from(tmp_path, result("mavsdk", "clean"))
    assert text.startswith(f"before\n{BEGIN}")
    assert text.endswith(f"{END}after\n")
    assert "old" not in text


def test_summary_counts_whole_runs_and_sums_the_time_until_ready(tmp_path: Path) -> None:
    runs = [result("mavsdk", "clean"), result("mavsdk", "clean", "goto")]
    text = page_from(tmp_path, *runs, result("mavsdk", "poor", seconds=2.0))
    assert "| MAVSDK 4.1.0 | 1 of 2 | 3.0 s (3.0 s) | 1 of 1 | 6.0 s (6.0 s) |" in text
    assert "| MAVProxy 1.8.75 | not run |  | not run |  |" in text


def test_step_that_failed_once_has_no_time(tmp_path: Path) -> None:
    text = page_from(
        tmp_path, result("mavutil", "clean", "goto"), result("mavutil", "poor", seconds=2.5)
    )
    assert "| drive to a point | failed / 2.5 |" in text
    assert "| connect | 1.0 / 2.5 |" in text


def test_page_without_marks_is_left_alone(tmp_path: Path) -> None:
    page, file = tmp_path / "page.md", tmp_path / "results.jsonl"
    page.write_text("no marks\n", encoding="utf-8")
    file.write_text(result("mavsdk", "clean") + "\n", encoding="utf-8")
    with pytest.raises(ValueError, match="clients-table"):
        main(["--results", str(file), "--page", str(page)])
    assert page.read_text(encoding="utf-8") == "no marks\n"


def test_without_results_the_next_command_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--results", str(tmp_path / "none.jsonl")]) == 1
    assert "make interop" in capsys.readouterr().err
