"""The kinds of attack, each as what an attacker does again and again at a rate of its own."""

import json
import secrets
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import cycle
from time import monotonic_ns
from typing import Any, Final, NamedTuple

import zenoh
from zenoh.handlers import Callback

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
from verification.flood import presses
from verification.flood.acknowledgements import slice_of
from verification.flood.presses import Shot

ROBOT: Final = "r1"
ACTED: Final = "acted upon"
ANSWER_S: Final = 1.0
DIAL_S: Final = 5.0
KEPT: Final = 500
"""Samples remembered for replay."""

FETCHES: Final = 5
"""One of so many questions is a request, for the history to come of."""

NEWEST: Final = 8
"""Ids of others that the robot has surely not forgotten."""

KEY_BYTES: Final = 60_000
HISTORIES: Final = (TEXT, COMMANDED, ANSWERED)


class Attacker:
    """One session; `answers` counts what came back. It calls itself the operator `name`."""

    def __init__(self, network: Network, name: str) -> None:
        self.network = network
        self.session = unruly(network)
        self.operator = f"{name}/{self.session.zid()}"
        self.answers = Counter[str]()
        self.accepted = Counter[int]()
        """Answers that say that something was acted upon, by the slice of time."""
        self._key = f"{network.prefix}/{ROBOT}"

    def close(self) -> None:
        session: Any = self.session
        session.close()

    def put(self, shot: Shot) -> None:
        self._put(shot.path, shot.payload, shot.encoding, shot.attachment())

    def put_again(self, sample: "Heard") -> None:
        self._put(sample.path, sample.payload, sample.encoding, sample.attachment)

    def ask(self, shot: Shot) -> None:
        self._get(shot.path, shot.payload, shot.encoding, shot.attachment(presses.GOOD_FOR_NS))

    def ask_again(self, sample: "Heard") -> None:
        self._get(sample.path, sample.payload, sample.encoding, sample.attachment)

    def fetch(self, path: str) -> None:
        """Ask for the history of a topic, as somebody who comes late does."""
        self.session.get(
            f"{self._key}/{path}/@adv/**?_max=512",
            Callback(self._count, indirect=False),
            timeout=ANSWER_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )

    def listen(self, path: str, take: "Callable[[Heard], object]") -> None:
        """Hear whatever is put there; what may not be heard is not."""
        key = f"{self._key}/{path}"
        self.session.declare_subscriber(key, Callback(self._hearing(take), indirect=False))

    def overhear(self, path: str, take: "Callable[[Heard], object]") -> None:
        """Hear what is asked there, and leave it unanswered."""
        self.session.declare_queryable(
            f"{self._key}/{path}", Callback(self._hearing(take), indirect=False)
        )

    def _hearing(self, take: "Callable[[Heard], object]") -> Callable[[Any], None]:
        beginning = f"{self._key}/"

        def hear(sample: Any) -> None:
            path = str(sample.key_expr).removeprefix(beginning)
            payload = b"" if sample.payload is None else sample.payload.to_bytes()
            attached = None if sample.attachment is None else sample.attachment.to_bytes()
            take(Heard(path, payload, str(sample.encoding or ""), attached))

        return hear

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
        word = "unanswered" if reply.ok is None else in_a_word(reply.ok)
        self.answers[word] += 1
        if word == ACTED:
            self.accepted[slice_of(monotonic_ns())] += 1


def unruly(network: Network) -> zenoh.Session:
    """A session that keeps to no access list of its own, whoever it has dialled."""
    config = configured(network, DIAL_S)
    config.insert_json5("access_control", '{"enabled": false}')
    return zenoh.open(config)


def opened(network: Network) -> zenoh.Session:
    """Open a session that keeps to no rules of its own; fails when it is not let in."""
    config = configured(network, DIAL_S)
    config.insert_json5("access_control", json.dumps({"enabled": False}))
    return zenoh.open(config)


class Heard(NamedTuple):
    """A sample or a request of somebody else, to be sent once more."""

    path: str
    payload: bytes
    encoding: str
    attachment: bytes | None


def in_a_word(sample: zenoh.Sample) -> str:
    """What came of a question: acted upon, or why not."""
    if str(sample.encoding) != ENCODING:
        return "looked"
    answer = decode(sample.payload.to_bytes()).message
    if not isinstance(answer, CommandAck):
        return "told"
    if answer.result == AckResult.ACCEPTED:
        return ACTED
    return Reason(answer.result_param2).name.lower()


Shoot = Callable[[], object]


def frames(attacker: Attacker) -> Shoot:
    supply = cycle(presses.frames(attacker.operator))
    return lambda: attacker.put(next(supply))


def questions(attacker: Attacker) -> Shoot:
    supply = cycle(presses.questions(attacker.operator))
    return lambda: attacker.ask(next(supply))


