"""Generated tables of the reference: they hold what the code holds."""

import argparse
import re
from pathlib import Path

import pytest

from checks.site.reference import GENERATORS, GROUPS, name_of, parser_parts, table
from ground.app.input.keymap import KEYS
from protocol.outcome import OUTCOMES, REPLACED
from protocol.wire.reasons import REASON_TEXTS
from robot.parameter_table import SPECS
from runtime.cli.verb_table import VERBS, command_of
from tests.support.each import each

DOCS = Path(__file__).resolve().parents[4] / "docs"
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
