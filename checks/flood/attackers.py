"""Attackers as processes: on a robot's bus, and strangers without a certificate.

`python -m checks.flood.attackers KIND RATE ENDPOINT [FOLDER ROLE]` prints `ready`. It attacks after
the line `go` on its standard input, pauses after `hold`, and prints a summary when its input ends.
FOLDER and ROLE name the attacker's certificate; on an open bus it has none. Strangers make
connections that become no link, and forge stop datagrams.

The kinds of attack say what is sent repeatedly, and at which rate: replayed, broken, forged and
oversized samples and queries. A stop that is acknowledged to an attacker must have put the robot
into EMERGENCY_STOP.
"""

import json
import secrets
import socket
import ssl
import sys
import threading
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from itertools import cycle
from pathlib import Path
from random import Random
from time import monotonic, monotonic_ns
from types import MappingProxyType
from typing import Any, Final, NamedTuple, Self

import zenoh
from zenoh.handlers import Callback

from checks.harness.processes import (
    OPERATOR_BEAT,
    ToldProcess,
    auto_goal_request,
    send_when_told,
    tls_of,
)
from checks.harness.relays import TcpProxy, address_of
from protocol.bus.network import Network
from protocol.bus.rights import operator_name
from protocol.bus.robot_clock import time_bytes
from protocol.bus.session import configured
from protocol.outcome import wire_goal
from protocol.stop_datagram import Press, sealed_press
from protocol.topics import (
    ANSWERED,
    COMMAND,
    COMMANDED,
    DRIVE,
    ENCODING,
    LEASE_SERVICE,
    OPERATOR,
    PARAMETER,
    PARAMETERS,
    SONAR,
    STOP,
    STOP_SERVICE,
    TELEOP,
    TEXT,
    WHEELS,
    Service,
    Topic,
)
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import AckResult, Command, LeaseAction, Mode
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    ParamSet,
    SonarScan,
    Teleop,
    WheelCommand,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError
from runtime.units import PERIOD_NS, UINT32

OVERSIZED: Final = 2_000_000
HUGE_EVERY: Final = 32
"""Requests of which one has that size where queues are to be filled."""
GOOD_FOR_NS: Final = 1_000_000_000

FULL_MRAD_S: Final = 9000
SCAN: Final = SonarScan(
    time_ns=1_000_000, seq=1, range_mm=(50,) * 8, ping_age_us=(9,) * 8, valid=255, echo=255
)
TICKS: Final = WheelTicks(time_ns=1_000_000, seq=1, left=7, right=-9, bumper=7, expired=0)
STEER: Final = Teleop(time_ns=1, seq=1, speed_mm_s=300, yaw_rate_mrad_s=0, ttl_ms=500)

SAMPLES: Final[tuple[tuple[Topic[Any], Message], ...]] = (
    (SONAR, SCAN),
    (WHEELS, TICKS),
    (TELEOP, STEER),
    (OPERATOR, OPERATOR_BEAT),
)
COMMANDS: Final = (  # that need the lease; whoever may command may also abort
    Command.COMPONENT_ARM_DISARM,
    Command.DO_SET_MODE,
    Command.DO_PAUSE_CONTINUE,
    Command.NAV_RETURN_TO_LAUNCH,
    Command.MISSION_START,
    Command.SIDESTEP_SET_NAVIGATOR,
    Command.SIDESTEP_CLEAR_EMERGENCY_STOP,
)


class Payload(NamedTuple):
    """A sample to publish or a query to send; `path` is the key below the robot's.

    `stamped`: with the robot's time, of now for a sample, of a second from now for a request.
    """

    path: str
    content: bytes
    encoding: str = ENCODING
    stamped: bool = False

    def attachment(self, ahead_ns: int = 0) -> bytes | None:
        """Return the time of sending, if stamped; one machine has one monotonic clock."""
        return time_bytes(monotonic_ns() + ahead_ns) if self.stamped else None


def named(topic: Topic[Any] | Service, operator: str) -> str:
    """Return the path on which an operator publishes or asks."""
    return f"{topic.path}/{operator}" if topic.of_operators and operator else topic.path


def names_of(operator: str) -> tuple[str, ...]:
    """Return the operator names of an attacker: none, its own, a forged and a malformed one."""
    return "", operator, "eve/0123456789abcdef", "Not an/identity/at all"


