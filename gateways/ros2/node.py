"""ROS 2 nodes on a Zenoh session of their own: publishers, subscribers and services.

The session is a client of a router: a router of ROS does not forward between peers, but always to
and from clients. It may not be there yet, so a thread dials it; once there is a session, Zenoh
itself joins the router again after a restart, with all that was declared.

Zenoh's threads only store what arrives. It is decoded, and handled, on the event loop. What cannot
be decoded, or lacks an attachment, is dropped and counted.
"""

import asyncio
import json
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final, Protocol

import zenoh
from zenoh import ext

from gateways.ros2.interfaces import Interfaces
from gateways.ros2.wire import (
    GRAPH,
    Attachment,
    Endpoint,
    EntityKind,
    NodeName,
    TokenParts,
    gid_of,
    hash_of,
    read_attachment,
    read_token,
)
from ground.client.robot_link import call_soon
from ground.ros2.offer import RELIABLE, Qos, RosTopic
from protocol.bus.callbacks import zenoh_callback
from protocol.bus.session import close_session
from runtime.errors import UserError

DEFAULT_ROUTER: Final = "tcp/localhost:7447"
DIAL_MS: Final = 500
DIAL_PAUSE_S: Final = 0.5
RETRY: Final = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2}
HEARTBEAT_S: Final = 1.0
"""Period in which a latched topic announces its newest sample, so that a loss is found."""

MAX_BYTES: Final = 1 << 17
"""Longest payload that is decoded: a thousand waypoints, read in 16 ms at most."""

MAX_QUERIES: Final = 64
"""Queries of a service that wait for their answers; more are refused."""

TOO_MANY: Final = "too many requests wait for an answer"
HIDDEN: Final = "/_"
"""Begins a part of a name that is not shown, and not recorded: those of actions."""

MAX_TOKENS: Final = 10_000
"""Entities of others that are followed."""

Take = Callable[[Any, Attachment], None]
"""Receives a message and what came beside it, on the event loop."""

Record = Callable[[RosTopic, bytes], None]
"""Takes what is published; called on the event loop."""

Serve = Callable[[Any, Attachment], Awaitable[Any]]
"""Answers a request, on the event loop."""


def session_config(environment: Mapping[str, str], router: str | None) -> zenoh.Config:
    """Return the settings of a session, as ROS users set them in the environment.

    `ZENOH_SESSION_CONFIG_URI` is a file, `ZENOH_CONFIG_OVERRIDE` has assignments separated by
    semicolons. `router` is the endpoint of the command line. Raises UserError for a wrong one.
    """
    file = environment.get("ZENOH_SESSION_CONFIG_URI", "")
    try:
        config = zenoh.Config.from_file(file.removeprefix("file://")) if file else zenoh.Config()
        if not file:
            config.insert_json5("connect/endpoints", json.dumps([DEFAULT_ROUTER]))
            config.insert_json5("transport/shared_memory/enabled", "false")
        for words in filter(None, environment.get("ZENOH_CONFIG_OVERRIDE", "").split(";")):
            key, _, value = words.partition("=")
            config.insert_json5(key.strip(), value.strip())
        if router is not None:
            config.insert_json5("connect/endpoints", json.dumps([router]))
        needed: dict[str, object] = {
            "mode": "client",
            "listen/endpoints": [],
            "connect/timeout_ms": DIAL_MS,
            "connect/exit_on_failure": True,
            "connect/retry": RETRY,
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,
        }
        for key, setting in needed.items():
            config.insert_json5(key, json.dumps(setting))
        endpoints = json.loads(config.get_json("connect/endpoints"))
    except (zenoh.ZError, OSError, ValueError) as error:
        raise UserError(f"the settings of the ROS 2 network: {error}") from error
    if not endpoints:
        raise UserError("the settings of the ROS 2 network name no router to connect to")
    return config


def domain_in(environment: Mapping[str, str]) -> int:
    """Return the domain of `ROS_DOMAIN_ID`, 0 without it; UserError for what is none."""
    text = environment.get("ROS_DOMAIN_ID", "") or "0"
    if not (text.isascii() and text.isdecimal() and int(text) <= 232):
        raise UserError(f"ROS_DOMAIN_ID {text!r}: use a number from 0 to 232")
    return int(text)


