from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from checks.__main__ import BENCHMARKS
from checks.evidence import EVIDENCE, FIGURES, GATEWAY, LONG_FIGURES, ROOT, TICK
from checks.harness.figures import BenchmarkReport, Figure
from checks.site import figures_page

REPORT = BenchmarkReport(
    benchmark="codec",
    figures=(
        Figure(name="ratio", unit="x", values=(4.0, 3.0, 5.0), at_least=3.0),
        Figure(name="cost", unit="us", values=(2.5,), at_most=2.0),
        Figure(name="shown", unit="", values=(1.0,)),
    ),
    notes=("byte-identical",),
    machine={"cores": 2},
)


EMPTY = f"# Page\n\n{figures_page.BEGIN}{figures_page.END}\nthe end\n"


def reported(arguments: Sequence[str]) -> dict[str, Any]:
    return REPORT.as_json() | {"benchmark": arguments[0]}


def test_met_and_missed_figures_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures_page, "measured", reported)
    output = tmp_path / "figures.md"
    output.write_text(EMPTY)
    assert figures_page.main(["codec", "--output", str(output)]) == 0
    text = output.read_text()
    assert text.startswith("# Page\n")
    assert text.endswith("\nthe end\n")
    assert "| ratio | 4 x | 3 to 5 | >= 3 | met |" in text
    assert "| cost | 2.5 us |  | <= 2 | **missed** |" in text
    assert "| shown | 1 |  |  |  |" in text
    assert f"\n## codec: {BENCHMARKS['codec'].title}\n" in text
    assert "`sidestep bench codec`, cores 2" in text
    assert "- byte-identical" in text


def test_a_benchmark_that_breaks_down_leaves_the_old_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures_page, "measured", lambda _: None)
    output = tmp_path / "figures.md"
    output.write_text(EMPTY)
    assert figures_page.main(["codec", "--output", str(output)]) == 1
    assert output.read_text() == EMPTY


def test_missing_report_is_printed_with_its_exit_code(capfd: pytest.CaptureFixture[str]) -> None:
    assert figures_page.measured(["nonsense"]) is None
    assert "exit code 2" in capfd.readouterr().err


def test_section_is_replaced_in_the_order_of_the_benchmarks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures_page, "measured", reported)
    output = tmp_path / "figures.md"
    output.write_text(
        EMPTY.replace(figures_page.END, f"a table written by hand\n{figures_page.END}")
    )
    assert figures_page.main(["nees", "core", "--output", str(output)]) == 0
    text = output.read_text()
    assert "by hand" not in text
    assert text.index("\n## core: ") < text.index("\n## nees: ")
    monkeypatch.setattr(
        figures_page, "measured", lambda words: reported(words) | {"notes": ["newer"]}
    )
    assert figures_page.main(["core", "--output", str(output)]) == 0
    new = output.read_text()
    assert new.count("\n## core: ") == new.count("- newer") == new.count("- byte-identical") == 1
    assert new.index("- newer") < new.index("\n## nees: ")


def test_figures_are_measured_by_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures_page, "measured", reported)
    output = tmp_path / "figures.md"
    output.write_text(EMPTY)
    assert figures_page.main(["--output", str(output)]) == 0
    assert [found[1] for found in figures_page.SECTION.finditer(output.read_text())] == list(
        FIGURES
    )


def test_every_benchmark_is_on_a_page_of_evidence() -> None:
    sections = (*FIGURES, *LONG_FIGURES, *TICK, *GATEWAY)
    whole = ("compiled", "faults")
    assert sorted((*sections, *whole)) == sorted(BENCHMARKS)
    assert {*whole} <= {one.name for one in EVIDENCE}


@pytest.mark.parametrize("name", ["figures", "long-figures", "lockstep", "mavlink-gateway"])
def test_committed_page_has_marks_for_its_sections(name: str) -> None:
    text = (ROOT / "docs" / "evidence" / f"{name}.md").read_text(encoding="utf-8")
    assert text.count(figures_page.BEGIN) == text.count(figures_page.END) == 1


def test_growth_is_measured_over_ten_hours() -> None:
    assert figures_page.OPTIONS["robot"] == ("--hours", "10")