def broken_frames(operator: str) -> list[Payload]:
    """Return frames that are replayed, corrupted, cut, random or of another protocol version."""
    random, found = Random(1), []
    for topic, message in SAMPLES:
        frame = Encoder(1, 25).encode(message)
        bad = frame[:-1] + bytes([frame[-1] ^ 1])
        others = (frame[:-3], frame + b"\0", random.randbytes(60), b"", b"\xfd" * 300)
        for path in dict.fromkeys(named(topic, name) for name in names_of(operator)):
            found += [Payload(path, one, stamped=True) for one in (frame, bad, *others)]
            found.append(Payload(path, frame, "application/mavlink2;sidestep@1"))
    return found


def forged_questions(operator: str) -> list[Payload]:
    """Return commands that need the lease, malformed queries and an oversized one."""
    random, found = Random(2), []
    encoder = Encoder(255, 190)
    for service, message in forbidden():
        frame = encoder.encode(message)
        for name in names_of(operator):
            path = named(service, name)
            found.append(Payload(path, frame, stamped=True))
            found.append(Payload(path, frame))
            found.append(Payload(path, frame[:-1], stamped=True))
            found.append(Payload(path, random.randbytes(40), ""))
    found.append(Payload(PARAMETERS.path, b"", ""))
    found.append(Payload(named(COMMAND, operator), b"\xfd" * OVERSIZED))
    return found


def forbidden() -> list[tuple[Service, Message]]:
    """Return requests that only the holder of the lease may send."""
    found: list[tuple[Service, Message]] = [(COMMAND, forged_command(n, n)) for n in COMMANDS]
    return [
        *found,
        (COMMAND, auto_goal_request(99, wire_goal(0.0, 0.0, None, 0.05, 0.009999))),
        (PARAMETER, ParamSet(param_id="v_max_m_s", param_value=0.01, param_type=9)),
        (LEASE_SERVICE, LeaseRequest(request_id=98, action=LeaseAction.TAKE, name="mallory")),
        (LEASE_SERVICE, LeaseRequest(request_id=97, action=LeaseAction.RELEASE, name="mallory")),
    ]


def forged_command(request_id: int, command: int, param1: float = 1.0) -> CommandRequest:
    """Return a command of an attacker."""
    return CommandRequest(request_id=request_id, param1=param1, param2=Mode.GUIDED, command=command)


def forged_wheels(answered: int) -> Iterable[WheelCommand]:
    """Yield wheel commands at full speed in answer to future, newest and past senses.

    `answered` is the newest sequence number of the senses.
    """
    for sense_seq in (UINT32, UINT32 - 1, answered + 100, answered + 1, answered, 0):
        for ttl_ms in (65_535, 150):
            for number in (UINT32, 0):
                yield WheelCommand(
                    time_ns=monotonic_ns(),
                    seq=number,
                    epoch=number,
                    sense_seq=sense_seq & UINT32,
                    left_mrad_s=FULL_MRAD_S,
                    right_mrad_s=FULL_MRAD_S,
                    ttl_ms=ttl_ms,
                )


SLICE_NS: Final = PERIOD_NS
"""Answers are counted by the slice of time in which they arrived."""

EARLY_NS: Final = 2 * PERIOD_NS
LATE_NS: Final = 3 * PERIOD_NS
"""Tolerance around a slice: statuses come once a tick, and another process receives them."""


class StopStatus(NamedTuple):
    """The arrival time of a status, and whether it showed EMERGENCY_STOP."""

    at_ns: int
    stopped: bool


def unfounded(accepted: Mapping[int, int], shown: Sequence[StopStatus]) -> int:
    """Return how many acknowledgements, counted by slice, no status of that time confirms.

    `shown` is in the order of arrival. The first status after that time also counts, because a busy
    machine may delay it. Without any status the acknowledgements are unfounded.
    """
    times_ns = [one.at_ns for one in shown]
    found = 0
    for number, answers in accepted.items():
        first = bisect_left(times_ns, number * SLICE_NS - EARLY_NS)
        last = bisect_left(times_ns, (number + 1) * SLICE_NS + LATE_NS)
        if not any(one.stopped for one in shown[first : last + 1]):
            found += answers
    return found


ROBOT: Final = "r1"
ACTED: Final = "acted upon"
ANSWER_S: Final = 1.0
DIAL_S: Final = 5.0
KEPT: Final = 500
"""Samples remembered for replay."""

FETCHES: Final = 5
"""One of so many queries is a request, which adds to the history."""

