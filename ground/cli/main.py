"""The operator's command line: run one verb, print each error in one line, return the exit code."""

import _thread
import argparse
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from types import FrameType
from typing import Final

from ground.text.output import Output
from protocol.options import numbers_kept
from runtime.cli.parsers import parser_of
from runtime.cli.verb_table import VERBS, command_of
from runtime.errors import (
    EXIT_FAILURE,
    EXIT_SIGNAL,
    EXIT_USAGE,
    ConfigError,
    RemoteError,
    UserError,
)

AGAIN_S: Final = 0.01
OPERATOR_VERBS: Final = tuple(word for word, verb in VERBS.items() if not verb.is_program)


class Interrupted(KeyboardInterrupt):
    """A signal asks the process to end; raised as an exception, so that `finally` blocks run."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def main(argv: Sequence[str], *, ends_process: bool = False) -> int:
    """Run one verb; return 0 for success, 1 for failure, 2 for usage, 128 + n for signal n.

    If the process ends with the verb, the handlers of signals stay in place, so that a late signal
    does not kill it.
    """
    try:
        options = parse(argv)
    except SystemExit as done:
        return 0 if done.code in (0, None) else EXIT_USAGE
    output = Output(as_json=options.json)
    try:
        with signals(keep=ends_process):
            return loaded(options.verb)(options, output)
    except KeyboardInterrupt as error:
        number = error.number if isinstance(error, Interrupted) else signal.SIGINT
        return failed(output, options.verb, "interrupted", EXIT_SIGNAL + number)
    except (UserError, ConfigError) as error:
        return failed(output, options.verb, str(error), EXIT_USAGE)
    except RemoteError as error:
        code = getattr(error, "exit_code", EXIT_FAILURE)
        return failed(output, options.verb, str(error), code)


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Parse the arguments of a verb; SystemExit after an error message, as argparse does."""
    word = argv[0] if argv else ""
    if word not in OPERATOR_VERBS:
        known = ", ".join(OPERATOR_VERBS)
        print(f"sidestep: unknown verb {word!r}; known: {known}", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)
    return parser_of(word).parse_args(numbers_kept(argv[1:]), argparse.Namespace(verb=word))


def loaded(word: str) -> Callable[[argparse.Namespace, Output], int]:
    """Import the module of a verb, and only that; return the function that runs it."""
    verb = VERBS[word]
    if verb.words:
        from ground.cli import operate

        return operate.run
    run: Callable[[argparse.Namespace, Output], int] = getattr(import_module(verb.module), verb.run)
    return run


def failed(output: Output, verb: str, why: str, code: int) -> int:
    """Print the error in one line, with --json also as a JSON object; return the exit code."""
    output.note(f"sidestep {command_of(verb)}: {why}")
    if output.as_json and not output.has_result:
        output.result({"verb": verb, "ok": False, "reason": why, "exit_code": code}, "")
    return code


@contextmanager
def signals(*, keep: bool = False) -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the verb as Ctrl-C does, once; ignore them while it ends.

    Python ignores an exception in a finalizer and in the callback of a weak reference; those of
    Zenoh's callbacks get there by `protocol.bus.callbacks`. A signal that was lost there is sent
    again until it reaches the verb.

    Restore the former handlers after the block, unless they are to be kept.
    """
    is_ending, is_over = False, threading.Event()

    def end(number: int, _: FrameType | None) -> None:
        nonlocal is_ending
        if not is_ending:
            is_ending = True
            raise Interrupted(number)

    def notice(ignored: "sys.UnraisableHookArgs") -> None:
        if isinstance(ignored.exc_value, Interrupted):
            # A `Thread` takes locks, which the code that was interrupted may hold.
            _thread.start_new_thread(send_again, (ignored.exc_value.number,))
        else:
            hook(ignored)

    def send_again(number: int) -> None:
        nonlocal is_ending
        if not is_over.wait(AGAIN_S):  # the finalizer and `notice` have been left
            is_ending = False
        while not is_ending and not is_over.is_set():
            signal.pthread_kill(main_thread, number)  # a wait of the main thread ends, too
            is_over.wait(AGAIN_S)

    main_thread = threading.get_ident()  # only it may set handlers
    hook, sys.unraisablehook = sys.unraisablehook, notice
    kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, end) for number in kinds}
    try:
        yield
    finally:
        is_over.set()
        sys.unraisablehook = hook
        if not keep:
            for number, handler in before.items():
                signal.signal(number, handler)
