"""Who dials whom, and behind which lock: how a process finds the others, as configuration."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from protocol.bus.faults.link_faults import LinkFaults
from protocol.topic import operator_called, robot_name
from runtime.errors import BadEndpoint, UserError

Mode = Literal["client", "peer", "router"]
EXAMPLE = "tcp/127.0.0.1:7447"
LOCKED = "tls/"
MAX_ROBOTS = 20
MAX_OPERATORS = 20
DEFAULT_ROBOTS = tuple(f"r{number}" for number in range(1, MAX_ROBOTS + 1))


class Hub(Enum):
    """What has become of those a process dialled: who is there, or what comes of calling them."""

    ROUTER = "a router"
    PEER = "a peer"
    HANGS = "takes the call and says nothing"
    ENDED = "refuses the call"
    UNREACHABLE = "nothing comes back"

    @property
    def linked(self) -> bool:
        return self in (Hub.ROUTER, Hub.PEER)


@dataclass(frozen=True, kw_only=True)
class Tls:
    """The `[network.tls]` table: PEM files, in a configuration file relative to where it lies.

    `ca` is whom to believe, `certificate` and `key` are who this process is. A robot or router
    that listens tells in its log whom it keeps out; that costs some 0.1 ms from sense to command.
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
    """The `[network]` table. On one machine the robot is a listening peer the others dial.

    With `tls` all links are locked, and whoever listens lets in what each certificate may do;
    `robots` are then the names of the robots that there may be, and `operators` those of the
    operators with a certificate of their own, `ground-NAME`. The holder of a certificate that is
    named in `revoked` may do nothing, however long it is valid.
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

    def __post_init__(self) -> None:
        for endpoint in (*self.listen, *self.connect):
            check_endpoint(endpoint)
            check_lock(endpoint, locked=self.tls is not None)
        for robot in self.robots:
            robot_name(robot)
        check_operators(self.operators)
        if self.mode == "client" and not self.connect:
            raise BadEndpoint(f"a client needs an endpoint to connect to, such as {EXAMPLE}")
        if self.mode == "router" and not self.listen:
            raise BadEndpoint(f"a router needs an endpoint to listen on, such as {EXAMPLE}")
        if not self.prefix or set(self.prefix) & set("*$#?@") or "//" in f"/{self.prefix}/":
            raise BadEndpoint(f"prefix {self.prefix!r}: use a plain key such as 'sidestep'")


def check_operators(names: Sequence[str]) -> None:
    """Raise UserError unless each can be an operator's name, and there are not too many."""
    for name in names:
        operator_called(name)
    if len(set(names)) < len(names):
        raise UserError(f"operators {' '.join(names)}: each operator needs a name of its own")
    if len(names) > MAX_OPERATORS:
        raise UserError(f"{len(names)} operators: there can be {MAX_OPERATORS}")


def check_endpoint(endpoint: str) -> None:
    """Raise BadEndpoint unless it reads like tcp/127.0.0.1:7447 (or a socket path)."""
    protocol, slash, address = endpoint.partition("/")
    if protocol not in PROTOCOLS or not slash or not address:
        known = ", ".join(PROTOCOLS)
        raise BadEndpoint(f"endpoint {endpoint!r}: write it as {EXAMPLE}; protocols: {known}")
    if protocol == "unixsock-stream":
        return
    host, colon, port = address.partition("#")[0].partition("?")[0].rpartition(":")
    if not (host and colon and port.isdecimal() and int(port) <= 65_535):
        raise BadEndpoint(f"endpoint {endpoint!r}: needs a host and a port, as in {EXAMPLE}")


def check_lock(endpoint: str, *, locked: bool) -> None:
    """Raise BadEndpoint for an open door among locked ones, or a lock without its key."""
    if locked and not endpoint.startswith(LOCKED):
        raise BadEndpoint(
            f"endpoint {endpoint!r} is not locked, though [network.tls] is given: "
            f"write it as {LOCKED}HOST:PORT, or leave [network.tls] out"
        )
    if locked and "#" in endpoint:
        raise BadEndpoint(
            f"endpoint {endpoint!r}: leave out what follows the '#', [network.tls] says it"
        )
    if not locked and endpoint.startswith(LOCKED):
        raise BadEndpoint(
            f"endpoint {endpoint!r} needs [network.tls] with ca, certificate and key: "
            "`sidestep keys new DIR` makes them, --config DIR/ROLE.toml uses them"
        )


PROTOCOLS = ("tcp", "udp", "tls", "quic", "ws", "unixsock-stream")
