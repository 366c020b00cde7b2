"""Additional participants on the bus: a second robot, an impostor, a sender of extreme frames."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import zip_longest
from math import inf, nan
from pathlib import Path
from typing import Any, Final, Self, TypeAlias

from checks.flood.attack_kinds import Attacker, frames, questions, wheels
from checks.harness.bus_calls import await_subscribers
from checks.harness.in_process import InProcess
from checks.harness.processes import free_port, tls_of
from checks.harness.until import until
from protocol.bus.bus import Bus
from protocol.bus.network import Network
from protocol.topics import OPERATOR, SONAR, STOP, TELEOP, WHEELS, Role, Topic
from protocol.wire.codec import Encoder
from protocol.wire.message import LAYOUT, Field, Message

IMPOSTOR: Final = "robot-r2"
IMPOSTOR_SENDS: Final = (frames, questions, wheels)

Turn: TypeAlias = list[tuple[Topic[Any], bytes]]
"""The frames of one tick, at most one per topic: the robot reads the newest."""

READ: Final[tuple[Topic[Any], ...]] = (SONAR, WHEELS, OPERATOR, TELEOP)
RECEIVED: Final[tuple[Topic[Any], ...]] = (*READ, STOP)
"""The topics that the robot subscribes to."""

GREATEST_FLOAT32: Final = 3.4028234e38
FLOATS: Final = (0.0, -GREATEST_FLOAT32, GREATEST_FLOAT32, nan, inf, -inf)
MATCHED_S: Final = 5.0


class Impostor:
    """Listens as a router does, without access control of its own."""

    def __init__(self, keys: Path) -> None:
        self.endpoint = f"tls/127.0.0.1:{free_port()}"
        network = Network(mode="router", listen=(self.endpoint,), tls=tls_of(keys, IMPOSTOR))
        self._attacker = Attacker(network, "ground")
        self._senders = [prepare(self._attacker) for prepare in IMPOSTOR_SENDS]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._attacker.close()

    def send(self) -> None:
        """Send one of each kind of payload that could make a robot drive."""
        for send in self._senders:
            send()


def second_robot(stack: InProcess) -> Bus:
    """Start a second robot of this name, and wait until the first has detected it."""
    second = stack.join(Role.ROBOT)
    second.announce()
    robot = stack.buses["robot"]
    until(lambda: second.zid in {peer.zid for peer in robot.present()}, "the second robot detected")
    return second


class ExtremeSender:
    """Sends frames in which one field, or all fields, have an extreme value."""

    def __init__(self, bus: Bus) -> None:
        self._publishers = {topic.path: bus.publisher(topic) for topic in RECEIVED}
        await_subscribers(bus, list(self._publishers.values()), MATCHED_S)
        self._turns = turns()
        self._turn: Turn = []

    def take_turn(self, send: Callable[[str, Callable[[], object]], object]) -> None:
        """Send the frames of the next tick; `send` publishes and waits until the robot has them."""
        self._turn = next(self._turns, [])
        self.repeat(send)

    def repeat(self, send: Callable[[str, Callable[[], object]], object]) -> None:
        """Send the frames of this tick again, so that one is the newest when the robot reads."""
        for topic, frame in self._turn:
            publisher = self._publishers[topic.path]
            send(publisher.key, partial(publisher.put_frame, frame))


def turns() -> Iterator[Turn]:
    """Yield the frames of each tick, stops last: a stopped robot ignores the other frames."""
    for topics in (READ, (STOP,)):
        for turn in zip_longest(*map(extremes, topics)):
            yield [(topic, frame) for topic, frame in zip(topics, turn, strict=True) if frame]


def extremes(topic: Topic[Any]) -> Iterator[bytes]:
    """Yield frames of a topic with each field, and all fields, at each extreme."""
    encoder = Encoder(255, 190)
    for kind in topic.messages:
        for message in extremes_of(kind):
            yield encoder.encode(message)


def extremes_of(kind: type[Message]) -> Iterator[Message]:
    """Yield messages with all fields, then with one field, at each extreme; others are 1."""
    fields = LAYOUT[kind.__name__].fields
    plain = {field.name: shaped(field, 1) for field in fields}
    for pick in (0, -1):
        yield kind(**{field.name: shaped(field, values(field)[pick]) for field in fields})
    for field in fields:
        for value in values(field):
            yield kind(**plain | {field.name: shaped(field, value)})


def values(field: Field) -> tuple[float, ...]:
    """Return the extreme values of a field."""
    return FLOATS if field.limits is None else field.limits


def shaped(field: Field, value: float) -> Any:
    """Return a value in the shape of a field: a number, a tuple, or a text of full length."""
    if field.is_text:
        return "x" * field.length
    return (value,) * field.length if field.length else value
