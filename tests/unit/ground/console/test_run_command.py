"""What goes wrong in a command is said with an exit code, and never reaches the app as an error."""

import argparse
from collections.abc import Callable

import pytest

from ground.cli.verbs import LoadedVerb
from ground.client.link import Link, Unanswered
from ground.console import run_command
from ground.console.parser import parse
from ground.console.run_command import act, act_locally
from ground.missions.draft import Draft
from ground.missions.files import DASH
from ground.missions.mission import Waypoint
from ground.text.output import Says
from runtime.errors import ConfigError, RemoteError, UserError
from tests.support.ground.answering import AnsweringLink, speaking

Did = Callable[[argparse.Namespace, Link, Says], int]


def nothing(_: argparse.ArgumentParser) -> None:
    """No arguments."""


def acted(
    monkeypatch: pytest.MonkeyPatch, did: Did, draft: Draft | None = None, **options: object
) -> tuple[int, str, str]:
    """Put a function behind a verb and type it: exit code, result and notes."""

    def run(_: argparse.Namespace, __: Says) -> int:
        raise AssertionError("there is a link already")

    monkeypatch.setattr(run_command, "VERBS", {"try": LoadedVerb(nothing, run, "says", did)})
    named = argparse.Namespace(verb="try", local=False, **options)
    says, said = speaking()
    code = act(named, AnsweringLink().as_link(), says, draft=draft)
    return (code, *said())


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UserError("no such thing"), 2),
        (ConfigError(file="f", key="k", reason="no such thing", fix=""), 2),
        (RemoteError("no such thing"), 1),
        (Unanswered("no such thing"), 1),
    ],
)
def test_an_error_is_a_note_and_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, error: Exception, code: int
) -> None:
    def fail(options: argparse.Namespace, link: Link, says: Says) -> int:
        raise error

    found, out, err = acted(monkeypatch, fail)
    assert (found, out) == (code, "")
    assert err.startswith("try: ")
    assert "no such thing" in err


def test_a_defect_is_not_taken_for_a_mistake_of_the_operator(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def break_down(options: argparse.Namespace, link: Link, says: Says) -> int:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        acted(monkeypatch, break_down)


def test_what_a_verb_tells_is_its_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def tell(options: argparse.Namespace, link: Link, says: Says) -> int:
        says.result({"robot": link.robot}, f"{link.robot} is well")
        return 0

    assert acted(monkeypatch, tell) == (0, "r1 is well\n", "")


def test_a_dash_stands_for_the_draft(monkeypatch: pytest.MonkeyPatch) -> None:
    draft = Draft()
    draft.add(Waypoint(x_m=1.0, y_m=2.0))
    sent: list[object] = []

    def send(options: argparse.Namespace, link: Link, says: Says) -> int:
        sent.append(options.typed)
        return 0

    acted(monkeypatch, send, draft, file=DASH)
    acted(monkeypatch, send, draft, file="m.toml")
    assert sent == [draft.text, None]
    assert acted(monkeypatch, send, None, file=DASH)[0] == 2


def test_a_verb_that_needs_no_robot_simply_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(options: argparse.Namespace, says: Says) -> int:
        says.note("done without anybody")
        return 0

    monkeypatch.setattr(run_command, "VERBS", {"try": LoadedVerb(nothing, run, "says")})
    says, said = speaking()
    options = argparse.Namespace(verb="try", local=False)
    assert act(options, AnsweringLink().as_link(), says) == 0
    assert said()[1] == "done without anybody\n"


def test_the_app_does_its_own_words_with_its_own_hands() -> None:
    did: list[str] = []

    def theme(options: argparse.Namespace, says: Says) -> int:
        did.append(options.name)
        return 0

    assert act_locally(parse("theme dark"), speaking()[0], {"theme": theme}) == 0
    assert did == ["dark"]


def test_help_is_there_without_any_app() -> None:
    says, said = speaking()
    assert act_locally(parse("? goal"), says, {}) == 0
    assert said()[0].startswith("goto [--tol")


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("screen log", "screen: is not there on this screen"),
        ("help gotto", "help: no such command: 'gotto'; did you mean 'goto'?"),
    ],
)
def test_a_word_that_cannot_be_done_says_why(typed: str, words: str) -> None:
    says, said = speaking()
    assert act_locally(parse(typed), says, {}) == 2
    assert said() == ("", f"{words}\n")
