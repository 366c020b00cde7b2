"""Who holds the lease of a robot, and the name under which a program takes it."""

import os
import pwd
from contextlib import suppress
from socket import gethostname

from protocol.bus.network import without_digits
from protocol.topic import person_of
from protocol.wire.limits import MAX_OPERATOR_NAME_BYTES
from protocol.wire.messages import LeaseStatus
from runtime.cli.terminal import printable
from runtime.errors import UserError


def is_ours(lease: LeaseStatus, operator: str | None) -> bool:
    """Return whether a lease is held by the person of this operator's identity."""
    return bool(lease.held and operator) and person_of(lease.holder) == person_of(operator or "")


def holder_name(lease: LeaseStatus) -> str:
    """Return the name of the lease holder as one printable line."""
    return named(lease.name, lease.holder)


def named(name: str, operator: str) -> str:
    """Return a display name as a printable line, with its person if it begins with another name.

    USER@HOST may be shortened.
    """
    person = printable(without_digits(person_of(operator)))
    name = printable(name) or person
    user, at, _ = name.partition("@")
    is_own = name.startswith(person) or (user and at and person.startswith(user))
    return name if is_own else f"{name} ({person})"


def operator_name(name: str | None) -> str:
    """Return the name shown to other operators, by default USER@HOST:TERMINAL.

    Raises UserError for a name that is empty, too long or not printable.
    """
    if name is None:
        try:
            user = pwd.getpwuid(os.getuid()).pw_name
        except KeyError:
            user = "operator"
        return shortened(user, gethostname().partition(".")[0], terminal_name())
    fits = len(name.encode()) <= MAX_OPERATOR_NAME_BYTES
    if not (name.strip() and name.isprintable() and fits):
        raise UserError(
            f"{name!r} is not a valid operator name: use 1 to {MAX_OPERATOR_NAME_BYTES} bytes"
            " of printable text"
        )
    return name


def terminal_name() -> str:
    """Return the name of the terminal, or the process id without one."""
    for descriptor in (0, 1, 2):
        with suppress(OSError):
            return os.ttyname(descriptor).removeprefix("/dev/")
    return str(os.getpid())


def shortened(user: str, host: str, terminal: str) -> str:
    """Return USER@HOST:TERMINAL as ASCII; shorten the longer of user and host until it fits."""
    user, host = (text.encode("ascii", "replace").decode() for text in (user, host))
    room = max(2, MAX_OPERATOR_NAME_BYTES - len("@:") - len(terminal))
    while len(user) + len(host) > room:
        user, host = (user[:-1], host) if len(user) > len(host) else (user, host[:-1])
    return f"{user}@{host}:{terminal}"[:MAX_OPERATOR_NAME_BYTES]
