"""The station shows, counts or ignores any input and keeps running."""

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from ground.map.canvas import Canvas
from ground.map.drawing import draw
from ground.map.view import View
from protocol.topics import TOPICS, Topic
from protocol.wire.message import Message
from tests.support.ground.station.play import Play
from tests.support.protocol.made_up import messages_of

PublishedFrame = tuple[Topic[Any], Message]


def said(topic: Topic[Any]) -> st.SearchStrategy[PublishedFrame]:
    """Return a strategy for any message of this topic."""
    kinds = st.sampled_from(topic.messages).flatmap(messages_of)
    return kinds.map(lambda message: (topic, message))


anything = st.lists(st.sampled_from(TOPICS).flatmap(said), min_size=1, max_size=30)
noise = st.lists(st.tuples(st.sampled_from(TOPICS), st.binary(max_size=60)), max_size=30)


def look_at_all(play: Play) -> None:
    station = play.station
    station.poll()
    scene = station.scene()
    draw(scene, View.fit(scene.box(), 20, 10), Canvas(20, 10))
    loss = station.loss()
    words = [station.lease.words, station.waiting_for, station.parameters_words, station.refusal()]
    words += [line.text for line in station.log]
    words += [] if loss is None else [loss.banner(station.now_ns)]
    assert all(text.isprintable() for text in words)
    station.streams()
    station.moment()


@settings(deadline=None, max_examples=40)
@given(anything)
def test_any_message_leaves_the_station_running(messages: list[PublishedFrame]) -> None:
    play = Play().forward(0.2)
    for topic, message in messages:
        play.bus.say(topic, message)
        play.clock.advance(20_000_000)
    look_at_all(play)
    play.forward(2.0)
    look_at_all(play)


@settings(deadline=None, max_examples=40)
@given(noise)
def test_any_bytes_leave_the_station_running(frames: list[tuple[Topic[Any], bytes]]) -> None:
    play = Play().forward(0.2)
    for topic, frame in frames:
        play.bus.say_frame(topic, frame)
    look_at_all(play)
    assert play.station.loss() is None


@settings(deadline=None, max_examples=40)
@given(st.binary(max_size=200))
def test_any_answer_leaves_the_station_running(answer: bytes) -> None:
    play = Play()
    for path in play.bus.answers:
        play.bus.answers[path] = lambda _: answer
    play.forward(1.0)
    look_at_all(play)
    assert not play.station.ready
