"""The command line: verbs, exit codes, one JSON object in every case, and answers to commands."""

import argparse
import asyncio
import json
import os
import signal
import sys
import threading
import weakref
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from checks.harness.until import PATIENCE_S
from ground.cli import main as cli
from ground.cli.main import OPERATOR_VERBS, Interrupted, main
from ground.cli.operate import effect_of, run_until_signal
from ground.client.outcomes import Accepted, Refused
from ground.client.vocabulary import SHELL
from ground.commands.abort import Abort
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.hold import Hold
from ground.commands.resume import Resume
from ground.commands.rtl import ReturnHome
from ground.commands.stop import ClearEmergencyStop
from ground.text.output import Output
from protocol.wire.reasons import Reason
from runtime.cli.verb_table import command_of
from runtime.errors import NoAnswerError, UserError
from tests.support.each import each

Run = Callable[[argparse.Namespace, Output], int]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Callable[[Run], None]:
    """Put a function of the test behind the verb `mark`."""

    def put(run: Run) -> None:
        def parser_of(word: str) -> argparse.ArgumentParser:
            parser = argparse.ArgumentParser(prog=word)
            parser.add_argument("--json", action="store_true")
            return parser

        monkeypatch.setattr(cli, "loaded", {"mark": run}.get)
        monkeypatch.setattr(cli, "parser_of", parser_of)

    return put


def raises(error: BaseException) -> Run:
    def run(options: argparse.Namespace, output: Output) -> int:
        raise error

    return run


@each("verb", sorted(OPERATOR_VERBS))
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([verb, "--help"]) == 0
    assert f"sidestep {command_of(verb)}" in capsys.readouterr().out


@each(
    "words",
    [
        [],
        ["fly"],
        ["hold", "now"],
        ["goto", "1"],
        ["goto", "nan", "1"],
        ["goto", "1", "inf"],
        ["goto", "1", "2", "--tolerance", "nan"],
        ["goto", "9e9", "0"],
        ["goto", "-9e9", "0"],
        ["goto", "-inf", "0"],
        ["up", "--goal", "-1e-3", "1"],
        ["up", "--goal", "-inf", "1"],
        ["mode", "sideways"],
        ["navigator", "magic"],
        ["navigator", "bug", "up"],
        ["param"],
        ["param", "set", "d_obs_m", "nan"],
        ["up", "--speed", "0"],
        ["up", "--speed", "-1"],
        ["up", "--speed", "inf"],
        ["up", "--robots", "0"],
        ["up", "--seed", "-1"],
        ["up", "--noise", "awful"],
        ["up", "--goal", "1", "nan"],
        ["up", "--timeout", "0"],
        ["hold", "--id", "R 1"],
        ["hold", "--connect", "localhost"],
        ["hold", "--config", "/nowhere/at/all.toml"],
        ["export", "/nowhere/at/all.tlog"],
    ],
)
def test_wrong_usage_ends_with_2_and_a_word_about_it(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.err
    assert "Traceback" not in printed.err
    assert not printed.out


def test_a_negative_exponent_is_a_number_and_not_an_option() -> None:
    found = cli.parse(["goto", "-1e3", "-2.5e-1", "-9e1"])
    assert (found.x, found.y, found.heading) == (-1000.0, -0.25, -90.0)
    assert cli.parse(["up", "--goal", "-1e-3", "2e0"]).goal == [-0.001, 2.0]


def test_invalid_number_has_its_own_message(
    capsys: pytest.CaptureFixture[str],
) -> None:
    main(["goto", "-inf", "0"])
    assert "'-inf' is not a finite number" in capsys.readouterr().err
    main(["up", "--goal", "-1e-3", "1"])
    assert "(-0.001, 1.000) lies outside the world box" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UserError("wrong world"), 2),
        (NoAnswerError("no robot there"), 1),
        (KeyboardInterrupt(), 130),
        (Interrupted(signal.SIGTERM), 143),
    ],
)
def test_an_error_is_one_line_and_one_object(
    install: Callable[[Run], None],
    error: BaseException,
    code: int,
    capsys: pytest.CaptureFixture[str],
) -> None:
    install(raises(error))
    assert main(["mark", "--json"]) == code
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert (found["ok"], found["exit_code"]) == (False, code)
    assert printed.err.count("\n") == 1


def test_a_table_and_json_cannot_both_be_standard_output(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["export", "x.tlog", "--json"]) == 2
    assert "--out" in json.loads(capsys.readouterr().out)["reason"]


