"""The site: generated tables and pages as in the tree, links, diagrams and pictures."""

import argparse
import json
import re
from collections import Counter
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import pytest

from checks.site import film, interop_tables
from checks.site import findings as findings_page
from checks.site import reference as protocol_page
from checks.site.__main__ import problems, target
from checks.site.findings import WORLDS
from checks.site.hooks import MAX_DRAWN, Box, box_diagram, edge, fence, state_diagram
from checks.site.interop_tables import BEGIN, END, WORDS, write_clients
from checks.site.outcomes_table import document, rows_of, with_summary
from checks.site.outcomes_table import main as outcomes_table_main
from checks.site.pictures import (
    ALONE,
    FOLDER,
    NAVIGATORS,
    PANEL_PX,
    RULES,
    THEMES,
    TITLE,
    ChainRecorder,
    beside,
    in_theme,
    panels,
    ring,
    rings,
)
from checks.site.pictures import WORLDS as PICTURES_WORLDS
from checks.site.reference import COLUMNS, GENERATORS, GROUPS, name_of, parser_parts, rows, table
from ground.app.input.keymap import KEYS
from plant.world.file import load, shipped
from protocol.outcome import OUTCOMES, REPLACED
from protocol.wire.reasons import REASON_TEXTS
from robot.parameter_table import SPECS
from runtime.cli.verb_table import VERBS, command_of
from study.falsify.findings import read_finding
from study.report.drives import drive_trial
from study.trial.trial import Trial, run_trial
from tests.support.each import each
from tests.support.vehicle_check.reports import VEHICLES
from vehicle_check.judge import rows as judge_rows


def result(
    client: str, line: str, failed: str = "", seconds: float = 1.0, words: Iterable[str] = WORDS
) -> str:
    steps = [{"step": one, "passed": one != failed, "seconds": seconds} for one in words]
    return json.dumps({"client": client, "line": line, "seed": 1, "steps": steps})


def page_from(folder: Path, *results: str) -> str:
    page, file = folder / "page.md", folder / "results.jsonl"
    page.write_text(f"before\n{BEGIN}old\n{END}after\n", encoding="utf-8")
    file.write_text("\n".join(results) + "\n", encoding="utf-8")
    assert write_clients(["--results", str(file), "--page", str(page)]) == 0
    return page.read_text(encoding="utf-8")


def test_tables_replace_what_is_between_the_marks(tmp_path: Path) -> None:
    text = page_from(tmp_path, result("mavsdk", "clean"))
    assert text.startswith(f"before\n{BEGIN}")
    assert text.endswith(f"{END}after\n")
    assert "old" not in text


def test_summary_counts_whole_runs_and_sums_the_time_until_ready(tmp_path: Path) -> None:
    runs = [result("mavsdk", "clean"), result("mavsdk", "clean", "goto")]
    text = page_from(tmp_path, *runs, result("mavsdk", "poor", seconds=2.0))
    assert "| MAVSDK 4.1.0 | 1 of 2 | 3.0 s (3.0 s) | 1 of 1 | 6.0 s (6.0 s) | not run |  |" in text
    assert "| MAVProxy 1.8.75 | not run |  | not run |  | not run |  |" in text


def test_step_that_failed_once_has_no_time(tmp_path: Path) -> None:
    text = page_from(
        tmp_path, result("mavutil", "clean", "goto"), result("mavutil", "poor", seconds=2.5)
    )
    assert "| drive to a point | failed / 2.5 / – |" in text
    assert "| connect | 1.0 / 2.5 / – |" in text


def test_client_is_judged_by_the_steps_it_can_do(tmp_path: Path) -> None:
    some = ("connect", "parameters", "log")
    text = page_from(tmp_path, result("configurator", "clean", words=some))
    row = "| Methodic Configurator 5.0.1 | 1 of 1 | 2.0 s (2.0 s) | not run |  | not run |  |"
    assert row in text
    assert f"| {' | '.join(['download a recording', *['– / – / –'] * 7, '1.0 / – / –'])}" in text


def test_page_without_marks_is_left_alone(tmp_path: Path) -> None:
    page, file = tmp_path / "page.md", tmp_path / "results.jsonl"
    page.write_text("no marks\n", encoding="utf-8")
    file.write_text(result("mavsdk", "clean") + "\n", encoding="utf-8")
    with pytest.raises(ValueError, match="clients-table"):
        write_clients(["--results", str(file), "--page", str(page)])
    assert page.read_text(encoding="utf-8") == "no marks\n"


