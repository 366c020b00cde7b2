"""The whole report: verdict, groups of worlds, goals given up."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from math import isnan
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pyarrow as pa
import pytest

from plant.corpus import ADVERSARIAL_FAMILIES, CROWD_FAMILIES, FAMILIES, GRID_FAMILIES
from protocol.world import World
from runtime.errors import UserError
from study.cli.report import lines_of, main, summary_of, write_files
from study.intervals import Proportion
from study.report.build import ReportRequest, in_words, page_of, reached, verdict
from study.report.charts import SvgDrawing
from study.report.comparisons import comparisons
from study.report.drives import PaperRuns
from study.report.evidence import MeasuredEvidence
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
    text_of,
)
from study.report.summary import as_json, given_up, given_up_table, summaries
from study.report.targets import targets
from study.report.trials import (
    ADVERSARIAL,
    CORPUS,
    CROWDS,
    GRIDS,
    THIN,
    Trials,
    apart_of,
    group_of,
    main_of,
    trials_of,
)
from study.runner.store import SCHEMA, commands_of, compact, table_of, write_table
from tests.support.each import each
from tests.support.studies import (
    GAVE_UP,
    LOST,
    SHUT,
    STUCK,
    drive,
    floor,
    row,
    study,
    trials,
    without_values,
)

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


ASKED = ReportRequest(
    command="sidestep study --seeds 3",
    runs=RUNS,
    world_of=a_world,
    failures=2,
    evidence=MeasuredEvidence(),
)


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
    assert headings(page) == []


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


def sentences(trials: Trials) -> list[str]:
    section = verdict(trials, summaries(trials), targets(trials))
    return [block.words for block in section.blocks if isinstance(block, Paragraph)]


def test_the_best_navigator_is_named_if_worlds_tell_it_apart() -> None:
    rows = [row(navigator="vgm", world=f"w{number}") for number in range(10)]
    rows += [row(navigator="bug", world=f"w{number}", **STUCK) for number in range(10)]
    assert sentences(trials(*rows))[0] == (
        "Noise `default`: **vgm arrives most often**, vgm in 100.0 [72.2, 100.0] % of 10 trials in"
        " 10 worlds with a path. Next is bug in 0.0 [0.0, 27.8] % of 10 trials in 10 worlds with a"
        " path."
    )


def test_seeds_of_one_world_decide_nothing() -> None:
    rows = [row(navigator="vgm", seed=seed) for seed in range(10)]
    rows += [row(navigator="bug", seed=seed, **STUCK) for seed in range(10)]
    found = sentences(trials(*rows))
    assert "**a tie**, which no test by worlds decides: vgm in 100.0 [20.7, 100.0] %" in found[0]
    assert "**no clear difference** between bug and vgm: of 1 worlds bug" in found[1]


def test_contacts_that_are_alike_are_a_tie() -> None:
    rows = [row(navigator=name, world=f"w{at}") for name in ("bug", "vgm") for at in range(3)]
    assert sentences(trials(*rows))[-1] == (
        "With noise `default` none of these navigators touched anything."
    )
    touched = [replace(one, contacts=int(one.world == "w0")) for one in rows]
    assert sentences(trials(*touched))[-1] == (
        "Something was touched in 33.33 % of trials: a tie, as the intervals overlap."
    )


def test_bound_is_neither_the_best_navigator_nor_in_the_readme() -> None:
    trials = trials_of(study(("bug", "oracle_grid")))
    assert not [one for one in sentences(trials) if "oracle_grid" in one]
    assert "oracle_grid" not in lines_of(as_json(summaries(trials)))


def test_each_noise_that_was_run_is_judged() -> None:
    found = sentences(trials_of(study(noises=("none", "harsh"))))
    begun = [one.partition(":")[0] for one in found if one.startswith("Noise")]
    assert begun == ["Noise `none`", "Noise `harsh`"]


def test_the_papers_navigators_differ_only_if_the_test_says_so() -> None:
    one = comparisons(trials_of(study()), "default")[0]
    equal = replace(
        one, first="bug", second="vgm", worlds=9, worlds_first=3, worlds_second=2, p_worlds=0.8
    )
    assert in_words(equal) == (
        "The study shows **no clear difference** between bug and vgm: of 9 worlds bug succeeds more"
        " often in 3, vgm in 2 (p = 0.80 by worlds)."
    )
    better = replace(equal, worlds_second=40, p_worlds=0.00001)
    assert in_words(better).startswith("**vgm succeeds more often than bug**: ")
    assert in_words(better).endswith("(p < 0.0001 by worlds).")


def test_missed_figures_are_named_and_unmeasured_ones_are_not_judged() -> None:
    wanted = targets(trials_of(study()))
    some = [replace(one, verdict="met") for one in wanted[:3]]
    missed = replace(wanted[0], what="of these, x", noise="harsh", verdict="missed")
    unmeasured = replace(wanted[0], verdict="not measured")
    count, table = reached([*some, missed, unmeasured])
    assert count == Paragraph("3 of 4 figures to reach are met.")
    assert isinstance(table, PageTable)
    assert table.rows == (("of these, x", "harsh", missed.wanted, missed.measured),)
    assert reached([unmeasured]) == ()


def test_study_is_judged_by_the_projects_figures_only_if_asked() -> None:
    table = table_of([row(), row(navigator="bug")])
    text = markdown_of(page_of(table, ReportRequest(failures=0)), "f")
    assert "Figures to reach" not in text
    assert "paper" not in text
    asked = ReportRequest(failures=0, evidence=MeasuredEvidence(), runs=RUNS)
    judged = markdown_of(page_of(table, asked), "f")
    assert "## Figures to reach" in judged
    assert "## The paper's figures and claims" in judged


@each(
    ("family", "group"),
    [
        *((family, CORPUS) for family in ("box", "moving", "unreachable", "other")),
        *((family, GRIDS) for family in (*GRID_FAMILIES, "moving_ai_room")),
        *((family, ADVERSARIAL) for family in ADVERSARIAL_FAMILIES),
        *((family, CROWDS) for family in CROWD_FAMILIES),
        ("thin", THIN),
    ],
)
def test_each_family_has_one_group(family: str, group: str) -> None:
    assert group_of(family) == group


def test_no_family_of_the_corpus_is_adversarial() -> None:
    assert not set(FAMILIES) & set(ADVERSARIAL_FAMILIES)


def test_study_without_the_corpus_is_not_split() -> None:
    grids = trials(row(family="grid_maze"))
    assert len(main_of(grids)) == 1
    assert apart_of(grids) == {}


def test_groups_apart_do_not_change_the_figures_of_the_corpus() -> None:
    others = [row(family="comb", **GAVE_UP), row(family="grid_maze", **GAVE_UP)]
    alone, mixed = (
        summary_of(table_of(rows), ReportRequest()) for rows in ([row()], [row(), *others])
    )
    assert mixed["rows"] == alone["rows"]
    assert (mixed["trials"], mixed["families"]) == (1, 1)
    assert list(mixed["rows_apart"]) == [GRIDS, ADVERSARIAL]


def test_page_marks_adversarial_worlds() -> None:
    page = page_of(table_of([row(), row(family="comb")]), ReportRequest(failures=0))
    text = markdown_of(page, "f")
    before, _, after = text.partition("## Worlds apart from the corpus")
    assert "comb" not in before.partition("Verdict")[2]
    assert "### Adversarial worlds\n\n**Adversarial**" in after
    plain = markdown_of(page_of(table_of([row()]), ReportRequest(failures=0)), "f")
    assert "Worlds apart" not in plain


def test_ends_are_counted_apart() -> None:
    open_rows = [row(), row(**GAVE_UP), row(**LOST), row(**{**LOST, "doubt_m": 0.2}), row(**STUCK)]
    ends: tuple[dict[str, Any], ...] = GAVE_UP, LOST, STUCK, {"outcome": "timeout"}, {}
    shut_rows = [row(**{**SHUT, **end}) for end in ends]
    (found,) = given_up(trials(*open_rows, *shut_rows))
    assert (found.wronged, found.recognised) == (Proportion(1, 5), Proportion(1, 5))
    assert found.ended == (Proportion(2, 5), Proportion(1, 5), Proportion(0, 5))
    assert found.ended_shut == (Proportion(1, 5),) * 3
    assert found.false_arrivals == Proportion(1, 5)
    assert found.doubt_m == 0.42


def test_laps_are_times_at_top_speed_round_the_boundary() -> None:
    shut = {**SHUT, **GAVE_UP, "lap_m": 6.0}
    (found,) = given_up(trials(*(row(**shut, seed=n, time_s=20.0 * (n + 1)) for n in range(3))))
    assert found.laps == pytest.approx((2.0, 2.8))
    assert found.time_s == pytest.approx((40.0, 56.0))


def test_unknown_lap_gives_no_figure() -> None:
    (found,) = given_up(trials(row(**{**SHUT, **GAVE_UP, "lap_m": None})))
    assert all(map(isnan, found.laps))


def test_zero_wrong_claims_have_a_bound() -> None:
    table = given_up_table(trials(*(row(world=f"w{number}") for number in range(100))))
    cells = [text_of(cell) for cell in table.rows[0]]
    called = table.head.index("called unreachable")
    assert cells[called : called + 2] == ["0", "295.13"]


def test_row_without_trials_of_a_kind_has_dashes() -> None:
    (cells,) = given_up_table(trials(row(**{**SHUT, **GAVE_UP}))).rows
    assert [text_of(cell) for cell in cells].count("-") == 6
