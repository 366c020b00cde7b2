"""What is typed becomes what the command line would have read, or is refused with a reason."""

import argparse
import time

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ground.app.app import GroundApp
from ground.app.commands.app_commands import words_of_the_app
from ground.cli import main as cli
from ground.cli.verbs import VERBS
from ground.console import LOCAL, parse, verbs
from ground.console.parser import ELSEWHERE
from runtime.errors import UserError
from tests.support.ground.console.spoken import SPOKEN

GRACE_S = 0.05


@pytest.mark.parametrize(("typed", "argv"), SPOKEN)
def test_the_console_reads_what_the_command_line_reads(typed: str, argv: list[str]) -> None:
    here, there = vars(parse(typed)), vars(cli.parse(argv))
    assert here.pop("local") is False
    assert here.pop("attended") is True
    assert there.pop("attended", False) is False
    assert here == there


def test_the_table_of_commands_leaves_none_out() -> None:
    spoken = {argv[0] for _, argv in SPOKEN}
    talking = {word for word, verb in VERBS.items() if verb.act is not None}
    assert talking - spoken <= {*ELSEWHERE, *LOCAL}


def test_every_word_that_can_begin_a_command_is_read_or_asks_for_more() -> None:
    for word in verbs():
        said = outcome(word)
        assert said is None or "it takes: " in said or "--out" in said


@pytest.mark.parametrize(
    ("typed", "why"),
    [
        ("", "nothing to do"),
        (" : ", "nothing to do"),
        ("flap", "no such command: 'flap'; "),
        ("godo 1 2", "did you mean 'goto'?"),
        ("up", "run it in another terminal"),
        ("goal 1", "the following arguments are required: Y; it takes: goto [--tol"),
        ("goal one two", "'one' is not a number"),
        ("goal nan 2", "not a finite number"),
        ("goal 1 2 3 4", "unrecognized arguments: 4"),
        ("mode sideways", "invalid choice: 'sideways'"),
        ("set", "the following arguments are required: NAME, VALUE; it takes: param set"),
        ("param", "list|get|diff|set|reset|save|load"),
        ("hold --json", "--json cannot be used here"),
        ("hold --id r2", "--id cannot be used here"),
        ("hold -h", "unrecognized arguments: -h"),
        ("snap 'my file", "a quotation has no end"),
        ("snap my\x1b[2Jfile", "'\\x1b' cannot be part of a command"),
        ("hold\nabort", "'\\n' cannot be part of a command"),
        ("x" * 10_000, "10000 characters are no command: at most 1000"),
        ("x" * 900, "no such command: 'xxxxxxxxxxxxxxxxxxxxxxxx...'"),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason_and_the_fix(typed: str, why: str) -> None:
    with pytest.raises(UserError) as caught:
        parse(typed)
    assert why in str(caught.value)


def test_quotes_keep_blanks_together() -> None:
    assert str(parse("snap 'my robot.svg'").file) == "my robot.svg"


def test_a_negative_number_is_no_option() -> None:
    options = parse("goal -1e-1 -2.5 -90")
    assert (options.x, options.y, options.heading) == (-0.1, -2.5, -90.0)


def test_the_app_s_own_words_are_read_and_marked() -> None:
    assert parse(":q") == argparse.Namespace(verb="quit", local=True, attended=True)
    assert parse("wp add 1 2 --hold 3").hold == 3.0
    assert parse("record start").action == "start"
    assert parse("teleop").local is True


def test_every_word_of_the_app_has_somebody_to_do_it() -> None:
    nobody: GroundApp = None  # type: ignore[assignment]
    assert set(LOCAL) == {"help", "wp", *words_of_the_app(nobody)}


def test_no_word_of_the_app_hides_a_verb_that_talks_to_the_robot() -> None:
    hidden = {word for word in LOCAL if word in VERBS and VERBS[word].act is not None}
    assert hidden <= {"teleop", "ghost"}


commands = st.sampled_from([*verbs(), *(typed for typed, _ in SPOKEN)])
pieces = commands | st.text() | st.sampled_from(["--", "-", "-h", "'", '"', "\\", "@", "=", "%s"])
anything = st.text() | st.lists(pieces, max_size=6).map(" ".join) | st.binary().map(repr)


@given(anything)
@example("\x00")
@example("goal " + "9" * 5000)
@example("param set x " + "9" * 900)
@example("\ud800")
@example("help %s %(prog)s")
@settings(deadline=None)
def test_any_text_is_a_namespace_or_a_reason_and_never_any_output(text: str) -> None:
    began_s = time.thread_time()
    said = outcome(text)
    assert time.thread_time() - began_s < GRACE_S
    assert said is None or said.strip()


def outcome(text: str) -> str | None:
    try:
        parse(text)
    except UserError as error:
        return str(error)
    return None


def test_reading_never_prints(capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("goal", "goal -h", "--version", "hold --help", "help goto", "x" * 20_000):
        outcome(text)
    assert capsys.readouterr() == ("", "")
