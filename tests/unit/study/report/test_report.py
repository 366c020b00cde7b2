"""The whole report is a self-contained page and valid for every study."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pyarrow as pa
import pytest

from protocol.world import World
from runtime.errors import UserError
from study.cli.report import main, write_files
from study.report.build import ReportRequest
from study.report.charts.charts import SvgDrawing
from study.report.drives import PaperRuns
from study.report.page import (
    CodeBlock,
    PageCell,
    PageFigure,
    PageSection,
    PageTable,
    Paragraph,
    ReportPage,
    html_of,
    markdown_of,
)
from study.runner.store import SCHEMA, commands_of, compact, table_of, write_table
from tests.support.study.made import floor
from tests.support.study.report.made import STUCK, drive, row, study, without_values

VOID = {"meta", "rect", "line", "circle", "polyline", "polygon", "ellipse", "br"}
SECTIONS = [
    *("Verdict", "Summary", "Figures to reach", "Families of worlds", "Pairwise comparisons"),
    *("Final pose", "Path length", "Decisions and behaviour", "The paper's figures and claims"),
    *("Failures", "Definitions", "How it was run"),
]
WAY = [(1.0, 1.0, 0.0), (2.0, 1.5, 0.0), (3.0, 1.0, 0.0)]
RUNS = PaperRuns(
    tuple(drive(WAY, navigator=name, seed=seed) for name in ("bug", "vgm") for seed in (0, 1))
)


def a_world(source: str) -> World:
    return floor()


ASKED = ReportRequest(command="sidestep study --seeds 3", runs=RUNS, world_of=a_world, failures=2)


class Checker(HTMLParser):
    """Check that tags are closed, nothing is loaded, and every drawing has a title."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.titles: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += attrs
        if tag == "title":
            self.titles.append(self.open[-1])
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += attrs


def checked(page: str) -> Checker:
    checker = Checker()
    checker.feed(page)
    assert checker.open == []
    assert {name for name, _ in checker.attributes}.isdisjoint({"src", "onload", "onclick"})
    links = [value for name, value in checker.attributes if name == "href"]
    assert all(value and value.startswith("#") for value in links)
    assert checker.titles.count("svg") == page.count("<svg ")
    assert "http" not in page.replace("http-equiv", "")
    assert "@import" not in page
    return checker


def written(table: pa.Table, directory: Path, request: ReportRequest = ASKED) -> str:
    """Write a report, check what holds for every report, and return its HTML."""
    files = write_files(table, directory, request)
    assert all(file.exists() for file in files)
    page = (directory / "report.html").read_text()
    checked(page)
    text = (directory / "report.md").read_text()
    pictures = re.findall(r"!\[.+\]\((\S+)\)", text)
    assert len(pictures) == len(set(pictures)) == page.count("<svg ")
    for picture in pictures:
        ElementTree.fromstring((directory / picture).read_text())
    assert not re.search(r"\b(nan|inf|None)\b", re.sub(r"<style>.*?</style>", "", page))
    for lines in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        rows = lines.splitlines()
        assert len({len(re.findall(r"(?<!\\)\|", one)) for one in rows}) == 1
    json.loads((directory / "summary.json").read_text())
    return page


def headings(page: str) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", page)


def test_report_has_every_section(tmp_path: Path) -> None:
    page = written(study(), tmp_path)
    assert headings(page) == SECTIONS
    assert "sidestep study --seeds 3" in page
    assert "66 trials in 11 worlds of 6 families" in page
    assert "<h3>vgm</h3>" in page


def test_equal_tables_give_equal_bytes(tmp_path: Path) -> None:
    for name in "ab":
        write_files(study(), tmp_path / name, ASKED)
    files = sorted(file.relative_to(tmp_path / "a") for file in (tmp_path / "a").rglob("*.*"))
    assert len(files) > 8
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_empty_study_has_a_note(tmp_path: Path) -> None:
    page = written(SCHEMA.empty_table(), tmp_path, ReportRequest())
    assert "There is no trial in this study" in page
    assert headings(page) == ["The paper's figures and claims"]
    assert "They were not run for this report." in page


def test_single_navigator_has_no_comparison(tmp_path: Path) -> None:
    page = written(study(("vgm_memory",)), tmp_path)
    assert headings(page) == SECTIONS
    assert "No two navigators drove in the same worlds" in page


def test_report_without_failures_has_a_note(tmp_path: Path) -> None:
    page = written(study(failing=False), tmp_path)
    assert "No trial failed, or none was selected." in page


def test_noise_levels_not_run_are_not_measured(tmp_path: Path) -> None:
    page = written(study(noises=("harsh",)), tmp_path)
    assert headings(page) == SECTIONS
    assert "not measured" in page


def test_unknown_values_are_dashes(tmp_path: Path) -> None:
    assert headings(written(without_values(study()), tmp_path)) == SECTIONS


def test_failed_trials_are_counted(tmp_path: Path) -> None:
    failed = row(outcome="failed", digest="", reason="ValueError: no", navigator="vgm")
    page = written(table_of([row(), failed]), tmp_path)
    assert "1 trials could not be run" in page


