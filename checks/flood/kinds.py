"""The kinds of attack: what an attacker sends repeatedly, and at which rate."""

import secrets
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import cycle
from time import monotonic_ns
from typing import Any, Final, NamedTuple

import zenoh
from zenoh.handlers import Callback

from checks.flood import payloads
from checks.flood.acknowledgements import slice_of
from checks.flood.payloads import Payload
from protocol.bus.network import Network
from protocol.bus.session import configured
from protocol.topics import (
    ANSWERED,
    COMMAND,
    COMMANDED,
    DRIVE,
    ENCODING,
    OPERATOR,
    PARAMETERS,
    SONAR,
    STOP,
    STOP_SERVICE,
    TELEOP,
    TEXT,
)
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import AckResult, Command
from protocol.wire.messages import CommandAck, CommandRequest, GoalRequest, SonarScan
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError

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
        attachment = payload.attachment(payloads.GOOD_FOR_NS)
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
            self.accepted[slice_of(monotonic_ns())] += 1


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
    supply = cycle(payloads.frames(attacker.operator))
    return lambda: attacker.put(next(supply))


def questions(attacker: Attacker) -> Send:
    """Return a sender of forged and malformed requests."""
    supply = cycle(payloads.questions(attacker.operator))
    return lambda: attacker.ask(next(supply))


def stops(attacker: Attacker) -> Send:
    """Return a sender of emergency stops in every way, some malformed, with new and used ids."""
    encoder, used = Encoder(255, 190), deque([0, 1], KEPT)
    ways = cycle(("put", "put", "broken", "ask", "command"))
    operator = attacker.operator
    attacker.capture(f"{STOP.path}/*/*", lambda captured: used.append(id_in(captured)))

    def send() -> None:
        request_id = secrets.choice(used) if secrets.randbits(1) else secrets.randbits(64)
        frame = encoder.encode(payloads.forged_command(request_id, Command.DO_FLIGHTTERMINATION))
        match next(ways):
            case "put":
                attacker.put(Payload(payloads.named(STOP, operator), frame, stamped=True))
            case "broken":
                attacker.put(Payload(payloads.named(STOP, operator), frame[:-3]))
            case "ask":
                attacker.ask(Payload(payloads.named(STOP_SERVICE, operator), frame))
            case _:
                attacker.ask(Payload(payloads.named(COMMAND, operator), frame, stamped=True))

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
    encoder, commands = Encoder(255, 190), cycle(payloads.COMMANDS)

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
        frame = encoder.encode(payloads.forged_command(known, next(commands), 3.0))
        attacker.ask(Payload(payloads.named(COMMAND, owner), frame, stamped=True))

    return send


def readers(attacker: Attacker) -> Send:
    """Return a sender of queries with long answers, which are read slowly."""
    return lambda: attacker.ask(Payload(PARAMETERS.path, b"", ""))


def history(attacker: Attacker) -> Send:
    """Return a sender of queries for all histories, and of requests that lengthen them."""
    supply, topics = cycle(payloads.questions(attacker.operator)[:16]), cycle(HISTORIES)
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
            yield from payloads.wheels(newest[0])

    commands = supply()
    return lambda: attacker.put(Payload(DRIVE.path, encoder.encode(next(commands))))


def id_in(captured: Captured) -> int:
    """Return the id of a request, 0 for other messages and for unreadable ones."""
    with suppress(RemoteError):
        message = decode(captured.payload).message
        if isinstance(message, CommandRequest | GoalRequest):
            return message.request_id
    return 0


class Kind(NamedTuple):
    """A kind of attack: what is sent, and at which rate.

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


KINDS: Final[Mapping[str, Kind]] = {
    "frames": Kind(frames, 10_000.0, "replayed, broken and forged senses and operator frames"),
    "questions": Kind(questions, 500.0, "forged commands, nonsense, megabytes", judged=True),
    "connections": Kind(frames, 50.0, "200 connections", sessions=200),
    "stops": Kind(stops, 3000.0, "emergency stops in every way", pauses=True),
    "replays": Kind(replays, 1000.0, "samples and queries of operators, replayed", pauses=True),
    "collisions": Kind(collisions, 500.0, "known ids, other commands", pauses=True, judged=True),
    "readers": Kind(readers, 200.0, "long answers, read at 20 kB/s", bytes_per_s=20_000.0),
    "history": Kind(history, 500.0, "the histories of all events"),
    "puts": Kind(puts, 170.0, "puts on keys of 60 kB"),
    "wheels": Kind(wheels, 2000.0, "wheel commands"),
    "patterns": Kind(patterns, 200.0, "hostile patterns", sessions=2, locked_only=True),
}