def test_without_results_the_next_command_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert write_clients(["--results", str(tmp_path / "none.jsonl")]) == 1
    assert "make interop" in capsys.readouterr().err


BOXES = """
title: Two <boxes>
box a "A" "first" at 0 0
box b "B" "second & last" at 1 0
arrow a b "go on"
arrow b a "go back"
"""


def test_boxes_and_arrows_are_drawn() -> None:
    found = ElementTree.fromstring(box_diagram(BOXES))
    assert found.findtext("title") == "Two <boxes>"
    assert len(found.findall("rect")) == 2
    assert len(found.findall("path")) == 2
    words = [element.text for element in found.findall("text")]
    assert words == ["A", "first", "B", "second & last", "go on", "go back"]


def test_unknown_word_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown word 'circle'"):
        box_diagram("circle a")


def test_few_transitions_are_drawn() -> None:
    source = "stateDiagram-v2\n    [*] --> OFF\n    OFF --> ON: press\n    ON --> OFF: press\n"
    found = ElementTree.fromstring(fence(source, "mermaid", "diagram", {}, None))
    assert found.findtext("title") == "States; the first one is OFF"
    assert len(found.findall("rect")) == 2


def test_many_transitions_become_a_table() -> None:
    lines = [f"    A --> S{number}: step {number}" for number in range(MAX_DRAWN + 1)]
    found = ElementTree.fromstring(f"<div>{state_diagram(chr(10).join(lines))}</div>")
    assert len(found.findall("table/thead/tr/th")) == MAX_DRAWN + 3
    assert found.findall("table/tbody/tr/td")[1].text == "step 0"


@each(("towards", "where"), [((100, 0), (12, 0)), ((0, -100), (0, -7)), ((-100, 0), (-12, 0))])
def test_arrow_leaves_a_box_at_its_edge(
    towards: tuple[float, float], where: tuple[float, float]
) -> None:
    assert edge(Box("", "", (0.0, 0.0), (20.0, 10.0)), towards) == pytest.approx(where)


def test_page_shows_the_findings_in_the_tree() -> None:
    page = findings_page.PAGE.read_text(encoding="utf-8")
    assert findings_page.with_tables(page, WORLDS) == page, (
        "run `python -m checks.site.findings --page`"
    )
    for file in WORLDS.rglob("*.toml"):
        assert f"findings/{file.parent.name}/{file.stem}.svg" in page
        assert file.with_suffix(".svg").exists()
        assert read_finding(file).sentence in page


def test_tables_are_written_between_their_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    marks = findings_page.BEGIN, findings_page.END
    page.write_text(f"text\n{marks[0]}old\n{marks[1]}more\n", encoding="utf-8")
    findings_page.write_page(page)
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"text\n{marks[0]}")
    assert text.endswith(f"{marks[1]}more\n")
    assert "old" not in text.split("more")[0].splitlines()
    with pytest.raises(ValueError, match="the page has no"):
        findings_page.with_tables("text", WORLDS)


def test_findings_of_the_first_search_are_marked_and_counted() -> None:
    findings = [
        read_finding(file) for name in ("open", "fixed") for file in WORLDS.glob(f"{name}/*.toml")
    ]
    marked = [one for one in findings if findings_page.found_by(one).startswith("*first*")]
    assert 0 < len(marked) < len(findings)
    assert f"found {len(marked)} of these classes" in findings_page.tables(WORLDS)


LINK = '<a href="{}">next</a>'


def site(folder: Path, **pages: str) -> Path:
    """Write pages into a folder; `index` is the first page."""
    for name, body in pages.items():
        path = folder / f"{name.replace('__', '/')}.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'<html><body><h1 id="top">x</h1>{body}</body></html>')
    return folder


def test_whole_site_has_no_problems(tmp_path: Path) -> None:
    (tmp_path / "a.svg").write_text("<svg/>")
    home = '<img src="a.svg"><a href="https://zenoh.io">z</a>' + LINK.format("part/page.html#top")
    assert problems(site(tmp_path, index=home, part__page=LINK.format("../#top"))) == []