def stops(attacker: Attacker) -> Shoot:
    """By all ways there are, readable and not, with new ids and with those that were used."""
    encoder, used = Encoder(255, 190), deque([0, 1], KEPT)
    ways = cycle(("put", "put", "broken", "ask", "command"))
    operator = attacker.operator

    def learn(heard: Heard) -> None:
        used.append(id_in(heard))

    attacker.listen(f"{STOP.path}/**", learn)

    def shoot() -> None:
        request_id = secrets.choice(used) if secrets.randbits(1) else secrets.randbits(64)
        frame = encoder.encode(presses.order(request_id, Command.DO_FLIGHTTERMINATION))
        match next(ways):
            case "put":
                attacker.put(Shot(presses.named(STOP, operator), frame, stamped=True))
            case "broken":
                attacker.put(Shot(presses.named(STOP, operator), frame[:-3]))
            case "ask":
                attacker.ask(Shot(presses.named(STOP_SERVICE, operator), frame))
            case _:
                attacker.ask(Shot(presses.named(COMMAND, operator), frame, stamped=True))

    return shoot


def replays(attacker: Attacker) -> Shoot:
    """Whatever operators say and ask, but their stops, again and again, under their names."""
    said, asked = deque[Heard](maxlen=KEPT), deque[Heard](maxlen=KEPT)
    for topic in (OPERATOR, TELEOP):
        attacker.listen(f"{topic.path}/**", said.append)
    attacker.overhear(f"{COMMAND.path}/**", asked.append)

    def shoot() -> None:
        if asked and secrets.randbits(1):
            attacker.ask_again(secrets.choice(asked))
        elif said:
            attacker.put_again(secrets.choice(said))

    return shoot


def collisions(attacker: Attacker) -> Shoot:
    """Ids that were used, with other commands: under one's own name, and as who used them."""
    used, owned = deque([1], KEPT), deque[tuple[str, int]](maxlen=NEWEST)
    encoder, commands = Encoder(255, 190), cycle(presses.COMMANDS)

    def learn(heard: Heard) -> None:
        used.append(id_in(heard))

    def learn_owned(heard: Heard) -> None:
        learn(heard)
        if used[-1]:
            owned.append((heard.path.removeprefix(f"{COMMAND.path}/"), used[-1]))

    attacker.listen(COMMANDED.path, learn)
    attacker.overhear(f"{COMMAND.path}/**", learn_owned)

    def shoot() -> None:
        owner, known = attacker.operator, secrets.choice(used)
        if owned and secrets.randbits(1):
            owner, known = secrets.choice(owned)
        request = presses.order(known, next(commands), 3.0)
        attacker.ask(Shot(presses.named(COMMAND, owner), encoder.encode(request), stamped=True))

    return shoot


def readers(attacker: Attacker) -> Shoot:
    """Long answers, asked for and hardly read."""
    return lambda: attacker.ask(Shot(PARAMETERS.path, b"", ""))


def history(attacker: Attacker) -> Shoot:
    """Everything that was told, again and again; and requests, so that there is much of it."""
    supply, topics = cycle(presses.questions(attacker.operator)[:16]), cycle(HISTORIES)
    turns = cycle(range(FETCHES))

    def shoot() -> None:
        if next(turns):
            attacker.fetch(next(topics).path)
        else:
            attacker.ask(next(supply))

    return shoot


def puts(attacker: Attacker) -> Shoot:
    """Keys of 60 kB: where doors are locked, each is refused and its key is in a line of log."""
    key = "x" * KEY_BYTES
    return lambda: attacker.put(Shot(f"{SONAR.path}/{key}", b""))


def wheels(attacker: Attacker) -> Shoot:
    """Full speed ahead, by commands that pretend to be the robot's."""
    newest, encoder = [0], Encoder(1, 1)

    def learn(heard: Heard) -> None:
        with suppress(RemoteError):
            message = decode(heard.payload).message
            if isinstance(message, SonarScan):
                newest[0] = message.seq

    attacker.listen(SONAR.path, learn)

    def supply() -> Any:
        while True:
            yield from presses.wheels(newest[0])

    commands = supply()
    return lambda: attacker.put(Shot(DRIVE.path, encoder.encode(next(commands))))


def id_in(heard: Heard) -> int:
    """Return the id of a request, 0 for what is none."""
    with suppress(RemoteError):
        message = decode(heard.payload).message
        if isinstance(message, CommandRequest | GoalRequest):
            return message.request_id
    return 0


class Kind(NamedTuple):
    """`held`: it is held while the robot is given orders, as it may stop the robot by right, or
    fill the line of requests under the operator's own name.

    `judged`: what it asks may not be acted upon. `bytes_per_s`: how fast it reads; 0: at once.
    """

    prepare: Callable[[Attacker], Shoot]
    rate_hz: float
    says: str
    sessions: int = 1
    held: bool = False
    judged: bool = False
    bytes_per_s: float = 0.0


KINDS: Final[Mapping[str, Kind]] = {
    "frames": Kind(frames, 10_000.0, "replayed, broken and forged senses and operator frames"),
    "questions": Kind(questions, 500.0, "forged commands, nonsense, megabytes", judged=True),
    "connections": Kind(frames, 50.0, "200 connections", sessions=200),
    "stops": Kind(stops, 3000.0, "emergency stops by every way", held=True),
    "replays": Kind(replays, 1000.0, "what operators said and asked, under their names", held=True),
    "collisions": Kind(collisions, 500.0, "known ids with other commands", held=True, judged=True),
    "readers": Kind(readers, 200.0, "long answers, read at 20 kB/s", bytes_per_s=20_000.0),
    "history": Kind(history, 500.0, "the histories of all events"),
    "puts": Kind(puts, 170.0, "puts on keys of 60 kB"),
    "wheels": Kind(wheels, 2000.0, "wheel commands"),
}
