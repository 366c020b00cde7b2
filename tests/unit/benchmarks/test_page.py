import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks import page
from benchmarks.__main__ import BENCHMARKS
from verification.harness.figures import Figure, Report

REPORT = Report(
    benchmark="codec",
    figures=(
        Figure(name="ratio", unit="x", values=(4.0, 3.0, 5.0), at_least=3.0),
        Figure(name="cost", unit="us", values=(2.5,), at_most=2.0),
        Figure(name="shown", unit="", values=(1.0,)),
    ),
    notes=("byte-identical",),
    machine={"cores": 2},
)


def reported(arguments: object) -> dict[str, Any]:
    return REPORT.as_json()


def test_met_and_missed_figures_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "measured", reported)
    output = tmp_path / "figures.md"
    assert page.main(["codec", "--output", str(output)]) == 0
    text = output.read_text()
    assert "| ratio | 4 x | 3 to 5 | >= 3 | met |" in text
    assert "| cost | 2.5 us |  | <= 2 | **missed** |" in text
    assert "| shown | 1 |  |  |  |" in text
    assert f"\n## codec: {BENCHMARKS['codec'].title}\n" in text
    assert "`sidestep bench codec`, cores 2" in text
    assert "- byte-identical" in text


def test_a_benchmark_that_breaks_down_leaves_the_old_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "measured", lambda _: None)
    output = tmp_path / "figures.md"
    output.write_text("old")
    assert page.main(["codec", "--output", str(output)]) == 1
    assert output.read_text() == "old"


def test_missing_report_is_printed_with_its_exit_code(capfd: pytest.CaptureFixture[str]) -> None:
    assert page.measured(["nonsense"]) is None
    assert "exit code 2" in capfd.readouterr().err


def test_page_contains_every_benchmark_by_default(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "measured", reported)
    output = tmp_path / "figures.md"
    assert page.main(["--output", str(output)]) == 0
    commands = re.findall(r"^`sidestep bench (\w+)", output.read_text(), re.MULTILINE)
    assert {"core", "nees", "arrival"} < set(commands)
    assert commands == list(BENCHMARKS)


def test_growth_is_measured_over_ten_hours() -> None:
    assert page.OPTIONS["robot"] == ("--hours", "10")