class Entity(Protocol):
    """What is declared on a session as soon as there is one."""

    def declare(self, session: zenoh.Session) -> None:
        """Declare it; called once, in the thread that has opened the session."""


class RosSession:
    """The nodes of this process, on one session.

    `note` is told in words, from any thread, when the router is missed and when it is found.
    """

    def __init__(
        self,
        interfaces: Interfaces,
        config: zenoh.Config,
        domain: int = 0,
        note: Callable[[str], None] = lambda _: None,
        others: Sequence[Interfaces] = (),
        record: Record | None = None,
    ) -> None:
        self.interfaces, self.record = interfaces, record
        self.variants = (interfaces, *others)
        """Those of each distribution that may be on the network."""

        self.domain = domain
        self.loop = asyncio.get_running_loop()
        self.rejected = 0
        """Samples and queries that were dropped, because they were malformed."""

        self._config, self._note = config, note
        self._session: zenoh.Session | None = None
        self._zid = ""
        self._entities: list[Entity] = []
        self._tokens: list[zenoh.LivelinessToken] = []
        self._count = 0
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._dialling = threading.Thread(target=self._dial, name="ros2 router", daemon=True)

    def start(self) -> None:
        """Begin to dial the router."""
        self._dialling.start()

    def close(self) -> None:
        """Leave the network; blocks for the time of an attempt to dial."""
        self._closing.set()
        if self._dialling.ident is not None:
            self._dialling.join()
        if self._session is not None:
            close_session(self._session)

    @property
    def is_linked(self) -> bool:
        """Whether there is a link to a router now."""
        return self._session is not None and any(self._session.info.routers_zid())

    @property
    def router(self) -> str:
        """The endpoints at which a router is looked for, as JSON."""
        return str(self._config.get_json("connect/endpoints"))

    @property
    def zid(self) -> str:
        """The id of the session; empty before there is one."""
        return self._zid

    def number(self) -> int:
        """Return a new number for a node or an endpoint."""
        self._count += 1
        return self._count - 1

    def declare(self, entity: Entity) -> None:
        """Declare an entity now, or as soon as there is a session."""
        with self._lock:
            self._entities.append(entity)
            if self._session is not None:
                entity.declare(self._session)

    def failed(self, name: str, error: Exception) -> None:
        """Note that a service could not answer."""
        self._note(f"{name}: {type(error).__name__}: {error}")

    def show(self, session: zenoh.Session, token: str) -> None:
        """Show a liveliness token while the session lasts."""
        self._tokens.append(session.liveliness().declare_token(token))

    def _declared_on(self, session: zenoh.Session) -> bool:
        """Declare all entities on a new session; return False if it has ended meanwhile."""
        with self._lock:
            self._zid = str(session.zid())  # its own tokens come back before all are declared
            try:
                for entity in self._entities:
                    entity.declare(session)
            except zenoh.ZError:
                self._tokens.clear()
                close_session(session)
                return False
            self._session = session
            return True

    def _dial(self) -> None:
        told = False
        while not self._closing.is_set():
            try:
                session = zenoh.open(self._config)
            except zenoh.ZError as error:
                if not told:
                    told = True
                    self._note(f"no ROS 2 router at {self.router} yet: {first_line(error)}")
                self._closing.wait(DIAL_PAUSE_S)
                continue
            if not self._declared_on(session):
                continue  # the router has gone again
            if told:
                self._note("the ROS 2 router is there")
            return


def first_line(error: Exception) -> str:
    """Return an error of Zenoh without the place in its sources."""
    return str(error).partition(" at /")[0].strip()


