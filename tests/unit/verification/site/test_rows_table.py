"""The table of the rows of the judge: complete, and as the results in the tree are."""

import json
from pathlib import Path

import pytest

from checks.site import rows_table
from vehicle_check.judge import rows


def write(folder: Path, line: str, *found: tuple[int, str, str]) -> None:
    folder.mkdir(exist_ok=True)
    kept = [{"row": row, "status": status, "evidence": why} for row, status, why in found]
    (folder / f"{line}.json").write_text(json.dumps({"rows": kept}), encoding="utf-8")


def test_page_shows_the_results_in_the_tree() -> None:
    page = rows_table.PAGE.read_text(encoding="utf-8")
    found = rows_table.results_in(rows_table.EVIDENCE)
    assert rows_table.with_table(page, found) == page
    for line, results in found.items():
        assert sorted(results) == sorted(rows()), line


def test_new_results_replace_the_evidence(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"text\n{rows_table.BEGIN}old\n{rows_table.END}more\n", encoding="utf-8")
    write(tmp_path / "results", "udp", (1, "pass", "fine"), (59, "not applicable", "one system"))
    words = ["--results", str(tmp_path / "results"), "--page", str(page)]
    assert rows_table.main([*words, "--evidence", str(tmp_path / "kept")]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"text\n{rows_table.BEGIN}")
    assert text.endswith(f"{rows_table.END}more\n")
    assert "| UDP | 1 of 60 |" in text
    assert "| TCP | not run |" in text
    assert "- Row 59, UDP: not applicable. one system" in text
    assert (tmp_path / "kept" / "udp.json").exists()


def test_without_results_the_page_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--results", str(tmp_path), "--page", str(tmp_path / "none")]
    assert rows_table.main([*words, "--evidence", str(tmp_path / "kept")]) == 1
    assert "make interop" in capsys.readouterr().err
