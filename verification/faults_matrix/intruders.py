"""Who appears on the bus of a stack in this process: a second robot, somebody who exaggerates."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import zip_longest
from math import inf, nan
from typing import Any, Final, TypeAlias

from protocol.bus.bus import Bus
from protocol.topics import OPERATOR, SONAR, STOP, TELEOP, WHEELS, Role, Topic
from protocol.wire.codec import Encoder
from protocol.wire.layout import LAYOUT, Field
from protocol.wire.message import Message
from verification.harness.inprocess import InProcess
from verification.harness.until import until

Turn: TypeAlias = list[tuple[Topic[Any], bytes]]
"""What is said within one tick, at most one frame of each topic: the robot reads the newest."""

READ: Final[tuple[Topic[Any], ...]] = (SONAR, WHEELS, OPERATOR, TELEOP)
HEARD: Final[tuple[Topic[Any], ...]] = (*READ, STOP)
"""What the robot listens to."""

GREATEST_FLOAT32: Final = 3.4028234e38
FLOATS: Final = (0.0, -GREATEST_FLOAT32, GREATEST_FLOAT32, nan, inf, -inf)
MATCHED_S: Final = 5.0


def second_robot(stack: InProcess) -> Bus:
    """Let another robot of this name appear, and wait until the first has it in view."""
    second = stack.join(Role.ROBOT)
    second.announce()
    robot = stack.buses["robot"]
    until(lambda: second.zid in {who.zid for who in robot.present()}, "the robot sees the second")
    return second


class Stranger:
    """Says frames that have, in one field or in all, a value as extreme as it may be."""

    def __init__(self, bus: Bus) -> None:
        self._publishers = {topic.path: bus.publisher(topic) for topic in HEARD}
        missing = bus.await_matched(list(self._publishers.values()), MATCHED_S)
        if missing:
            raise RuntimeError(f"nobody listens to {', '.join(missing)}")
        self._turns = turns()
        self._turn: Turn = []

    def take_turn(self, send: Callable[[str, Callable[[], object]], object]) -> None:
        """Say the frames of one tick; `send` puts something and waits until the robot has it."""
        self._turn = next(self._turns, [])
        self.repeat(send)

    def repeat(self, send: Callable[[str, Callable[[], object]], object]) -> None:
        """Say these frames once more, so that one of them is the newest when the robot reads."""
        for topic, frame in self._turn:
            publisher = self._publishers[topic.path]
            send(publisher.key, partial(publisher.put_frame, frame))


def turns() -> Iterator[Turn]:
    """The stops come last: a robot that is stopped does nothing with the others."""
    for topics in (READ, (STOP,)):
        for turn in zip_longest(*map(extremes, topics)):
            yield [(topic, frame) for topic, frame in zip(topics, turn, strict=True) if frame]


def extremes(topic: Topic[Any]) -> Iterator[bytes]:
    """Frames of a topic with each field and all of them at each extreme."""
    encoder = Encoder(255, 190)
    for kind in topic.messages:
        for message in extremes_of(kind):
            yield encoder.encode(message)


def extremes_of(kind: type[Message]) -> Iterator[Message]:
    """Messages with all fields, then with one field, at each of its extremes; the others are 1."""
    fields = LAYOUT[kind.__name__].fields
    plain = {field.name: shaped(field, 1) for field in fields}
    for pick in (0, -1):
        yield kind(**{field.name: shaped(field, values(field)[pick]) for field in fields})
    for field in fields:
        for value in values(field):
            yield kind(**plain | {field.name: shaped(field, value)})


def values(field: Field) -> tuple[float, ...]:
    return FLOATS if field.limits is None else field.limits


def shaped(field: Field, value: float) -> Any:
    """As a field has it: a number, or as many as it holds; a text is as long as it may be."""
    if field.is_text:
        return "x" * field.length
    return (value,) * field.length if field.length else value