class RosNode:
    """A node, such as `/r1/sidestep`, with its topics and services."""

    def __init__(self, session: RosSession, namespace: str, name: str) -> None:
        self.session = session
        self.name = NodeName(namespace, name, session.number())
        session.declare(self)

    def declare(self, session: zenoh.Session) -> None:
        """Show the node."""
        self.session.show(session, self.name.token(self.session.domain, str(session.zid())))

    def endpoint(self, name: str, type_name: str, interfaces: Interfaces) -> Endpoint:
        """Return a topic or service with an absolute name and the hash of its type."""
        return Endpoint(self.name.resolve(name), type_name, hash_of(type_name, interfaces.distro))

    def variants(self, type_name: str) -> list[Interfaces]:
        """Return the distributions whose definitions of a type differ, the first one first."""
        by_hash: dict[str, Interfaces] = {}
        for interfaces in self.session.variants:
            by_hash.setdefault(hash_of(type_name, interfaces.distro), interfaces)
        return list(by_hash.values())

    def publisher(
        self, name: str, type_name: str, qos: Qos = RELIABLE, interfaces: Interfaces | None = None
    ) -> "RosPublisher":
        """Return a publisher of a topic."""
        return RosPublisher(self, name, type_name, qos, interfaces)

    def subscribe(
        self, name: str, type_name: str, take: Take, qos: Qos = RELIABLE
    ) -> "RosSubscriber":
        """Call `take` with each message of a topic; the oldest are dropped when too many wait."""
        return RosSubscriber(self, name, type_name, qos, take)

    def serve(
        self,
        name: str,
        type_name: str,
        serve: Serve,
        qos: Qos = RELIABLE,
        interfaces: Interfaces | None = None,
    ) -> None:
        """Answer the requests of a service."""
        RosServer(self, name, type_name, qos, serve, interfaces)


class RosEndpoint:
    """A topic or service of a node, with its token and the id that follows from it."""

    kind: EntityKind

    def __init__(
        self,
        node: RosNode,
        name: str,
        type_name: str,
        qos: Qos,
        interfaces: Interfaces | None = None,
    ) -> None:
        self.session, self.qos = node.session, qos
        self.interfaces = interfaces or node.session.interfaces
        self.endpoint = node.endpoint(name, type_name, self.interfaces)
        self.key = self.endpoint.key(self.session.domain)
        self.gid = b""
        self._node, self._number = node.name, self.session.number()

    def show(self, session: zenoh.Session) -> None:
        """Show the token of this endpoint."""
        zid, domain = str(session.zid()), self.session.domain
        token = self._node.endpoint_token(
            domain, zid, self._number, self.kind, self.endpoint, self.qos
        )
        self.gid = gid_of(token)
        self.session.show(session, token)


class RosPublisher(RosEndpoint):
    """Publishes a topic. Without a router messages are dropped, but the newest of a latched one."""

    kind = EntityKind.PUBLISHER

    def __init__(
        self,
        node: RosNode,
        name: str,
        type_name: str,
        qos: Qos,
        interfaces: Interfaces | None = None,
    ) -> None:
        super().__init__(node, name, type_name, qos, interfaces)
        self._publisher: zenoh.Publisher | ext.AdvancedPublisher | None = None
        self._kept: deque[bytes] = deque(maxlen=min(qos.depth, MAX_QUERIES))
        self._sequence = 0
        self._putting = threading.Lock()
        self._record = self.session.record
        if HIDDEN in self.endpoint.name or self.interfaces is not self.session.interfaces:
            self._record = None
        self._topic = RosTopic(self.endpoint.name, type_name, qos)
        self.session.declare(self)

    def declare(self, session: zenoh.Session) -> None:
        """Declare the publisher, and publish what was kept for it."""
        self.show(session)
        with self._putting:
            if self.qos.is_latched:
                miss = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S)
                self._publisher = ext.declare_advanced_publisher(
                    session,
                    self.key,
                    congestion_control=zenoh.CongestionControl.DROP,
                    cache=ext.CacheConfig(max_samples=self.qos.depth),
                    publisher_detection=True,
                    sample_miss_detection=miss,
                )
            else:
                self._publisher = session.declare_publisher(
                    self.key, congestion_control=zenoh.CongestionControl.DROP
                )
            while self._kept:
                self._put(self._publisher, self._kept.popleft())

    @property
    def is_wanted(self) -> bool:
        """Whether a node subscribes, or may do so later to a latched topic, or it is recorded."""
        publisher: Any = self._publisher
        if self.qos.is_latched or self._record is not None:
            return True
        return bool(publisher and publisher.matching_status.matching)

    def publish(self, message: object) -> None:
        """Publish a message; never blocks. One that no node subscribes to is not even encoded."""
        if not self.is_wanted:
            return
        data = self.interfaces.encode(self.endpoint.type_name, message)
        if self._record is not None:
            self._record(self._topic, data)
        with self._putting:
            if self._publisher is not None:
                self._put(self._publisher, data)
            elif self.qos.is_latched:
                self._kept.append(data)

    def _put(self, publisher: zenoh.Publisher | ext.AdvancedPublisher, data: bytes) -> None:
        self._sequence += 1
        attachment = Attachment(self._sequence, time.time_ns(), self.gid)
        publisher.put(data, attachment=attachment.packed())