@each(
    ("body", "problem"),
    [
        (LINK.format("no.html"), "index.html: links to no.html, which does not exist"),
        (LINK.format("#no"), "index.html: links to #no, but index.html has no such anchor"),
        ('<img src="no.png">', "index.html: loads no.png, which does not exist"),
        (
            '<script src="https://cdn.example/x.js"></script>',
            "index.html: loads https://cdn.example/x.js from another host",
        ),
        (
            '<link rel="stylesheet" href="//fonts.example/x.css">',
            "index.html: loads //fonts.example/x.css from another host",
        ),
    ],
)
def test_defect_is_named(body: str, problem: str, tmp_path: Path) -> None:
    assert problems(site(tmp_path, index=body)) == [problem]


def test_page_without_links_to_it_is_an_orphan(tmp_path: Path) -> None:
    pages = {"index": LINK.format("a.html"), "a": "", "b": LINK.format("a.html")}
    assert problems(site(tmp_path, **pages)) == ["b.html: no page links to it"]


@each(
    ("path", "goal"),
    [
        ("", "a/b.html"),
        ("c.html", "a/c.html"),
        ("../c.html", "c.html"),
        ("./", "a/index.html"),
        ("..", "index.html"),
        ("/c/", "c/index.html"),
    ],
)
def test_relative_address_leads_to_its_file(path: str, goal: str) -> None:
    assert target("a/b.html", path) == goal


TABLE = Path(__file__).parents[3] / "docs" / "evidence" / "outcomes.md"
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
    assert (
        outcomes_table_main(
            ["--worlds", "open", "--seeds", "1", "--jobs", "1", "--output", str(path)]
        )
        == 0
    )
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


OPERATORS = {"`ground`", "`ground-NAME`"}
COMMANDERS = OPERATORS | {"`gateway`"}
ROUTER = {"`router`"}
OWN_ROBOT = {"`robot-NAME, of NAME`"}


def able(says: str) -> set[str]:
    """What the table calls the certificates that can do this; on an open bus everybody can."""
    (row,) = [row for row in rows() if row[0].startswith(says)]
    assert row[1] == "yes"
    cells = zip(protocol_page.head()[2:], row[2:], strict=True)
    return {name for name, cell in cells if cell == "yes"}


@each(
    ("says", "who"),
    [
        ("stop the robot and receive", COMMANDERS | ROUTER),
        ("take or seize", COMMANDERS | ROUTER),
        ("command as another operator", ROUTER),
        ("fetch missed commands", OPERATORS | ROUTER | OWN_ROBOT | {"`recorder`"}),
        ("fetch missed texts", COMMANDERS | ROUTER | OWN_ROBOT | {"`recorder`", "`viewer`"}),
        ("receive ground truth", OPERATORS | ROUTER | {"`recorder`", "`viewer`", "`plant`"}),
        ("pause or score", OPERATORS | ROUTER),
        ("publish sensor data of the robot", ROUTER | {"`plant`"}),
        ("command the wheels", ROUTER | OWN_ROBOT),
        ("be accepted by a robot", ROUTER),
        ("be accepted by the plant", ROUTER | OWN_ROBOT),
    ],
)
def test_a_cell_says_yes_only_to_whom_the_rules_let(says: str, who: set[str]) -> None:
    assert able(says) == who


def test_certificate_without_a_role_has_no_permission() -> None:
    assert COLUMNS[-1][0] == "stranger"
    assert {row[-1] for row in rows()} == {"no"}


PICTURES = sorted(FOLDER.glob("*.svg"))
SVG = "{http://www.w3.org/2000/svg}"


def test_all_pictures_are_committed() -> None:
    names = {f"navigators-{world}-{theme}.svg" for world in PICTURES_WORLDS for theme in THEMES}
    names |= {f"{name}-{theme}.svg" for name in ("proof", *ALONE) for theme in THEMES}
    names |= {f"{name}.svg" for name in film.SCENES}
    assert {path.name for path in PICTURES} == names


