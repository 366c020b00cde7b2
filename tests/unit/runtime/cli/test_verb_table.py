"""The table of verbs: its examples are valid, and every name leads to its verb."""

import argparse
import shlex

import pytest

from protocol.options import numbers_kept
from runtime.cli.parsers import PLACE, parser_of, program_parsers, subcommands_of
from runtime.cli.verb_table import GROUPS, VERBS, Call, command_of, find, with_present_name
from tests.support.each import each

SUBCOMMANDS = [(word, name) for word, verb in VERBS.items() for name in verb.subcommands]


@each("word", VERBS)
def test_example_is_accepted_by_the_parser(word: str) -> None:
    call = find(shlex.split(VERBS[word].example))
    assert call is not None
    assert (call.word, call.is_old) == (word, False)
    found = parser_of(word).parse_args(numbers_kept(call.arguments))
    assert isinstance(found, argparse.Namespace)


@each(("word", "name"), SUBCOMMANDS)
def test_example_of_a_subcommand_is_accepted(word: str, name: str) -> None:
    words = shlex.split(VERBS[word].subcommands[name].example)
    assert words[:2] == [word, name]
    program = program_parsers(word).get(name)
    parser, rest = (parser_of(word), words[1:]) if program is None else (program, words[2:])
    assert parser.parse_args(numbers_kept(rest)) is not None


@each(
    ("line", "advice"),
    [
        ("teleop --for 1 -- 0.2 0 --json", f"unrecognized arguments: --json; {PLACE}"),
        ("teleop --jsn 0.2 0", "unrecognized arguments: --jsn; did you mean '--json'?"),
        ("teleop 0.2 0 --zzz", "unrecognized arguments: --zzz"),
    ],
)
def test_an_option_that_is_not_taken_is_never_proposed_again(
    line: str, advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    word, *arguments = line.split()
    with pytest.raises(SystemExit):
        parser_of(word).parse_args(arguments)
    assert capsys.readouterr().err.endswith(f"{advice}\n")


@each("word", VERBS)
def test_parsers_have_the_subcommands_of_the_table(word: str) -> None:
    below = {*subcommands_of(parser_of(word)), *program_parsers(word)}
    assert below == VERBS[word].subcommands.keys()


@each("word", VERBS)
def test_verb_is_found_by_its_present_name(word: str) -> None:
    name = command_of(word).split()
    assert find([*name, "--json"]) == Call(word, ["--json"])
    assert with_present_name([word, "--json"]) == [*name, "--json"]
    assert with_present_name([*name, "--json"]) == [*name, "--json"]


def test_grouped_verb_is_found_by_its_old_name() -> None:
    assert find(["record", "runs"]) == Call("record", ["runs"], is_old=True)


@each("words", [[], ["rec"], ["start"], ["rec", "sing"], ["container"]])
def test_other_words_are_no_verb(words: list[str]) -> None:
    assert find(words) is None
    assert with_present_name(words) == words


def test_no_group_has_the_name_of_a_verb() -> None:
    assert not GROUPS.keys() & VERBS.keys()


def test_summary_of_a_group_names_its_verbs() -> None:
    for group, summary in GROUPS.items():
        names = [command_of(word).split()[1] for word in VERBS if VERBS[word].section == group]
        assert summary.partition(": ")[2].split(", ") == names
