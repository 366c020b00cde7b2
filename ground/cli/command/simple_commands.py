"""Verbs that are one question to the robot and its answer."""

import argparse
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.client.connection import add_common, seconds
from ground.client.emergency_stop import EmergencyStop, outcome_words
from ground.client.lease_holder import who_refuses
from ground.client.link import Link
from ground.client.requests import ATTEMPTS, PATIENCE_NS, Answered, GaveUp
from ground.client.vocabulary import NAVIGATORS, SIDES, why
from ground.text.output import Says
from protocol.topics import STATUS, STOP
from protocol.wire.enums import Command, Mode
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_MS, NS_PER_S

STOP_NS: Final = 5_000 * NS_PER_MS
"""How long `estop` repeats an emergency stop that is not acknowledged."""


class Order(NamedTuple):
    """The command of a verb, with its parameters."""

    command: Command
    param1: float = 0.0
    param2: float = 0.0


ORDERS: Final[Mapping[str, Order]] = MappingProxyType(
    {
        "hold": Order(Command.DO_PAUSE_CONTINUE, 0.0),
        "resume": Order(Command.DO_PAUSE_CONTINUE, 1.0),
        "abort": Order(Command.SIDESTEP_ABORT_GOAL),
        "clear-estop": Order(Command.SIDESTEP_CLEAR_EMERGENCY_STOP),
        "arm": Order(Command.COMPONENT_ARM_DISARM, 1.0),
        "disarm": Order(Command.COMPONENT_ARM_DISARM, 0.0),
        "rtl": Order(Command.NAV_RETURN_TO_LAUNCH),
    }
)


def arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser)
    parser.add_argument(
        "--timeout", type=seconds, metavar="S", help="give up after this long, in three tries (1.5)"
    )


def mode_arguments(parser: argparse.ArgumentParser) -> None:
    names = [mode.name.lower() for mode in Mode]
    parser.add_argument("mode", type=str.lower, choices=names, help=", ".join(names))
    arguments(parser)


def navigator_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("navigator", type=str.lower, choices=list(NAVIGATORS))
    parser.add_argument(
        "side", nargs="?", type=str.lower, choices=list(SIDES), help="on which obstacles are passed"
    )
    arguments(parser)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    return give(options, link, says, ORDERS[options.verb])


def estop_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser)
    parser.add_argument(
        "--timeout", type=seconds, metavar="S", help="repeat it for so long until it shows (5)"
    )


def act_estop(options: argparse.Namespace, link: Link, says: Says) -> int:
    """Stop the robot; 0 when its status shows the stop, 1 when it does not."""
    with link.hearing(STATUS) as telemetry:
        publisher = link.bus.publisher(STOP, link.robot)
        stop = EmergencyStop(
            link.bus, publisher, link.robot, link.clock, lambda: telemetry.latest(STATUS)
        )
        for_ns = STOP_NS if options.timeout is None else round(options.timeout * NS_PER_S)
        outcome = stop.run(give_up_ns=for_ns)
        silent = telemetry.latest(STATUS) is None
    if silent:
        raise link.unanswered(GaveUp(outcome.why))
    found: dict[str, object] = {
        "verb": "estop",
        "robot": link.robot,
        "ok": outcome.acknowledged,
        "reason": reason_text(Reason.NONE) if outcome.acknowledged else outcome.why,
        "reason_code": 0 if outcome.acknowledged else None,
        "took_ms": round(outcome.took_ns / NS_PER_MS, 3),
    }
    says.result(found, outcome_words(outcome, link.robot))
    return 0 if outcome.acknowledged else 1


def act_mode(options: argparse.Namespace, link: Link, says: Says) -> int:
    mode = Mode[options.mode.upper()]
    return give(options, link, says, Order(Command.DO_SET_MODE, 1.0, float(mode)))


def act_navigator(options: argparse.Namespace, link: Link, says: Says) -> int:
    side = float(SIDES.get(options.side, 0))
    number = float(NAVIGATORS[options.navigator])
    return give(options, link, says, Order(Command.SIDESTEP_SET_NAVIGATOR, number, side))


def give(options: argparse.Namespace, link: Link, says: Says, order: Order) -> int:
    """Ask and tell; 0 when the robot agrees, 1 when it refuses or nobody answers."""
    request = link.command(order.command, order.param1, order.param2)
    attempts, patience_ns = pace(options.timeout)
    answered = link.ask(request, attempts=attempts, patience_ns=patience_ns)
    return tell(says, options.verb, link, answered)


def pace(timeout_s: float | None) -> tuple[int, int]:
    """Return how often to ask and how long to wait each time, in ns."""
    if timeout_s is None:
        return ATTEMPTS, PATIENCE_NS
    return ATTEMPTS, max(1, round(timeout_s * NS_PER_S / ATTEMPTS))


def tell(says: Says, verb: str, link: Link, answered: Answered) -> int:
    """The answer as the verb's result; 0 when the robot agrees."""
    took_ms = answered.took_ns / NS_PER_MS
    found: dict[str, object] = {
        "verb": verb,
        "robot": link.robot,
        "ok": answered.ok,
        "reason": answered.text,
        "reason_code": answered.reason,
        "took_ms": round(took_ms, 3),
    }
    text = f"ok {took_ms:.0f} ms"
    if not answered.ok:
        text = f"refused: {why(answered, who_refuses(link, answered.reason))}"
    says.result(found, text)
    return 0 if answered.ok else 1
