"""The lease: one operator commands the robot and everybody sees who; any may stop it at once.

It belongs to a connection and lapses with its heartbeat, so whoever takes it must stay.
"""

import argparse
import os
import pwd
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from ground.cli.command.simple_commands import tell
from ground.client.connection import add_common, seconds
from ground.client.lease_holder import lease_status, who_refuses, words_of
from ground.client.link import Link
from ground.client.requests import BEAT_NS, Answered, Asking
from ground.client.vocabulary import why
from ground.text.output import Says
from protocol.topics import LEASE_SERVICE
from protocol.wire.enums import LeaseAction
from protocol.wire.limits import MAX_OPERATOR_NAME_BYTES
from protocol.wire.messages import LeaseRequest
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_MS, NS_PER_S

RELEASE_NS: Final = 200 * NS_PER_MS
ACTIONS: Final = ("take", "release", "seize", "show")


class Held(RemoteError):
    """Another operator commands the robot: who."""

    exit_code = 1


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=ACTIONS, help="take: refused while another holds it")
    parser.add_argument("--name", metavar="N", help="what others call you (your user name)")
    parser.add_argument(
        "--for", dest="hold", type=seconds, metavar="S", help="give it back after this long"
    )
    add_common(parser)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    """`take` and `seize` keep it until Ctrl-C, unless somebody else beats for us."""
    if options.action == "show":
        return show(link, says)
    action = LeaseAction[options.action.upper()]
    name = named(options.name)
    answered = ask(link, action, name)
    if not answered.ok:
        return tell(says, f"lease {options.action}", link, answered)
    if action is LeaseAction.RELEASE or options.attended:
        return tell(says, f"lease {options.action}", link, answered)
    says.note(f"{name} commands {link.robot}; Ctrl-C gives the lease back")
    try:
        keep(link, options.hold)
    finally:
        give_back(link)
    return tell(says, f"lease {options.action}", link, answered)


def keep(link: Link, for_s: float | None) -> None:
    """Beat, for so long or until a signal comes."""
    began_ns = link.clock.now_ns()
    until_ns = None if for_s is None else began_ns + round(for_s * NS_PER_S)
    while until_ns is None or link.clock.now_ns() < until_ns:
        link.beat()
        link.clock.sleep_until(link.clock.now_ns() + BEAT_NS)


def ask(link: Link, action: LeaseAction, name: str) -> Answered:
    request = LeaseRequest(request_id=link.ids.next(), action=action, name=name)
    return link.ask(request, service=LEASE_SERVICE)


@contextmanager
def leased(link: Link, name: str | None = None) -> Iterator[None]:
    """Hold it meanwhile and give it back, whatever happens; Held says who has it already."""
    answered = ask(link, LeaseAction.TAKE, named(name))
    if not answered.ok:
        raise Held(f"refused: {why(answered, who_refuses(link, answered.reason))}")
    try:
        yield
    finally:
        give_back(link)


def give_back(link: Link) -> None:
    """Once and briefly, and nobody asks why there is no answer: without us it lapses by itself."""
    request = LeaseRequest(request_id=link.ids.next(), action=LeaseAction.RELEASE, name="")
    now_ns = link.clock.now_ns()
    link.talk(Asking(request, now_ns, attempts=1, patience_ns=RELEASE_NS), LEASE_SERVICE)


def named(name: str | None) -> str:
    """What the operator is called; UserError when it does not fit."""
    if name is None:
        try:
            name = pwd.getpwuid(os.getuid()).pw_name
        except KeyError:
            name = "operator"
        return name.encode()[:MAX_OPERATOR_NAME_BYTES].decode(errors="ignore")
    if not name.isprintable() or not 0 < len(name.encode()) <= MAX_OPERATOR_NAME_BYTES:
        raise UserError(
            f"{name!r} is no name for an operator: 1 to {MAX_OPERATOR_NAME_BYTES} letters"
        )
    return name


def show(link: Link, says: Says) -> int:
    """0 when the robot says how it stands, 1 when it does not."""
    found = lease_status(link)
    if found is None:
        raise RemoteError(f"nothing is heard of the lease: {link.diagnosis()}")
    ours = found.holder == link.bus.operator
    who = f"{words_of(found)}{' (this is you)' if ours else ''}"
    left = f", for {found.lapses_ms / 1000:.1f} s more unless heard"
    text = f"{who} commands {link.robot}{left}" if found.held else "nobody holds the lease"
    row: dict[str, object] = {
        "robot": link.robot,
        "ok": True,
        "held": bool(found.held),
        "holder": found.holder or None,
        "name": found.name or None,
        "lapses_ms": found.lapses_ms if found.held else None,
    }
    says.result(row, text)
    return 0
