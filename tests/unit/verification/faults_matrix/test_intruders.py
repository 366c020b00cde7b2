"""Frames with extreme values: all of them can be read, and none is left out."""

from math import isinf, isnan

import pytest

from protocol.topics import STOP
from protocol.wire.codec import decode
from protocol.wire.layout import LAYOUT
from protocol.wire.messages import CommandRequest, SonarScan, Teleop, WheelTicks
from verification.faults_matrix.intruders import HEARD, READ, extremes, extremes_of, turns


@pytest.mark.parametrize("kind", [SonarScan, WheelTicks, Teleop, CommandRequest])
def test_each_field_is_at_each_of_its_limits(kind: type[SonarScan]) -> None:
    found = list(extremes_of(kind))
    for field in LAYOUT[kind.__name__].fields:
        values = [getattr(message, field.name) for message in found]
        numbers = [value[0] if field.length else value for value in values]
        if field.limits is None:
            assert any(map(isnan, numbers))
            assert any(map(isinf, numbers))
        else:
            assert (min(numbers), max(numbers)) == field.limits


@pytest.mark.parametrize("topic", HEARD, ids=lambda topic: topic.path)
def test_each_frame_can_be_read(topic: object) -> None:
    for frame in extremes(topic):  # type: ignore[arg-type]
        assert isinstance(decode(frame).message, topic.messages)  # type: ignore[attr-defined]


def test_all_frames_are_said_one_of_a_topic_at_a_time_and_stops_at_the_end() -> None:
    said = list(turns())
    for turn in said:
        topics = [topic.path for topic, _ in turn]
        assert len(set(topics)) == len(topics)
    assert sum(map(len, said)) == sum(len(list(extremes(topic))) for topic in HEARD)
    first = next(number for number, turn in enumerate(said) if turn[0][0] is STOP)
    assert all(turn[0][0] is STOP for turn in said[first:])
    assert {topic.path for turn in said[:first] for topic, _ in turn} == {one.path for one in READ}
