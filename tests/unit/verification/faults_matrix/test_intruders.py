"""Frames with extreme values: all are readable and complete."""

from math import isinf, isnan

from checks.faults.intruders import READ, RECEIVED, extremes, extremes_of, turns
from protocol.topics import STOP
from protocol.wire.codec import decode
from protocol.wire.message import LAYOUT
from protocol.wire.messages import CommandRequest, SonarScan, Teleop, WheelTicks
from tests.support.each import each


@each("kind", [SonarScan, WheelTicks, Teleop, CommandRequest])
def test_each_field_takes_each_of_its_limits(kind: type[SonarScan]) -> None:
    found = list(extremes_of(kind))
    for field in LAYOUT[kind.__name__].fields:
        values = [getattr(message, field.name) for message in found]
        numbers = [value[0] if field.length else value for value in values]
        if field.limits is None:
            assert any(map(isnan, numbers))
            assert any(map(isinf, numbers))
        else:
            assert (min(numbers), max(numbers)) == field.limits


@each("topic", RECEIVED)
def test_each_frame_is_readable(topic: object) -> None:
    for frame in extremes(topic):  # type: ignore[arg-type]
        assert isinstance(decode(frame).message, topic.messages)  # type: ignore[attr-defined]


def test_turns_have_one_frame_per_topic_and_stops_last() -> None:
    sent = list(turns())
    for turn in sent:
        topics = [topic.path for topic, _ in turn]
        assert len(set(topics)) == len(topics)
    assert sum(map(len, sent)) == sum(len(list(extremes(topic))) for topic in RECEIVED)
    first = next(number for number, turn in enumerate(sent) if turn[0][0] is STOP)
    assert all(turn[0][0] is STOP for turn in sent[first:])
    assert {topic.path for turn in sent[:first] for topic, _ in turn} == {one.path for one in READ}
