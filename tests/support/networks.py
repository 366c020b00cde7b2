"""Small networks on loopback, open or with mutual TLS, and certificates, good and bad."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from typing import Any, Literal

import zenoh
from zenoh.handlers import Callback

from checks.harness.until import PATIENCE_S, until
from ground.certificates import CA, Authority, dialled_at
from ground.user.folders import PRIVATE_FILE
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Mode, Network, Tls
from protocol.bus.session import bound_endpoints, configured, open_session
from protocol.topics import SERVICES, TOPICS, Role

Topology = Literal["hub", "router"]
TOPOLOGIES: tuple[Topology, ...] = ("hub", "router")
prefixes = (f"test-{number}" for number in count())


class Net:
    """Robot, plant and ground on one bus; in the hub topology the robot is what others dial."""

    def __init__(self, stack: ExitStack, topology: Topology) -> None:
        self.prefix = next(prefixes)
        self._stack = stack
        listening = Network(
            mode="peer" if topology == "hub" else "router",
            listen=("tcp/127.0.0.1:0",),
            prefix=self.prefix,
        )
        first = stack.enter_context(open_bus(listening, Role.ROBOT, "r1"))
        self.endpoint = first.locator()
        self.robot = first if topology == "hub" else self.join(Role.ROBOT)
        self.plant = self.join(Role.PLANT)
        self.ground = self.join(Role.GROUND)

    def join(self, role: Role | None, robot: str = "r1") -> Bus:
        return self._stack.enter_context(self.opened(role, robot))

    def opened(self, role: Role | None, robot: str = "r1") -> Bus:
        """Return a bus that the caller closes."""
        network = Network(mode="client", connect=(self.endpoint,), prefix=self.prefix)
        return open_bus(network, role, robot)


@contextmanager
def net(topology: Topology = "hub") -> Iterator[Net]:
    with ExitStack() as stack:
        yield Net(stack, topology)


NOW = datetime.now(UTC)
DAY = timedelta(days=1)


class Keyring:
    """One authority's certificates, made when they are first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)
        self._authority = Authority(NOW - 30 * DAY, NOW + 30 * DAY)
        (folder / CA).write_bytes(self._authority.pem)

    def tls(
        self, name: str, since: datetime = NOW - DAY, until: datetime = NOW + DAY, label: str = ""
    ) -> Tls:
        """Return the certificate of a role; routers and robots are valid for this machine."""
        label = label or name
        dialled = name == "router" or name.startswith("robot-")
        if not (self._folder / f"{label}.pem").exists():
            hosts: Sequence[str] = dialled_at(name) if dialled else ()
            pair = self._authority.certify(name, hosts, (since, until))
            (self._folder / f"{label}.pem").write_bytes(pair.certificate)
            (self._folder / f"{label}.key").touch(PRIVATE_FILE)
            (self._folder / f"{label}.key").write_bytes(pair.key)
        return Tls(
            ca=str(self._folder / CA),
            certificate=str(self._folder / f"{label}.pem"),
            key=str(self._folder / f"{label}.key"),
        )

    def config(self, name: str, tls: Tls | None = None) -> Path:
        """Write the `--config` file of a role, with its own certificate or with another."""
        tls = tls or self.tls(name)
        path = self._folder / f"{name}.toml"
        path.write_text(
            f'[network.tls]\nca = "{tls.ca}"\n'
            f'certificate = "{tls.certificate}"\nkey = "{tls.key}"\n'
        )
        return path

    def expired(self, name: str) -> Tls:
        return self.tls(name, NOW - 2 * DAY, NOW - DAY, f"{name}-expired")

    def early(self, name: str) -> Tls:
        return self.tls(name, NOW + DAY, NOW + 2 * DAY, f"{name}-early")


ROBOTS = ("r1", "r2")
OPERATORS = ("ada", "bob")
FORGED = b"forged"
SESSION = "abc"
HANDSHAKE_MS = 10_000
"""Generous: on a busy machine a handshake may take seconds."""
OF_OPERATORS = frozenset(
    {topic.path for topic in TOPICS if topic.of_operators}
    | {service.path for service in SERVICES if service.of_operators}
)
"""Paths whose keys end in the identity of an operator."""