@each("path", PICTURES)
def test_picture_is_whole_and_small(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert ElementTree.fromstring(text).tag == f"{SVG}svg"
    assert len(text) < (1_000_000 if path.stem in film.SCENES else 60_000)
    assert "<script" not in text
    assert set(re.findall(r"https?://[^\"]+", text)) == {"http://www.w3.org/2000/svg"}


def test_a_drive_is_drawn_in_a_panel() -> None:
    world = load("open")
    drive = drive_trial(Trial(world=world, navigator=NAVIGATORS[0], noise="none"))
    whole = ElementTree.fromstring(panels(world, [drive], "dark"))
    words = [element.text for element in whole.findall(f"{SVG}text")]
    assert words[0] == NAVIGATORS[0]
    assert (words[1] or "").startswith("reached after ")


def test_readme_begins_with_a_film_of_a_drive() -> None:
    readme = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    first = re.search(r"!\[.+?\]\((.+?)\)", readme)
    assert first is not None
    assert readme.index(first[0]) < 40
    text = (DOCS.parent / first[1]).read_text(encoding="utf-8")
    assert text.count("<animate ") > 100
    assert "REACHED" in text


def test_each_film_is_on_a_page() -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md"))
    assert [name for name in film.SCENES if f"pictures/{name}.svg)" not in pages] == []


RED = "\x1b[38;2;255;0;0m"


def test_a_film_shows_each_word_in_the_frames_that_had_it() -> None:
    frames = [film.rows_of(f"still\n{RED}{word}\x1b[0m <end>") for word in ("one", "two", "two")]
    whole = ElementTree.fromstring(film.film(frames, 4.0, "a drive"))
    shown = {
        "".join(text.itertext()): (group.get("visibility"), group.find(f"{SVG}animate"))
        for group in whole.findall(f"{SVG}g")
        for text in group.findall(f"{SVG}text")
    }
    assert list(shown) == ["still", "<end>", "one", "two"]
    assert shown["still"] == shown["<end>"] == (None, None)
    for word, start, values, keys in (
        ("one", "hidden", "visible;hidden", "0;0.1667"),
        ("two", None, "hidden;visible", "0;0.1667"),
    ):
        visibility, animation = shown[word]
        assert visibility == start, "a program that plays no animation shows the last frame"
        assert animation is not None
        assert (animation.get("values"), animation.get("keyTimes")) == (values, keys)
        assert animation.get("dur") == "6s"


def test_a_film_places_each_word_in_its_column() -> None:
    (row,) = film.rows_of(f"ab {RED}\u28ff\u28ffcd\x1b[7mx")
    drawn = [element for _, element in film.elements_of([row], {})]
    places = [re.search(r'x="([\d.]+)"', element) for element in drawn]
    columns = [round((float(found[1]) - film.EDGE) / film.CELL[0]) for found in places if found]
    assert columns == [0, 3, 5, 7, 7]
    assert 'fill="#ff0000"' in drawn[3], "reversed, its ground has the colour of the letters"


def test_chain_closes_only_around_a_ring_without_gate() -> None:
    ends = {}
    for more_cm in (None, 3, 6):
        seen = ChainRecorder()
        outcome = run_trial(Trial(world=ring(more_cm), noise="none"), seen)
        ends[more_cm] = outcome.outcome, len(seen.gaps), len(seen.marks)
        if more_cm == 3:
            low_m, high_m = sorted(y_m for _, y_m in seen.gaps[0])
            assert low_m < 1.6 < high_m, "the gap is at the gate"
    assert ends == {None: ("unreachable", 0, 1), 3: ("lost", 1, 1), 6: ("reached", 0, 1)}


def test_committed_drawings_are_those_of_the_present_code() -> None:
    for name, draw in ALONE.items():
        for theme in THEMES:
            committed = (FOLDER / f"{name}-{theme}.svg").read_text(encoding="utf-8")
            assert in_theme(draw(), theme) == committed, f"{name}-{theme}: make pictures"


def test_committed_proof_is_that_of_the_present_navigator() -> None:
    """Redraw the picture: `make pictures` if this fails, and look at the difference."""
    drawn = rings(PANEL_PX)
    for theme in THEMES:
        committed = (FOLDER / f"proof-{theme}.svg").read_text(encoding="utf-8")
        assert beside(TITLE, drawn, theme, RULES) == committed, theme


DOCS = Path(__file__).resolve().parents[3] / "docs"
ASKED = re.compile(r"^<!-- generated: (.+) -->$", re.MULTILINE)


@pytest.fixture(scope="module")
def command_line() -> str:
    return GENERATORS["command-line"]()


def test_every_verb_has_its_section(command_line: str) -> None:
    assert re.findall(r"^### (.+)$", command_line, re.MULTILINE) == [*map(command_of, VERBS)]


def test_verbs_below_a_verb_have_sections(command_line: str) -> None:
    below = [f"{command_of(word)} {name}" for word in VERBS for name in VERBS[word].subcommands]
    assert re.findall(r"^#### (.+)$", command_line, re.MULTILINE) == below
    assert "| `--family F` |" in command_line


def test_command_line_names_no_home_folder(command_line: str) -> None:
    assert str(Path.home()) not in command_line
    assert "~/.local/state/sidestep/recordings" in command_line


def test_every_parameter_reason_and_key_is_listed() -> None:
    parameters, reasons, keys = (GENERATORS[name]() for name in ("parameters", "reasons", "keys"))
    assert [name for name in SPECS if f"| `{name}` |" not in parameters] == []
    assert [text for text in REASON_TEXTS.values() if text not in reasons and text != "ok"] == []
    assert [key.id for key in KEYS if f"| `{key.id}` |" not in keys] == []


def test_every_outcome_is_listed() -> None:
    words = GENERATORS["outcome-keys"]().splitlines()[-1]
    assert all(f"`{outcome}`" in words for outcome in (*OUTCOMES, REPLACED))


def test_every_reason_belongs_to_one_group() -> None:
    for code in set(REASON_TEXTS) - {0}:
        assert len([codes for codes in GROUPS if code in codes]) == 1


def test_pages_ask_for_every_generator_and_for_no_other() -> None:
    asked = {name for page in DOCS.rglob("*.md") for name in ASKED.findall(page.read_text())}
    assert asked == set(GENERATORS)


@each("name", sorted(set(GENERATORS) - {"command-line", "families"}))
def test_tables_are_whole(name: str) -> None:
    rows = [line for line in GENERATORS[name]().splitlines() if line.startswith("|")]
    assert rows
    assert len({len(re.findall(r"(?<!\\)\|", row)) for row in rows}) == 1


def test_cells_hide_what_would_end_them() -> None:
    assert table(("a",), [("x|y\nz",)]).splitlines()[-1] == "| x\\|y z |"


def test_arguments_are_written_as_on_the_command_line() -> None:
    parser = argparse.ArgumentParser(prog="sidestep go")
    actions = [
        parser.add_argument("where", metavar="X"),
        parser.add_argument("how", nargs="?"),
        parser.add_argument("--side", choices=("left", "right"), help="which (%(default)s)"),
        parser.add_argument("-q", "--quiet", action="store_true"),
        parser.add_argument("--start", nargs=2, metavar=("A", "B")),
    ]
    names = ["X", "[HOW]", "--side {left,right}", "-q, --quiet", "--start A B"]
    assert [name_of(action) for action in actions] == names
    assert "| `--side {left,right}` | which (None) |" in "\n".join(parser_parts(parser))


def write(folder: Path, line: str, *found: tuple[int, str, str]) -> None:
    folder.mkdir(exist_ok=True)
    kept = [{"row": row, "status": status, "evidence": why} for row, status, why in found]
    (folder / f"{line}.json").write_text(json.dumps({"rows": kept}), encoding="utf-8")


def test_page_shows_the_results_in_the_tree() -> None:
    page = interop_tables.ROWS_PAGE.read_text(encoding="utf-8")
    found = interop_tables.results_in(interop_tables.EVIDENCE)
    others = interop_tables.VEHICLES
    assert list(others) == list(VEHICLES)
    kept = {
        name: interop_tables.results_of(interop_tables.EVIDENCE / f"{name}.json") for name in others
    }
    assert interop_tables.with_table(page, found, kept) == page
    for line, results in found.items():
        assert sorted(results) == sorted(judge_rows()), line


def test_new_results_replace_the_evidence(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        f"text\n{interop_tables.ROWS_BEGIN}old\n{interop_tables.ROWS_END}more\n", encoding="utf-8"
    )
    write(tmp_path / "results", "udp", (1, "pass", "fine"), (59, "not applicable", "one system"))
    words = ["--results", str(tmp_path / "results"), "--page", str(page)]
    assert interop_tables.write_rows([*words, "--evidence", str(tmp_path / "kept")]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"text\n{interop_tables.ROWS_BEGIN}")
    assert text.endswith(f"{interop_tables.ROWS_END}more\n")
    assert f"| UDP | 1 of {len(judge_rows())} |" in text
    assert "| TCP | not run |" in text
    assert "- Row 59, UDP: not applicable. one system" in text
    assert (tmp_path / "kept" / "udp.json").exists()


def test_without_results_the_page_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--results", str(tmp_path), "--page", str(tmp_path / "none")]
    assert interop_tables.write_rows([*words, "--evidence", str(tmp_path / "kept")]) == 1
    assert "make interop" in capsys.readouterr().err