class RosSubscriber(RosEndpoint):
    """Reads a topic."""

    kind = EntityKind.SUBSCRIBER

    def __init__(self, node: RosNode, name: str, type_name: str, qos: Qos, take: Take) -> None:
        super().__init__(node, name, type_name, qos)
        self.rejected = 0
        """Samples of this topic that were dropped, because they were malformed."""

        self._take = take
        self._waiting: deque[tuple[bytes, Attachment]] = deque(maxlen=qos.depth)
        self._is_waking = False
        self._subscriber: object = None
        self.session.declare(self)

    def declare(self, session: zenoh.Session) -> None:
        """Declare the subscriber; that of a latched topic fetches what was published before."""
        self.show(session)
        arrived = zenoh_callback(self._arrived)
        if self.qos.is_latched:
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=self.qos.depth)
            self._subscriber = ext.declare_advanced_subscriber(
                session,
                self.key,
                arrived,
                history=history,
                subscriber_detection=True,
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
        else:
            self._subscriber = session.declare_subscriber(self.key, arrived)

    def _arrived(self, sample: zenoh.Sample) -> None:
        attachment = attached(sample.attachment)
        if attachment is None or len(sample.payload) > MAX_BYTES:
            self._reject()
            return
        self._waiting.append((sample.payload.to_bytes(), attachment))
        if not self._is_waking:
            self._is_waking = True
            call_soon(self.session.loop, self._drain)

    def _drain(self) -> None:
        self._is_waking = False
        while self._waiting:
            data, attachment = self._waiting.popleft()
            message = self.interfaces.decode(self.endpoint.type_name, data)
            if message is None:
                self._reject()
            else:
                self._take(message, attachment)

    def _reject(self) -> None:
        self.rejected += 1
        self.session.rejected += 1


class RosServer(RosEndpoint):
    """Answers a service. The answer to a request may take any time."""

    kind = EntityKind.SERVER

    def __init__(
        self,
        node: RosNode,
        name: str,
        type_name: str,
        qos: Qos,
        serve: Serve,
        interfaces: Interfaces | None = None,
    ) -> None:
        super().__init__(node, name, type_name, qos, interfaces)
        self._serve = serve
        self._serving: set[asyncio.Task[None]] = set()
        self._asked: deque[tuple[zenoh.Query, bytes, Attachment]] = deque()
        self._is_waking = False
        self._queryable: object = None
        self.session.declare(self)

    def declare(self, session: zenoh.Session) -> None:
        """Declare the service."""
        self.show(session)
        arrived = zenoh_callback(self._arrived)
        self._queryable = session.declare_queryable(self.key, arrived, complete=True)

    def _arrived(self, query: zenoh.Query) -> None:
        attachment = attached(query.attachment)
        payload = query.payload
        if attachment is None or payload is None or len(payload) > MAX_BYTES:
            self.session.rejected += 1
            end(query)
        elif len(self._asked) >= MAX_QUERIES:
            refuse(query, TOO_MANY)
        else:
            self._asked.append((query, payload.to_bytes(), attachment))
            if not self._is_waking:
                self._is_waking = True
                call_soon(self.session.loop, self._begin)

    def _begin(self) -> None:
        """Begin to answer what has arrived; only the event loop counts what is answered."""
        self._is_waking = False
        while self._asked:
            query, data, attachment = self._asked.popleft()
            if len(self._serving) >= MAX_QUERIES:
                refuse(query, TOO_MANY)
                continue
            task = self.session.loop.create_task(self._answer(query, data, attachment))
            self._serving.add(task)
            task.add_done_callback(self._serving.discard)

    async def _answer(self, query: zenoh.Query, data: bytes, attachment: Attachment) -> None:
        interfaces, name = self.interfaces, self.endpoint.type_name
        try:
            request = interfaces.decode(f"{name}_Request", data)
            if request is None:
                self.session.rejected += 1
                refuse(query, "the request is malformed")
                return
            response = await self._serve(request, attachment)
            answer = interfaces.encode(f"{name}_Response", response)
            beside = attachment._replace(source_ns=time.time_ns())
            query.reply(self.key, answer, attachment=beside.packed())
        except Exception as error:  # whatever went wrong, the client gets an answer, if it is there
            self.session.failed(self.endpoint.name, error)
            refuse(query, f"{type(error).__name__}: {error}")
        finally:
            end(query)


class RosClient(RosEndpoint):
    """Asks a service of another node."""

    kind = EntityKind.CLIENT

    def __init__(self, node: RosNode, name: str, type_name: str, qos: Qos = RELIABLE) -> None:
        super().__init__(node, name, type_name, qos)
        self._sequence = 0
        self._opened: zenoh.Session | None = None
        self.session.declare(self)

    def declare(self, session: zenoh.Session) -> None:
        """Show the client."""
        self.show(session)
        self._opened = session

    async def ask(self, request: object, timeout_s: float) -> Any:
        """Return the answer to a request; None if none comes in time, or it is malformed."""
        data = self.interfaces.encode(f"{self.endpoint.type_name}_Request", request)
        answer = await asyncio.to_thread(self._ask, data, timeout_s)
        if answer is None:
            return None
        return self.interfaces.decode(f"{self.endpoint.type_name}_Response", answer)

    def _ask(self, data: bytes, timeout_s: float) -> bytes | None:
        if self._opened is None:
            return None
        self._sequence += 1
        replies: Any = self._opened.get(
            self.key,
            payload=data,
            attachment=Attachment(self._sequence, time.time_ns(), self.gid).packed(),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
        )
        for reply in replies:
            if reply.ok is not None and len(reply.ok.payload) <= MAX_BYTES:
                return bytes(reply.ok.payload.to_bytes())
        return None


def attached(data: zenoh.ZBytes | None) -> Attachment | None:
    """Return the attachment of a sample or query, None for a wrong one."""
    return None if data is None else read_attachment(data.to_bytes())


def refuse(query: zenoh.Query, why: str) -> None:
    """Answer a query with an error; the client may have gone."""
    with suppress(zenoh.ZError):
        query.reply_err(why.encode())
    end(query)


def end(query: Any) -> None:
    """Tell the client that no further answer comes; the library declares no types here."""
    query.drop()


class RosGraph:
    """The nodes and endpoints of others; `appeared` and `gone` run on the event loop."""

    def __init__(
        self,
        session: RosSession,
        appeared: Callable[[TokenParts, bytes], None] = lambda _parts, _gid: None,
        gone: Callable[[TokenParts, bytes], None] = lambda _parts, _gid: None,
    ) -> None:
        self.entities: dict[bytes, TokenParts] = {}
        """The parts of each token, by the id of its entity."""

        self._session, self._appeared, self._gone = session, appeared, gone
        self._subscriber: object = None
        session.declare(self)

    def declare(self, session: zenoh.Session) -> None:
        """Follow the tokens of this domain, also those that are there already."""
        self._subscriber = session.liveliness().declare_subscriber(
            f"{GRAPH}/{self._session.domain}/**", zenoh_callback(self._changed), history=True
        )

    def _changed(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        is_there = sample.kind == zenoh.SampleKind.PUT
        call_soon(self._session.loop, self._note, token, is_there)

    def _note(self, token: str, is_there: bool) -> None:
        parts, gid = read_token(token), gid_of(token)
        if parts is None or parts.zid == self._session.zid:
            return
        if not is_there:
            if self.entities.pop(gid, None) is not None:
                self._gone(parts, gid)
        elif len(self.entities) < MAX_TOKENS and gid not in self.entities:
            self.entities[gid] = parts
            self._appeared(parts, gid)
