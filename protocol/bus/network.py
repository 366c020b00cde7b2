"""Network configuration of a process: endpoints, certificates, and the person that it belongs to.

The person on an open bus, to whom the programs of one user on one computer belong, is stored
nowhere: the programs find the same person because they ask the same system.
"""

import hashlib
import os
import pwd
import re
import socket
import uuid
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Final, Literal

from protocol.bus.link_faults import LinkFaults
from protocol.topic import MAX_PERSON, PERSON, PERSON_RULE, operator_called, robot_name
from runtime.errors import EndpointError, UserError

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


def without_digits(person: str) -> str:
    """Return the name in a person, without the digits that an open bus has added."""
    name, _, digits = person.rpartition("-")
    is_added = re.fullmatch(rf"[0-9a-f]{{{DIGITS}}}", digits)
    return name if name and is_added else person


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


Mode = Literal["client", "peer", "router"]
EXAMPLE = "tcp/127.0.0.1:7447"
LOCKED = "tls/"
MAX_ROBOTS = 100
MAX_OPERATORS = 20
LEASE_MS = 1000
MAX_PORT = 65_535
DEFAULT_ROBOTS = tuple(f"r{number}" for number in range(1, 21))


class Hub(Enum):
    """State of the link to the processes that a session has dialled."""

    ROUTER = "a router"
    PEER = "a peer"
    HANGS = "accepts the connection and does not answer"
    ENDED = "refuses the connection"
    UNREACHABLE = "no reply"

    @property
    def linked(self) -> bool:
        """Return whether there is a link."""
        return self in (Hub.ROUTER, Hub.PEER)


@dataclass(frozen=True, kw_only=True)
class Tls:
    """The `[network.tls]` table: paths of PEM files, relative to the configuration file.

    `ca` is the certificate authority, `certificate` and `key` identify this process. A robot or
    router that listens logs the connections it refuses (`tell_refusals`); this adds about 0.1 ms
    between sensor data and wheel command.
    """

    ca: str
    certificate: str
    key: str
    tell_refusals: bool = True

    def __post_init__(self) -> None:
        for name in ("ca", "certificate", "key"):
            if not getattr(self, name):
                raise UserError(f"{name} is empty: name the PEM file, as `sidestep keys new` does")


@dataclass(frozen=True, kw_only=True)
class Network:
    """The `[network]` table. On one machine the robot is a listening peer that the others dial.

    With `tls` all links use mutual TLS, and a listening process permits only what each certificate
    allows. `robots` are the valid names of robots. `operators` are the names of operators that have
    a certificate of their own, `ground-NAME`. Certificates named in `revoked` have no permissions,
    however long they are valid. A `patient` process, in simulated time, waits for a slow reader
    instead of dropping what it sends. A link ends if nothing arrives on it for `lease_ms`.
    `stop_at` has the HOST:PORT at which each robot receives stop datagrams, by default that of its
    own listening endpoint. `person` is who commands from here on an open bus; by default the user
    on this computer.
    """

    mode: Mode = "peer"
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    prefix: str = "sidestep"
    connect_timeout_s: float = 5.0
    tls: Tls | None = None
    robots: tuple[str, ...] = DEFAULT_ROBOTS
    operators: tuple[str, ...] = ()
    revoked: tuple[str, ...] = ()
    trouble: LinkFaults | None = None
    patient: bool = False
    lease_ms: int = LEASE_MS
    stop_at: dict[str, str] = field(default_factory=dict)
    person: str = ""

    def __post_init__(self) -> None:
        for endpoint in (*self.listen, *self.connect):
            check_endpoint(endpoint)
            check_lock(endpoint, locked=self.tls is not None)
        for robot in self.robots:
            robot_name(robot)
        check_operators(self.operators)
        if self.person and checked_person(self.person) and self.tls is not None:
            raise UserError(
                f"person {self.person!r}: remove it, because with [network.tls] the certificate"
                " names the operator"
            )
        for robot, address in self.stop_at.items():
            robot_name(robot)
            if not has_port(address):
                raise EndpointError(
                    f"stop_at {robot}: {address!r}: write it as HOST:PORT, such as 127.0.0.1:7448"
                )
        if self.mode == "client" and not self.connect:
            raise EndpointError(f"a client needs an endpoint to connect to, such as {EXAMPLE}")
        if self.mode == "router" and not self.listen:
            raise EndpointError(f"a router needs an endpoint to listen on, such as {EXAMPLE}")
        if not self.prefix or set(self.prefix) & set("*$#?@") or "//" in f"/{self.prefix}/":
            raise EndpointError(f"prefix {self.prefix!r}: use a plain key such as 'sidestep'")


def check_operators(names: Sequence[str]) -> None:
    """Raise UserError unless the names are valid, distinct and not too many."""
    for name in names:
        operator_called(name)
    if len(set(names)) < len(names):
        raise UserError(f"operators {' '.join(names)}: each operator needs a name of its own")
    if len(names) > MAX_OPERATORS:
        raise UserError(f"{len(names)} operators: at most {MAX_OPERATORS} are supported")


def check_endpoint(endpoint: str) -> None:
    """Raise EndpointError unless it has the form tcp/127.0.0.1:7447 (or a socket path)."""
    protocol, slash, address = endpoint.partition("/")
    if protocol not in PROTOCOLS or not slash or not address:
        known = ", ".join(PROTOCOLS)
        raise EndpointError(f"endpoint {endpoint!r}: write it as {EXAMPLE}; protocols: {known}")
    if protocol == "unixsock-stream":
        return
    if not has_port(address.partition("#")[0].partition("?")[0]):
        raise EndpointError(f"endpoint {endpoint!r}: needs a host and a port, as in {EXAMPLE}")


def has_port(address: str) -> bool:
    """Return whether an address has the form HOST:PORT."""
    host, _, port = address.rpartition(":")
    return bool(host) and port.isascii() and port.isdecimal() and int(port) <= MAX_PORT


def check_lock(endpoint: str, *, locked: bool) -> None:
    """Raise EndpointError for TLS without a key, and for a mix of endpoints with and without."""
    if locked and not endpoint.startswith(LOCKED):
        raise EndpointError(
            f"endpoint {endpoint!r} has no TLS, but there is a [network.tls]: "
            f"write it as {LOCKED}HOST:PORT, or remove [network.tls]"
        )
    if locked and "#" in endpoint:
        raise EndpointError(
            f"endpoint {endpoint!r}: remove the part from '#' on, [network.tls] replaces it"
        )
    if not locked and endpoint.startswith(LOCKED):
        raise EndpointError(
            f"endpoint {endpoint!r} needs [network.tls] with ca, certificate and key: "
            "`sidestep keys new DIR` makes them, --config DIR/ROLE.toml uses them"
        )


PROTOCOLS = ("tcp", "udp", "tls", "quic", "unixsock-stream")
"""Not `ws`: Zenoh does not look at the Origin, so any web page could open a session."""