class Locked:
    """Robot r1, plant and ground; the robot or a router listens."""

    def __init__(
        self, stack: ExitStack, topology: Topology, ring: Keyring, revoked: tuple[str, ...] = ()
    ) -> None:
        self.prefix = next(prefixes)
        self.ring = ring
        self._stack = stack
        hub = topology == "hub"
        listening = Network(
            mode="peer" if hub else "router",
            listen=("tls/127.0.0.1:0",),
            prefix=self.prefix,
            robots=ROBOTS,
            operators=OPERATORS,
            revoked=revoked,
            tls=ring.tls("robot-r1" if hub else "router"),
        )
        first = self.opened(listening)
        (self.endpoint,) = bound_endpoints(first)
        self.robot = first if hub else self.member("robot-r1")
        self.plant = self.member("plant")
        self.ground = self.member("ground")

    def network(self, tls: Tls, mode: Mode = "client") -> Network:
        return Network(
            mode=mode,
            # A router has to listen somewhere, too.
            listen=("tls/127.0.0.1:0",) if mode == "router" else (),
            connect=(self.endpoint,),
            prefix=self.prefix,
            robots=ROBOTS,
            tls=tls,
            connect_timeout_s=PATIENCE_S,
        )

    def member(self, name: str) -> zenoh.Session:
        """Open a bus as one of our processes does, with all its settings."""
        return self.linked(self.opened(self.network(self.ring.tls(name))))

    def join(self, name: str, mode: Mode = "client") -> zenoh.Session:
        """Open a bare session with the certificate of that name."""
        network = self.network(self.ring.tls(name), mode)
        config = configured(network, PATIENCE_S, HANDSHAKE_MS)
        config.insert_json5("access_control", '{"enabled": false}')
        return self.linked(self.closed_later(zenoh.open(config)))

    def linked(self, session: zenoh.Session) -> zenoh.Session:
        until(lambda: list(session.info.peers_zid()) or list(session.info.routers_zid()))
        return session

    def opened(self, network: Network) -> zenoh.Session:
        return self.closed_later(open_session(network))

    def closed_later(self, session: zenoh.Session) -> zenoh.Session:
        closing: Any = session
        self._stack.callback(closing.close)
        return session

    def plain(self, path: str, robot: str = "r1") -> str:
        """Return the key of a path without the identity of any operator."""
        return f"{self.prefix}/{robot}/{path}"

    def key(self, path: str, robot: str = "r1", operator: str = "ground") -> str:
        """Return the key of a path, as this operator has it where operators publish or ask."""
        plain = self.plain(path, robot)
        return f"{plain}/{operator}/{SESSION}" if path in OF_OPERATORS else plain

    def every(self, path: str) -> str:
        """Return the key expression of a path on robot r1, of all operators."""
        return f"{self.plain(path)}/*/*" if path in OF_OPERATORS else self.plain(path)


@contextmanager
def locked(topology: Topology, folder: Path, revoked: tuple[str, ...] = ()) -> Iterator[Locked]:
    with ExitStack() as stack:
        yield Locked(stack, topology, Keyring(folder), revoked)


class Watchful:
    """Robot, plant and ground of r1 on the bus; `forged` collects what an attacker achieved."""

    def __init__(self, net: Locked) -> None:
        self.forged: list[str] = []
        self.good = 0
        for topic in TOPICS:
            for session in (net.robot, net.plant, net.ground):
                session.declare_subscriber(
                    net.every(topic.path), Callback(self._heard, indirect=False)
                )
        for service in SERVICES:
            server = net.robot if service.server is Role.ROBOT else net.plant
            server.declare_queryable(net.every(service.path), Callback(self._asked, indirect=False))

    def _heard(self, sample: zenoh.Sample) -> None:
        gone = sample.kind == zenoh.SampleKind.DELETE
        self._count(str(sample.key_expr), sample.payload.to_bytes(), gone=gone)

    def _asked(self, query: zenoh.Query) -> None:
        with query:
            payload = b"" if query.payload is None else query.payload.to_bytes()
            self._count(str(query.key_expr), payload, gone=False)
            query.reply(query.key_expr, b"done")

    def _count(self, key: str, payload: bytes, *, gone: bool) -> None:
        if gone or payload.startswith(FORGED):
            self.forged.append(f"{key} {payload!r}")
        else:
            self.good += 1


class Intruder:
    """Has a certificate, and does what it is not for; counts what it tried."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self.tried = 0
        self.answered: list[str] = []

    def put(self, key: str) -> None:
        self._session.put(key, FORGED, congestion_control=zenoh.CongestionControl.BLOCK)
        self.tried += 1

    def put_declared(self, key: str) -> None:
        """Send by a publisher whose key the subscriber already knows."""
        publisher = self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )
        publisher.put(FORGED)
        self.tried += 1

    def delete(self, key: str) -> None:
        self._session.delete(key, congestion_control=zenoh.CongestionControl.BLOCK)
        self.tried += 1

    def ask(self, key: str) -> None:
        for reply in self._session.get(key, payload=FORGED, timeout=PATIENCE_S):
            key = "" if reply.ok is None else str(reply.ok.key_expr)
            if key and str(self._session.zid()) not in key:  # of itself it may know everything
                self.answered.append(key)
        self.tried += 1

    def serve(self, key: str) -> None:
        """Answer in place of the rightful service: the answers would be forged."""

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(query.key_expr, FORGED)

        self._session.declare_queryable(key, Callback(answer, indirect=False))
        self.tried += 1

    @property
    def ways(self) -> tuple[Callable[[str], None], ...]:
        """All of its ways to reach a key, each of which can be refused."""
        return self.put, self.put_declared, self.delete, self.ask