@pytest.mark.parametrize(("navigator", "is_unknown"), [("oracle_grid", False), ("other", True)])
def test_only_a_foreign_navigator_is_unknown(
    tmp_path: Path, navigator: str, is_unknown: bool
) -> None:
    page = written(table_of([row(), row(navigator=navigator)]), tmp_path)
    assert ("unknown here" in page) == is_unknown


def test_names_like_markup_are_escaped(tmp_path: Path) -> None:
    odd = row(world="<b>|&amp;", family="a|b<i>", navigator="<script>", **STUCK)
    page = written(table_of([odd]), tmp_path)
    assert page.count("<script>") == 1, "only our own"
    assert "&lt;script&gt;" in page


def test_old_figures_are_removed(tmp_path: Path) -> None:
    write_files(study(), tmp_path, ASKED)
    before = {file.name for file in (tmp_path / "figures").iterdir()}
    write_files(study(failing=False), tmp_path, ASKED)
    after = {file.name for file in (tmp_path / "figures").iterdir()}
    assert "failure-01.svg" in before
    assert "failure-01.svg" not in after
    assert after < before


def test_unwritable_directory_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="file"):
        write_files(study(), tmp_path / "file", ASKED)


def test_command_writes_report_and_updates_readme(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_table(tmp_path / "results.parquet", study())
    readme = tmp_path / "README.md"
    readme.write_text("<!-- study:begin -->\n<!-- study:end -->\n")
    request = ["--output", str(tmp_path / "out"), "--readme", str(readme), "--failures", "0"]
    assert main([str(tmp_path), *request, "--paper-seeds", "0", "--jobs", "1"]) == 0
    assert (tmp_path / "out" / "report.html").exists()
    assert "| vgm_memory |" in readme.read_text()
    assert "report.html" in capsys.readouterr().out


def test_command_reads_figures_of_other_tools(tmp_path: Path) -> None:
    write_table(tmp_path / "results.parquet", study())
    (tmp_path / "microcontroller").mkdir()
    cost = {"drives": [{"navigator": "vgm_memory", "whole_ms": 21.5}]}
    (tmp_path / "microcontroller" / "cost.json").write_text(json.dumps(cost))
    few = ["--failures", "0", "--paper-seeds", "0", "--jobs", "1"]
    assert main([str(tmp_path), "--evidence", str(tmp_path), *few]) == 0
    assert "43.0 % (21.5 of 50 ms)" in (tmp_path / "report.md").read_text()
    assert "43.0 % (21.5 of 50 ms)" in (tmp_path / "summary.json").read_text()


def test_report_lists_the_commands_of_the_study(tmp_path: Path) -> None:
    assert commands_of(tmp_path) == ""
    compact(tmp_path, study(), {"command": "sidestep study --quick"})
    assert commands_of(tmp_path) == "sidestep study --quick"
    (tmp_path / "results.parquet").write_bytes(b"no parquet")
    assert commands_of(tmp_path) == ""


@pytest.mark.parametrize("wrong", [["--failures", "99"], ["--jobs", "0"], ["--jobs", "x"], []])
def test_wrong_usage_is_exit_code_2(wrong: list[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path), *wrong] if wrong else [])
    assert ended.value.code == 2


def test_directory_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no results"):
        main([str(tmp_path), "--paper-seeds", "0"])


def test_every_block_renders_as_html_and_markdown() -> None:
    drawing = SvgDrawing(10, 10, "says [so]")
    table = PageTable("cap|tion", ("a", "b"), (("x|y", PageCell("**1**", "good", 0.9)),))
    figure = PageFigure("one", drawing, "caption", "note", "command")
    blocks = (
        Paragraph("`c` & **s**"),
        CodeBlock("a < b"),
        table,
        figure,
    )
    page = ReportPage("T & U", (Paragraph("lead"),), (PageSection("S one", blocks),))
    made = html_of(page)
    checked(made)
    assert "<code>c</code> &amp; <strong>s</strong>" in made
    assert "a &lt; b" in made
    assert "background:rgba(var(--cool),0.40)" in made
    assert '<a href="#s-one">' in made
    text = markdown_of(page, "f")
    assert "![says (so)](f/one.svg)" in text
    assert "| x\\|y | **1** |" in text
    assert "```sh\na < b\n```" in text


def test_figures_and_tables_are_numbered_in_the_order_of_the_page(tmp_path: Path) -> None:
    page = written(study(), tmp_path)
    text = (tmp_path / "report.md").read_text()
    for kind in ("Figure", "Table"):
        numbers = [int(one) for one in re.findall(rf"<strong>{kind} (\d+)\.</strong>", page)]
        assert numbers == list(range(1, len(numbers) + 1))
        assert len(numbers) > 4
        assert [int(one) for one in re.findall(rf"\*\*{kind} (\d+)\.\*\*", text)] == numbers


def test_a_long_table_is_folded_and_a_short_one_is_not() -> None:
    def shown(rows: int) -> str:
        table = PageTable("caption", ("a", "b"), tuple(("x", "1") for _ in range(rows)))
        return html_of(ReportPage("title", (), (PageSection("s", (table,)),)))

    assert "<details>" not in shown(16)
    assert "<summary>caption (17 rows)</summary>" in shown(17)