NEWEST: Final = 8
"""Ids of other operators that the robot still remembers."""

KEY_BYTES: Final = 60_000
DEEP: Final = "a/" * 28 + "b"
WILD: Final = "**/a/" * 14 + "**/c"
"""A key and a pattern. Zenoh 1.10 needs gigabytes and seconds to compare them."""

SHAPES: Final = cycle((DEEP, WILD))
"""One for each session: a session with both would compare them itself."""

HISTORIES: Final = (TEXT, COMMANDED, ANSWERED)


class Attacker:
    """A session of an attacker under the operator name `name`; `answers` counts the replies."""

    def __init__(self, network: Network, name: str) -> None:
        self.network = network
        self.session = open_unrestricted(network)
        self.operator = f"{name}/{self.session.zid()}"
        self.answers = Counter[str]()
        self.accepted = Counter[int]()
        """Answers that accepted a command, by time slice."""
        self._key = f"{network.prefix}/{ROBOT}"

    def close(self) -> None:
        """Close the session."""
        session: Any = self.session
        session.close()

    def put(self, payload: Payload) -> None:
        """Publish a payload."""
        self._put(payload.path, payload.content, payload.encoding, payload.attachment())

    def replay(self, sample: "Captured") -> None:
        """Publish a captured sample again."""
        self._put(sample.path, sample.payload, sample.encoding, sample.attachment)

    def ask(self, payload: Payload) -> None:
        """Send a payload as a query."""
        attachment = payload.attachment(GOOD_FOR_NS)
        self._get(payload.path, payload.content, payload.encoding, attachment)

    def replay_query(self, sample: "Captured") -> None:
        """Send a captured query again."""
        self._get(sample.path, sample.payload, sample.encoding, sample.attachment)

    def fetch(self, path: str) -> None:
        """Query the history of a topic, as a late joiner does."""
        self.session.get(
            f"{self._key}/{path}/@adv/pub/*/*/_?_max=512",
            Callback(self._count, indirect=False),
            timeout=ANSWER_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )

    def capture(self, path: str, keep: "Callable[[Captured], object]") -> None:
        """Subscribe; access control may drop the samples."""
        key = f"{self._key}/{path}"
        self.session.declare_subscriber(key, Callback(self._capturing(keep), indirect=False))

    def capture_queries(self, path: str, keep: "Callable[[Captured], object]") -> None:
        """Receive queries and leave them unanswered."""
        self.session.declare_queryable(
            f"{self._key}/{path}", Callback(self._capturing(keep), indirect=False)
        )

    def declare(self, path: str) -> None:
        """Subscribe to a key expression, serve it and announce itself on it, for a moment."""
        key = f"{self._key}/{path}"
        found: list[Any] = [
            self.session.declare_subscriber(key, lambda _sample: None),
            self.session.declare_queryable(key, lambda _query: None),
            self.session.liveliness().declare_token(key),
        ]
        for one in found:
            one.undeclare()

    def _capturing(self, keep: "Callable[[Captured], object]") -> Callable[[Any], None]:
        prefix = f"{self._key}/"

        def capture(sample: Any) -> None:
            path = str(sample.key_expr).removeprefix(prefix)
            payload = b"" if sample.payload is None else sample.payload.to_bytes()
            attached = None if sample.attachment is None else sample.attachment.to_bytes()
            keep(Captured(path, payload, str(sample.encoding or ""), attached))

        return capture

    def _put(self, path: str, payload: bytes, encoding: str, attachment: bytes | None) -> None:
        self.session.put(
            f"{self._key}/{path}",
            payload,
            encoding=encoding or None,
            attachment=attachment,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def _get(self, path: str, payload: bytes, encoding: str, attachment: bytes | None) -> None:
        self.session.get(
            f"{self._key}/{path}",
            Callback(self._count, indirect=False),
            payload=payload,
            encoding=encoding or None,
            attachment=attachment,
            timeout=ANSWER_S,
        )

    def _count(self, reply: zenoh.Reply) -> None:
        word = "unanswered" if reply.ok is None else outcome_of(reply.ok)
        self.answers[word] += 1
        if word == ACTED:
            self.accepted[(monotonic_ns() // SLICE_NS)] += 1


def open_unrestricted(network: Network) -> zenoh.Session:
    """Open a session without an access list of its own."""
    config = configured(network, DIAL_S)
    config.insert_json5("access_control", '{"enabled": false}')
    return zenoh.open(config)


class Captured(NamedTuple):
    """A sample or a query of another session, to be replayed."""

    path: str
    payload: bytes
    encoding: str
    attachment: bytes | None


def outcome_of(sample: zenoh.Sample) -> str:
    """Return the outcome of a query: acted upon, or the reason why not."""
    if str(sample.encoding) != ENCODING:
        return "looked"
    answer = decode(sample.payload.to_bytes()).message
    if not isinstance(answer, CommandAck):
        return "answered"
    if answer.result == AckResult.ACCEPTED:
        return ACTED
    return Reason(answer.result_param2).name.lower()


Send = Callable[[], object]


def frames(attacker: Attacker) -> Send:
    """Return a sender of replayed, broken and forged frames."""
    supply = cycle(broken_frames(attacker.operator))
    return lambda: attacker.put(next(supply))


def questions(attacker: Attacker) -> Send:
    """Return a sender of forged and malformed requests."""
    supply = cycle(forged_questions(attacker.operator))
    return lambda: attacker.ask(next(supply))


def queues(attacker: Attacker) -> Send:
    """Return a sender of what fills queues: requests, long answers, and a line of 1 Gbit/s."""
    *short, long, huge = forged_questions(attacker.operator)
    turns = [huge, *(one for pair in zip(short[: HUGE_EVERY // 2], cycle([long])) for one in pair)]
    supply = cycle(turns)
    return lambda: attacker.ask(next(supply))


def stops(attacker: Attacker) -> Send:
    """Return a sender of emergency stops in every way, some malformed, with new and used ids."""
    encoder, used = Encoder(255, 190), deque([0, 1], KEPT)
    ways = cycle(("put", "put", "broken", "ask", "command"))
    operator = attacker.operator
    attacker.capture(f"{STOP.path}/*/*", lambda captured: used.append(id_in(captured)))

    def send() -> None:
        request_id = secrets.choice(used) if secrets.randbits(1) else secrets.randbits(64)
        frame = encoder.encode(forged_command(request_id, Command.DO_FLIGHTTERMINATION))
        match next(ways):
            case "put":
                attacker.put(Payload(named(STOP, operator), frame, stamped=True))
            case "broken":
                attacker.put(Payload(named(STOP, operator), frame[:-3]))
            case "ask":
                attacker.ask(Payload(named(STOP_SERVICE, operator), frame))
            case _:
                attacker.ask(Payload(named(COMMAND, operator), frame, stamped=True))

    return send


def replays(attacker: Attacker) -> Send:
    """Return a sender that replays the operators' samples and queries, except their stops."""
    samples, queries = deque[Captured](maxlen=KEPT), deque[Captured](maxlen=KEPT)
    for topic in (OPERATOR, TELEOP):
        attacker.capture(f"{topic.path}/*/*", samples.append)
    attacker.capture_queries(f"{COMMAND.path}/*/*", queries.append)

    def send() -> None:
        if queries and secrets.randbits(1):
            attacker.replay_query(secrets.choice(queries))
        elif samples:
            attacker.replay(secrets.choice(samples))

    return send


def collisions(attacker: Attacker) -> Send:
    """Return a sender of used ids with other commands, under its own and their owners' names."""
    used, owned = deque([1], KEPT), deque[tuple[str, int]](maxlen=NEWEST)
    encoder, commands = Encoder(255, 190), cycle(COMMANDS)

    def learn(captured: Captured) -> None:
        used.append(id_in(captured))

    def learn_owned(captured: Captured) -> None:
        learn(captured)
        if used[-1]:
            owned.append((captured.path.removeprefix(f"{COMMAND.path}/"), used[-1]))

    attacker.capture(COMMANDED.path, learn)
    attacker.capture_queries(f"{COMMAND.path}/*/*", learn_owned)

    def send() -> None:
        owner, known = attacker.operator, secrets.choice(used)
        if owned and secrets.randbits(1):
            owner, known = secrets.choice(owned)
        frame = encoder.encode(forged_command(known, next(commands), 3.0))
        attacker.ask(Payload(named(COMMAND, owner), frame, stamped=True))

    return send


def readers(attacker: Attacker) -> Send:
    """Return a sender of queries with long answers, which are read slowly."""
    return lambda: attacker.ask(Payload(PARAMETERS.path, b"", ""))


def history(attacker: Attacker) -> Send:
    """Return a sender of queries for all histories, and of requests that lengthen them."""
    supply, topics = cycle(forged_questions(attacker.operator)[:16]), cycle(HISTORIES)
    turns = cycle(range(FETCHES))

    def send() -> None:
        if next(turns):
            attacker.fetch(next(topics).path)
        else:
            attacker.ask(next(supply))

    return send


def puts(attacker: Attacker) -> Send:
    """Return a sender on keys of 60 kB; with access control each refusal logs its key."""
    key = "x" * KEY_BYTES
    return lambda: attacker.put(Payload(f"{SONAR.path}/{key}", b""))


def patterns(attacker: Attacker) -> Send:
    """Return a sender of declarations that take exponential time to match each other."""
    shape = next(SHAPES)
    return lambda: attacker.declare(shape)


def wheels(attacker: Attacker) -> Send:
    """Return a sender of wheel commands at full speed that imitate the robot's."""
    newest, encoder = [0], Encoder(1, 1)

    def learn(captured: Captured) -> None:
        with suppress(RemoteError):
            message = decode(captured.payload).message
            if isinstance(message, SonarScan):
                newest[0] = message.seq

    attacker.capture(SONAR.path, learn)

    def supply() -> Any:
        while True:
            yield from forged_wheels(newest[0])

    commands = supply()
    return lambda: attacker.put(Payload(DRIVE.path, encoder.encode(next(commands))))


def id_in(captured: Captured) -> int:
    """Return the id of a request, 0 for other messages and for unreadable ones."""
    with suppress(RemoteError):
        message = decode(captured.payload).message
        if isinstance(message, CommandRequest | GoalRequest):
            return message.request_id
    return 0


class AttackKind(NamedTuple):
    """A kind of attack: what is sent, by the sessions in turn, and at which rate.

    `pauses`: the attack pauses while the operator commands the robot, because it may rightfully
    stop the robot or fill the request queue under the operator's name. `judged`: the robot must not
    act upon its requests. `bytes_per_s`: how fast it reads; 0 is unlimited.
    """

    prepare: Callable[[Attacker], Send]
    rate_hz: float
    description: str
    sessions: int = 1
    pauses: bool = False
    judged: bool = False
    bytes_per_s: float = 0.0
    locked_only: bool = False
    """An open bus has no protection against it."""


KINDS: Final[Mapping[str, AttackKind]] = {
    "frames": AttackKind(
        frames, 10_000.0, "replayed, broken and forged senses and operator frames"
    ),
    "questions": AttackKind(questions, 500.0, "forged commands, nonsense, megabytes", judged=True),
    "connections": AttackKind(frames, 50.0, "200 connections", sessions=200),
    "stops": AttackKind(stops, 3000.0, "emergency stops in every way", pauses=True),
    "replays": AttackKind(
        replays, 1000.0, "samples and queries of operators, replayed", pauses=True
    ),
    "collisions": AttackKind(
        collisions, 500.0, "known ids, other commands", pauses=True, judged=True
    ),
    "readers": AttackKind(readers, 200.0, "long answers, read at 20 kB/s", bytes_per_s=20_000.0),
    "queues": AttackKind(
        queues, 2000.0, "16 peers that ask, and read at 20 kB/s", sessions=16, bytes_per_s=20_000.0
    ),
    "history": AttackKind(history, 500.0, "the histories of all events"),
    "puts": AttackKind(puts, 170.0, "puts on keys of 60 kB"),
    "wheels": AttackKind(wheels, 2000.0, "wheel commands"),
    "patterns": AttackKind(patterns, 200.0, "hostile patterns", sessions=2, locked_only=True),
}


TURN_S: Final = 0.005
MAX_SILENT: Final = 500
DATAGRAMS: Final = "datagrams"


def tls_hello() -> bytes:
    """Return the first bytes of a TLS client."""
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    out = ssl.MemoryBIO()
    with suppress(ssl.SSLWantReadError):
        client.wrap_bio(ssl.MemoryBIO(), out).do_handshake()
    return out.read()


GREETINGS: Final[Mapping[str, bytes]] = MappingProxyType(
    {
        "garbage": b"this is no TLS 123",
        "http": b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
        "hello": tls_hello(),
        "silent": b"",
        DATAGRAMS: sealed_press(b"guessed", "r1", Press("anna", 0, 1)),
    }
)
"""What a stranger sends first. All close at once but the silent ones, which stay."""


RATES_HZ: Final[Mapping[str, float]] = MappingProxyType(
    {"garbage": 100.0, "http": 100.0, "silent": 100.0, DATAGRAMS: 1000.0}
)
"""The strangers of `bench flood`, with how often they call."""

SOURCE: Final = "127.0.0.2"


class Strangers:
    """Dials an endpoint at a rate from an address, until the block ends; `called` counts."""

    def __init__(self, endpoint: str, way: str, rate_hz: float, source: str) -> None:
        self.called = 0
        self._place, self._source = address_of(endpoint), source
        self._greeting, self._rate_hz = GREETINGS[way], rate_hz
        self._type = socket.SOCK_DGRAM if way == DATAGRAMS else socket.SOCK_STREAM
        self._kept: deque[socket.socket] = deque(maxlen=MAX_SILENT)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        for one in self._kept:
            one.close()

    def _run(self) -> None:
        begun_s = monotonic()
        while not self._over.wait(TURN_S):
            for _ in range(int((monotonic() - begun_s) * self._rate_hz) - self.called):
                self._call()
                self.called += 1

    def _call(self) -> None:
        one = socket.socket(type=self._type)
        one.setblocking(False)  # an unanswered connection must not delay the next
        with suppress(OSError):
            one.bind((self._source, 0))
            one.connect_ex(self._place)
            if self._greeting:
                one.send(self._greeting)
            else:
                self._kept.append(one)
                return
        one.close()


"""At most this much delay is made up for at once."""

ACCEPTED: Final = "accepted"


class Access:
    """The endpoint that an attacker connects to, and with `keys` the certificate of a role."""

    def __init__(self, endpoint: str, keys: Path | None = None, role: str = "") -> None:
        self.endpoint, self.keys, self.role = endpoint, keys, role

    @property
    def words(self) -> list[str]:
        """The command line arguments of this access."""
        return [self.endpoint, *([str(self.keys), self.role] if self.keys else [])]

    def network(self, endpoint: str | None = None) -> Network:
        """Return the network settings of a client, for another `endpoint` if given."""
        tls = None if self.keys is None else tls_of(self.keys, self.role)
        return Network(mode="client", connect=(endpoint or self.endpoint,), tls=tls)

    @property
    def name(self) -> str:
        """The operator name that the certificate allows; a made-up one without a certificate."""
        return operator_name(self.role if self.keys else None) or "eve"


class Attack(ToldProcess):
    """A running attacker process.

    After its end, `summary` counts what it sent and the answers, and `accepted` counts the answers
    that accepted a command, by time slice.
    """

    def __init__(self, kind: str, access: Access, rate_hz: float | None = None) -> None:
        self.kind, self.access = kind, access
        self.summary: dict[str, object] = {}
        self.accepted: dict[int, int] = {}
        rate = str(KINDS[kind].rate_hz if rate_hz is None else rate_hz)
        super().__init__("checks.flood.attackers", kind, rate, *access.words, is_nice=True)

    def end(self) -> None:
        """End the process and read its summary."""
        super().end()
        if self.last:
            self.summary = json.loads(self.last)
            accepted = self.summary.pop(ACCEPTED, {})
            assert isinstance(accepted, dict)
            self.accepted = {int(number): answers for number, answers in accepted.items()}


def open_sessions(kind: AttackKind, access: Access, scope: ExitStack) -> list[Attacker]:
    """Open the sessions of an attack, through a slow relay if its kind reads slowly."""
    endpoint = access.endpoint
    if kind.bytes_per_s:
        endpoint = scope.enter_context(TcpProxy(endpoint, kind.bytes_per_s)).endpoint
    return [Attacker(access.network(endpoint), access.name) for _ in range(kind.sessions)]


def main(arguments: Sequence[str]) -> None:
    """Attack according to the arguments until standard input ends, then print the summary."""
    name, rate_hz, endpoint, *locked = arguments
    access = Access(endpoint, Path(locked[0]), locked[1]) if locked else Access(endpoint)
    kind = KINDS[name]
    with ExitStack() as scope:
        attackers = open_sessions(kind, access, scope)
        sends = cycle([kind.prepare(one) for one in attackers])
        sent = send_when_told(lambda: next(sends)(), float(rate_hz))
        answers = sum((one.answers for one in attackers), Counter[str]())
        accepted = sum((one.accepted for one in attackers), Counter[int]())
        print(json.dumps({"sent": sent, **answers, ACCEPTED: accepted}), flush=True)
        for one in attackers:
            one.close()


if __name__ == "__main__":
    main(sys.argv[1:])