def test_result_is_printed_once(
    install: Callable[[Run], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def run(options: argparse.Namespace, output: Output) -> int:
        output.result({"ok": True}, "fine")
        raise KeyboardInterrupt

    install(run)
    assert main(["mark", "--json"]) == 130
    assert json.loads(capsys.readouterr().out) == {"ok": True}


def test_a_signal_ends_the_verb_and_the_handlers_are_put_back(
    install: Callable[[Run], None],
) -> None:
    before = signal.getsignal(signal.SIGTERM)

    def run(options: argparse.Namespace, output: Output) -> int:
        os.kill(os.getpid(), signal.SIGTERM)
        threading.Event().wait(PATIENCE_S)
        return 0

    install(run)
    assert main(["mark"]) == 143
    assert signal.getsignal(signal.SIGTERM) is before


class Interrupting:
    """Sends this process a signal as it is deleted, where Python ignores an exception."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


@each("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_in_a_finalizer_ends_the_verb_too(
    install: Callable[[Run], None], number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    before, ends = sys.unraisablehook, []

    def run(options: argparse.Namespace, output: Output) -> int:
        Interrupting(number)
        try:
            threading.Event().wait(PATIENCE_S)
        finally:  # where the verb ends, nothing interrupts it
            ends.append(number)
            Interrupting(number)
            signal.raise_signal(number)
        return 0

    install(run)
    assert main(["mark"]) == 128 + number
    assert ends == [number]
    assert sys.unraisablehook is before
    assert "Exception ignored" not in capsys.readouterr().err


def test_a_signal_that_is_lost_again_and_again_arrives_at_last(
    install: Callable[[Run], None],
) -> None:
    reached: list[int] = []

    def run(options: argparse.Namespace, output: Output) -> int:
        for does in (send, wait, wait):
            thing = type("Thing", (), {})()
            watch = weakref.ref(thing, does)
            del thing
            assert watch() is None
        wait(None)
        return 0

    def send(_: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    def wait(_: object) -> None:
        reached.append(len(reached))
        threading.Event().wait(PATIENCE_S)

    install(run)
    assert main(["mark"]) == 143
    assert len(reached) == 3


@each("is_finalizer", [False, True])
@each("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_an_event_loop_after_its_clean_up(
    install: Callable[[Run], None], number: signal.Signals, is_finalizer: bool
) -> None:
    ends, before = [], signal.getsignal(number)
    send = Interrupting if is_finalizer else signal.raise_signal

    async def drive() -> None:
        send(number)
        try:
            await asyncio.sleep(PATIENCE_S)
        finally:  # the next signal does not cut it short
            signal.raise_signal(signal.SIGINT)
            await asyncio.sleep(0.0)
            await asyncio.sleep(0.0)
            ends.append(number)

    def run(options: argparse.Namespace, output: Output) -> int:
        run_until_signal(drive)
        raise AssertionError("it goes on after the signal")

    install(run)
    assert main(["mark"]) == 128 + number
    assert ends == [number]
    assert signal.getsignal(number) is before


def test_a_signal_before_the_task_begins_ends_the_verb(
    install: Callable[[Run], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = asyncio.run

    def late(work: Coroutine[Any, Any, None]) -> None:
        signal.raise_signal(signal.SIGTERM)
        runs(work)

    async def drive() -> None:
        raise AssertionError("it begins after the signal")

    monkeypatch.setattr(asyncio, "run", late)
    install(lambda _options, _output: run_until_signal(drive) or 0)
    assert main(["mark"]) == 143


def test_a_signal_that_comes_too_late_to_cancel_ends_the_verb(
    install: Callable[[Run], None],
) -> None:
    async def drive() -> None:
        signal.raise_signal(signal.SIGTERM)

    install(lambda _options, _output: run_until_signal(drive) or 0)
    assert main(["mark"]) == 143


def test_another_ignored_exception_is_reported_as_before(
    install: Callable[[Run], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda ignored: reported.append(ignored.exc_value))
    defect = ValueError("a defect")

    class Defective:
        def __del__(self) -> None:
            raise defect

    def run(options: argparse.Namespace, output: Output) -> int:
        Defective()
        return 0

    install(run)
    assert main(["mark"]) == 0
    assert reported == [defect]


def test_what_is_not_finite_becomes_null(capsys: pytest.CaptureFixture[str]) -> None:
    Output(as_json=True).result({"a": float("nan"), "b": [float("inf"), 1], "c": {"d": (2.5,)}}, "")
    assert json.loads(capsys.readouterr().out) == {"a": None, "b": [None, 1], "c": {"d": [2.5]}}


def test_an_accepted_command_names_its_effect() -> None:
    assert effect_of(Arm(), Accepted(14_000_000)) == ": motors armed"


def test_an_effect_names_the_robot_as_it_was_named() -> None:
    remedies = SHELL._replace(options=" --id r2")
    assert "`sidestep resume --id r2` would" in effect_of(Abort(), Accepted(1), remedies)


@each("why", [{"note": Reason.NOTHING_CHANGED}, {"cause": "time stands still"}])
def test_what_had_no_effect_names_none(why: dict[str, Any]) -> None:
    assert effect_of(Disarm(), Accepted(1, **why)) == ""


def test_a_refused_command_has_none() -> None:
    assert effect_of(Arm(), Refused(Reason.NO_GOAL, 1)) == ""


@each("command", [Hold, Resume, Abort, ReturnHome, Arm, Disarm, ClearEmergencyStop])
def test_every_plain_command_has_an_effect(command: type[Arm]) -> None:
    assert effect_of(command(), Accepted(1)) != ""
