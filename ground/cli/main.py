"""The operator's command line: one verb, its exit code, and every error in one line."""

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

from ground.cli.verbs import VERBS, parser_of
from ground.text.output import Output
from protocol.options import numbers_kept
from runtime.errors import ConfigError, RemoteError, UserError

EXIT_NOT: Final = 1
EXIT_USAGE: Final = 2
EXIT_SIGNAL: Final = 128


class Interrupted(KeyboardInterrupt):
    """A signal asks the process to end; everything in the way of `finally` is still done."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def main(argv: Sequence[str]) -> int:
    """Run one verb; 0 reached or done, 1 not, 2 usage or configuration, 128 + n signal n."""
    try:
        options = parse(argv)
    except SystemExit as done:
        return 0 if done.code in (0, None) else EXIT_USAGE
    says = Output(as_json=options.json)
    try:
        with signals():
            return VERBS[options.verb].run(options, says)
    except KeyboardInterrupt as error:
        number = error.number if isinstance(error, Interrupted) else signal.SIGINT
        return failed(says, options.verb, "interrupted", EXIT_SIGNAL + number)
    except (UserError, ConfigError) as error:
        return failed(says, options.verb, str(error), EXIT_USAGE)
    except RemoteError as error:
        code = getattr(error, "exit_code", EXIT_NOT)
        return failed(says, options.verb, str(error), code)


def parse(argv: Sequence[str]) -> Any:
    """Raises SystemExit, after saying why, as argparse does."""
    word = argv[0] if argv else ""
    if word not in VERBS:
        print(f"sidestep: no such verb: {word!r}; known: {', '.join(VERBS)}", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)
    verb = VERBS[word]
    found = argparse.Namespace(verb=word) if verb.words is None else verb.words(word)
    return parser_of(verb, word).parse_args(numbers_kept(argv[1:]), found)


def failed(says: Output, verb: str, why: str, code: int) -> int:
    """The error in a line, and with --json also as the one object that was promised."""
    says.note(f"sidestep {verb}: {why}")
    if says.as_json and not says.told:
        says.result({"verb": verb, "ok": False, "reason": why, "exit_code": code}, "")
    return code


@contextmanager
def signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the verb as Ctrl-C does."""

    def end(number: int, _: FrameType | None) -> None:
        raise Interrupted(number)

    kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, end) for number in kinds}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
