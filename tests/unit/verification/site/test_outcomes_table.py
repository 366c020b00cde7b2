"""The generated table of outcomes describes a run, and the committed one is complete."""

from collections import Counter
from itertools import product
from pathlib import Path

import pytest

from checks.site.outcomes_table import document, main, rows_of, with_summary
from plant.world.file import shipped
from tests.support.each import each

TABLE = Path(__file__).parents[4] / "docs" / "evidence" / "outcomes.md"
NAMES = ("bug, left", "bug, right", "vgm", "bug1", "bug2", "distbug", "vgm_memory")


def test_world_has_a_row_per_navigator_and_noise() -> None:
    rows = rows_of("open", 2)
    assert [(row.navigator, row.noise) for row in rows] == list(product(NAMES, ("none", "default")))
    assert [row.ends.total() for row in rows] == [1, 2] * len(NAMES)
    assert {row.run.seed for row in rows} == {0}


def test_failure_has_a_reason_and_no_path_ratio() -> None:
    (row, *_) = rows_of("open", 1)
    stuck = row.run.__class__(**{**row.run.as_json(), "outcome": "stuck", "reason": "blocked"})  # type: ignore[arg-type]
    text = document([[row._replace(run=stuck, ends=Counter(stuck=3, collided=2))]], 5)
    (line,) = [line for line in text.splitlines() if line.startswith("| open")]
    assert "| stuck | blocked |" in line
    assert "| - |" in line
    assert "| bug, left | none | 5 | 0 | 2 | 0 | 0 | 3 | 0 | 0 |" in text


def test_main_writes_the_given_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "table.md"
    assert main(["--worlds", "open", "--seeds", "1", "--jobs", "1", "--output", str(path)]) == 0
    assert path.read_text(encoding="utf-8").count("\n| open | ") == 2 * len(NAMES)
    assert "1 worlds" in capsys.readouterr().err


def test_only_the_summary_of_a_page_is_replaced() -> None:
    text = document([rows_of("open", 1)], 1)
    page = "# Page\n\n| navigator | noise | runs | old |\n|---|\n| vgm | none | 9 |\n\n| other |\n"
    summary = text.partition("## Summary\n\n")[2].partition("\n\n")[0]
    assert with_summary(page, text) == f"# Page\n\n{summary}\n\n| other |\n"
    assert with_summary("no table", text) == "no table"


@each("world", shipped())
def test_committed_table_has_every_shipped_world(world: str) -> None:
    assert TABLE.read_text(encoding="utf-8").count(f"\n| {world} | ") == 2 * len(NAMES)
