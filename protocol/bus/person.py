"""The person to whom the programs of one user on one computer belong, on an open bus.

Nothing is stored: the programs find the same person because they ask the same system.
"""

import hashlib
import os
import pwd
import re
import socket
import uuid
from contextlib import suppress
from pathlib import Path
from typing import Final

from protocol.topic import MAX_PERSON, PERSON, PERSON_RULE
from runtime.errors import UserError

VARIABLE: Final = "SIDESTEP_PERSON"
"""Names the person in the environment: for containers of one user, and for users of one login."""

GATEWAY: Final = "gateway"
BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
DIGITS: Final = 8


def person_here() -> str:
    """Return the person of this process on an open bus: by SIDESTEP_PERSON, else LOGIN-DIGITS.

    Raises UserError for a name that is not valid.
    """
    named = os.environ.get(VARIABLE)
    return checked_person(named, VARIABLE) if named else with_digits(login_name())


def gateway_here() -> str:
    """Return the person that a MAVLink gateway of this user is: its clients are others."""
    return with_digits(GATEWAY)


def checked_person(name: str, what: str = "person") -> str:
    """Return the name; raise UserError unless a key may contain it as that of a person."""
    if not re.fullmatch(PERSON, name):
        raise UserError(f"{what} {name!r}: {PERSON_RULE}, as in 'ada'")
    return name


def with_digits(name: str) -> str:
    """Return the name, shortened, with digits that tell users and computers apart."""
    facts = f"{os.getuid()} {socket.gethostname()} {boot_id()}".encode()
    plain = re.sub(r"[^A-Za-z0-9_-]", "_", name)[: MAX_PERSON - DIGITS - 1]
    return f"{plain}-{hashlib.sha256(facts).hexdigest()[:DIGITS]}"


def login_name() -> str:
    """Return the login name, also of a user without an account, as in a container."""
    with suppress(KeyError):
        return pwd.getpwuid(os.getuid()).pw_name
    return f"user{os.getuid()}"


def boot_id() -> str:
    """Return the id of this start of the kernel, else that of the network hardware."""
    with suppress(OSError):
        return BOOT_ID.read_text(encoding="ascii").strip()
    return str(uuid.getnode())
