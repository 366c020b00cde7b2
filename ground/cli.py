"""The operator's command line: a table from verb to the module that does it."""

import argparse
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType, MappingProxyType
from typing import Final, NamedTuple

from ground import doctor, goto, orders, param, record, router, up, watch
from ground.says import Says
from protocol.errors import ConfigError, RemoteError, UserError
from protocol.options import numbers_kept

EXIT_NOT: Final = 1
EXIT_USAGE: Final = 2
EXIT_SIGNAL: Final = 128


class Verb(NamedTuple):
    """How to read its arguments and how to do it; `run` returns the exit code."""

    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace, Says], int]
    says: str


VERBS: Final[Mapping[str, Verb]] = MappingProxyType(
    {
        "up": Verb(up.arguments, up.run, "start plant, robot and a goal, and tell how it ended"),
        "goto": Verb(goto.arguments, goto.run, "drive to X Y [DEG] and wait for the outcome"),
        "hold": Verb(orders.arguments, orders.run, "stand still, keep the goal"),
        "resume": Verb(orders.arguments, orders.run, "go on to the goal"),
        "abort": Verb(orders.arguments, orders.run, "drop the goal and stand still"),
        "estop": Verb(orders.arguments, orders.run, "emergency stop, latched"),
        "clear-estop": Verb(orders.arguments, orders.run, "release the emergency stop"),
        "arm": Verb(orders.arguments, orders.run, "let the wheels turn"),
        "disarm": Verb(orders.arguments, orders.run, "do not let the wheels turn"),
        "rtl": Verb(orders.arguments, orders.run, "drive back along the robot's own trail"),
        "mode": Verb(orders.mode_arguments, orders.run_mode, "choose the mode"),
        "navigator": Verb(orders.navigator_arguments, orders.run_navigator, "choose the navigator"),
        "param": Verb(param.arguments, param.run, "read and set the robot's parameters"),
        "watch": Verb(watch.arguments, watch.run, "show what the robot says, line by line"),
        "ground": Verb(watch.ground_arguments, watch.run_ground, "an operator without a screen"),
        "doctor": Verb(doctor.arguments, doctor.run, "say what is missing and what to do"),
        "router": Verb(router.arguments, router.run, "a Zenoh router, until told to stop"),
        "record": Verb(record.arguments, record.run, "write every frame to a .tlog file"),
        "export": Verb(record.export_arguments, record.run_export, "a .tlog file as CSV"),
    }
)


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
    says = Says(as_json=options.json)
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


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Raises SystemExit, after saying why, as argparse does."""
    word = argv[0] if argv else ""
    if word not in VERBS:
        print(f"sidestep: no such verb: {word!r}; known: {', '.join(VERBS)}", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)
    verb = VERBS[word]
    parser = argparse.ArgumentParser(
        prog=f"sidestep {word}", description=verb.says, allow_abbrev=False
    )
    verb.arguments(parser)
    return parser.parse_args(numbers_kept(argv[1:]), argparse.Namespace(verb=word))


def failed(says: Says, verb: str, why: str, code: int) -> int:
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
