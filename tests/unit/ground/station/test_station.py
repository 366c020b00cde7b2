"""The state of the station for its screen, for any input, live or over a recording."""

import asyncio
from collections import Counter
from math import isnan
from sys import getallocatedblocks
from time import time
from typing import Any, TypeVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checks.harness.messages import make
from ground.client.telemetry import Age
from ground.map.canvas import Canvas
from ground.map.drawing import draw
from ground.map.scene import View
from ground.station.robot.lease_state import LeaseView
from ground.station.station import Station
from protocol.topics import (
    ANSWERED,
    HEARTBEAT,
    MISSION,
    ODOMETRY,
    STATUS,
    TEXT,
    TOPICS,
    Role,
    Topic,
)
from protocol.wire.codec import Encoder
from protocol.wire.enums import GoalState, LeaseAction, Navigator, Severity
from protocol.wire.message import Message
from protocol.wire.messages import MissionStatus, ParamValue, Statustext
from runtime.clock import ManualClock
from runtime.errors import UserError
from runtime.units import NS_PER_S as S
from tests.support.ground.station import PARAMS, Play, Robot
from tests.support.messages import messages_of
from tests.support.played_bus import PlayedBus

M = TypeVar("M", bound=Message)


def test_values_dim_after_two_periods_and_vanish_after_five() -> None:
    play = Play().forward(1.0)
    found: dict[float, Age] = {}
    play.robot.loop = play.robot.senses = False
    for _ in range(8):
        seen = play.station.seen(ODOMETRY)
        assert seen.age_ns is not None
        found[seen.age_ns / 50e6] = seen.age
        play.forward(0.05)
    assert found == {
        0.0: Age.LIVE, 1.0: Age.LIVE, 2.0: Age.LIVE, 3.0: Age.DIM, 4.0: Age.DIM, 5.0: Age.DIM,
        6.0: Age.GONE, 7.0: Age.GONE,
    }  # fmt: skip


def test_stale_lease_is_unknown() -> None:
    play = Play()
    assert play.station.lease.words == "--"
    play.forward(1.0)
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(1.0)
    assert play.station.lease.words == "ours"
    play.hang()
    play.forward(3.0)
    assert play.station.lease.words == "--"
    assert not play.station.lease.ours


def shown(play: Play) -> MissionStatus | None:
    return play.station.telemetry.live(MISSION, play.station.now_ns)


def test_stale_mission_is_not_shown() -> None:
    play = Play().forward(1.0)
    assert isinstance(shown(play), MissionStatus)
    play.hang()
    play.forward(3.0)
    assert shown(play) is None


def test_robot_texts_are_logged_with_severity() -> None:
    play = Play().forward(0.5)
    play.say("obstacle ahead", severity=Severity.WARNING)
    play.forward(0.1)
    line = play.station.log.last(1)[0]
    assert (line.source, line.text, line.letter) == ("r1", "obstacle ahead", "W")
    assert line.time_s == pytest.approx(0.5)


def test_lines_of_a_live_station_have_the_clock_time() -> None:
    before_s = time()
    play = Play().forward(0.5)
    play.say("obstacle ahead", severity=Severity.WARNING)
    play.forward(0.1)
    clock_s = play.station.log.last(1)[0].clock_s
    assert clock_s is not None
    assert before_s <= clock_s - 0.5 <= time()


def test_long_text_is_one_line() -> None:
    play = Play().forward(0.5)
    for chunk, text in enumerate(("x" * 50, "end")):
        play.bus.say(TEXT, Statustext(severity=6, text=text, id=7, chunk_seq=chunk))
    play.forward(0.1)
    assert play.texts("end") == ["x" * 50 + "end"]


def test_cached_text_is_logged_with_its_age() -> None:
    play = Play().forward(0.5)
    for words, age_ns in (("started", 40_000_000_000), ("obstacle ahead", 0)):
        text = Statustext(severity=6, text=words, id=0, chunk_seq=0)
        play.bus.say(TEXT, text, at_ns=play.clock.now_ns() - age_ns)
    play.forward(0.1)
    assert [line.text for line in play.station.log.last(2)] == [
        "started (40 s ago)",
        "obstacle ahead",
    ]


def test_parameter_change_is_shown_at_once() -> None:
    play = Play().forward(1.0)
    value = make(ParamValue, param_id="d_obs_m", param_value=0.5, param_count=2)
    play.bus.say(ANSWERED, value)
    play.forward(0.05)
    rows = {row.name: row.value for row in play.station.parameters or ()}
    assert rows == PARAMS | {"d_obs_m": 0.5}
    assert play.station.parameters_words == "5"


def test_parameter_requests_are_counted() -> None:
    play = Play()
    del play.bus.answers["srv/parameters"]
    play.forward(3.0)
    words = play.station.parameters_words
    assert words.startswith("not read yet: requested 3 times, srv/parameters: no process serves it")
    assert not play.station.ready
    assert play.station.waiting_for == "parameters"


def test_malformed_parameter_list_is_reported() -> None:
    play = Play()
    play.bus.answers["srv/parameters"] = lambda _: b"[3]"
    play.forward(0.5)
    assert "item 1 is not a table" in play.station.parameters_words


def test_reread_requires_everything_again() -> None:
    play = Play().forward(1.0)
    play.station.reread()
    assert not play.station.ready
    play.forward(1.0)
    assert play.station.ready


def test_series_are_sampled_and_silence_is_a_gap() -> None:
    play = Play().forward(1.0)
    series = play.station.history["speed"]
    assert len(series.points()) == 20
    assert series.points()[2][0] == pytest.approx(0.1)
    assert play.station.history["uncertainty_m"].points()[-1][1] == pytest.approx(0.2)
    assert play.station.history["cycle_us"].points()[-1][1] == 15.0
    play.hang()
    play.forward(1.0)
    assert len(series.points()) == 21
    assert isnan(series.points()[-1][1])


def test_heartbeats_continue_for_a_robot_not_shown() -> None:
    play = Play().forward(1.0)
    play.station.queue.lease(LeaseAction.TAKE)
    play.forward(0.5)
    play.station.select("r2")
    beats = play.beats
    play.forward(1.0)
    assert play.beats >= beats + 4
    assert not play.station.lease.ours


def test_malformed_robot_name_is_rejected() -> None:
    play = Play()
    with pytest.raises(UserError, match="robot name"):
        play.station.select("R 2")
    assert play.station.robot == "r1"


def test_station_announces_itself() -> None:
    play = Play().forward(0.1)
    assert play.station.present.has("r1", Role.GROUND)


def test_station_memory_is_bounded() -> None:
    play = Play().forward(1.0)
    feed(play, 12_500)  # now every ring is full
    before = getallocatedblocks()
    feed(play, 12_600)
    assert play.station.log.total > 100_000
    assert len(play.station.log) == 10_000
    assert getallocatedblocks() < 1.06 * before
    assert len(play.station.history["speed"].points()) < 4000


def feed(play: Play, ticks: int) -> None:
    """Feed ticks at 50 Hz with lines of text in between; poll at 10 Hz."""
    topics = dict(play.robot.said())
    robot = play.robot
    for tick in range(ticks):
        robot.x_m = tick % 1000 * 0.01
        for topic, message in ((ODOMETRY, robot.odometry()), (STATUS, robot.status())):
            play.bus.say(topic, message)
        for topic in (topic for topic in topics if topic not in (ODOMETRY, STATUS, MISSION)):
            play.bus.say(topic, topics[topic])
        for number in range(4):
            play.station.note(f"line {tick} {number}")
        if tick % 5 == 4:
            play.station.poll()
        play.clock.advance(20_000_000)


def test_station_subscribes_each_topic_of_each_robot_once() -> None:
    clock = ManualClock()
    bus = PlayedBus(clock)
    station = Station(bus, "r1", clock, begin=lambda work: work.close())
    for robot in ("r2", "r1", "r2"):
        station.select(robot)
        station.poll()
    assert Counter(bus.subscribed) == {
        (name, topic.path): 1 for name in ("r1", "r2") for topic in TOPICS
    }


def test_ages_are_judged_in_simulated_time() -> None:
    """At half the speed, a value is as fresh after twice the wall time; a heartbeat is not."""
    play = Play().forward(2.0)
    seen = []
    for pace in (1.0, 0.5):
        play.station.set_pace(pace)
        play.forward(1.0)
        play.delivered = False
        play.forward(0.3)
        seen.append((play.station.seen(STATUS).age, play.station.seen(STATUS).age_ns))
        play.delivered = True
    (real, real_ns), (slow, slow_ns) = seen
    assert (real, slow) == (Age.GONE, Age.DIM)
    assert real_ns == slow_ns
    play.delivered = False
    play.forward(1.3)
    assert play.station.seen(HEARTBEAT).age is Age.GONE


def to_the_next_goal(play: Play) -> None:
    """Let another goal begin while the first one is under way."""
    play.robot.goal, play.robot.goal_id = GoalState.DRIVING, 4
    play.forward(0.5)
    play.robot.goal_id, play.robot.goal_x_m = 9, 1.3


def test_replaced_goal_names_the_other_one_and_whose_it_is() -> None:
    play = Play()
    to_the_next_goal(play)
    play.robot.lease.drive_id, play.robot.lease.driver = 9, "ben@desk:pts/1"
    play.forward(2.0)
    words = "r1: goal 5.0 1.0 replaced by the goal 1.3 1.0 of ben@desk:pts/1"
    assert play.texts("replaced") == [words]


def test_replaced_goal_waits_for_a_name_but_not_for_long() -> None:
    play = Play()
    to_the_next_goal(play)
    play.robot.lease.drive_id, play.robot.lease.driver = 4, "anna"
    play.forward(0.5)
    assert play.texts("replaced") == []
    play.forward(1.0)
    assert play.texts("replaced") == ["r1: goal 5.0 1.0 replaced by the goal 1.3 1.0"]


def test_goal_that_ended_before_the_next_one_is_not_replaced() -> None:
    play = Play()
    play.robot.goal, play.robot.goal_id = GoalState.DRIVING, 4
    play.forward(0.5)
    play.robot.goal = GoalState.REACHED
    play.forward(0.05)
    play.robot.goal, play.robot.goal_id = GoalState.ACCEPTED, 9
    play.forward(2.0)
    assert play.texts("replaced") == []


def test_other_message_in_place_of_a_status_is_ignored() -> None:
    play = Play().forward(0.5)
    frame = Encoder(1, 1).encode(Statustext(severity=6, text="x", id=0, chunk_seq=0))
    play.bus.say_frame(STATUS, frame)
    play.forward(0.5)
    assert play.station.ready


def test_goal_whose_end_may_have_been_missed_is_not_replaced() -> None:
    play = Play()
    play.robot.goal, play.robot.goal_id = GoalState.DRIVING, 4
    play.forward(0.5)
    play.delivered = False
    play.forward(0.1)
    play.delivered, play.robot.goal_id = True, 9
    play.forward(2.0)
    assert play.texts("replaced") == []


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
    words = [
        station.lease.words,
        station.waiting_for,
        station.parameters_words,
        station.queue.refusal(),
    ]
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


LIST = b"""[{"name": "navigator", "value": 6, "default": 6, "unit": ""},
 {"name": "side", "value": 1, "default": 1, "unit": ""}]"""


def values(play: Play) -> dict[str, float]:
    return {one.name: one.value for one in play.station.parameters or ()}


def test_parameters_follow_the_navigator_of_the_status() -> None:
    play = Play()
    play.bus.answers["srv/parameters"] = lambda _: LIST
    play.forward(3.0)
    assert values(play)["navigator"] == Navigator.VGM
    changed = [one.name for one in play.station.parameters or () if not one.is_default]
    assert "navigator" in changed


class ReceivingBus:
    """A bus that only receives, like one that plays a recording."""

    def __init__(self, bus: PlayedBus) -> None:
        self.mailbox = bus.mailbox
        self.stream = bus.stream
        self.present = bus.present
        self.ask = bus.ask


class Replay:
    """The recording of a robot, played by the test."""

    def __init__(self) -> None:
        self.clock = ManualClock(1000 * S)
        self.bus = PlayedBus(self.clock)
        self.robot = Robot()
        self.station = Station(ReceivingBus(self.bus), "r1", self.clock)

    def forward(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            for topic, message in self.robot.said():
                self.bus.say(topic, message)
            self.station.poll()
            self.clock.advance(50_000_000)


def test_recording_is_shown_but_not_commanded() -> None:
    replay = Replay()
    replay.forward(2.0)
    station = replay.station
    assert not station.live
    assert not station.ready
    assert station.loss() is None
    assert station.seen(STATUS).age is Age.LIVE
    assert len(station.history["speed"].points()) == 40
    assert station.moment() is not None
    station.estop()
    station.queue.lease(LeaseAction.TAKE)
    station.reread()
    assert station.queue.refusal() == "a replay accepts no commands"
    assert (station.stopping, station.lease, station.round_trip_ms) == ("", LeaseView(), None)
    assert station.lease.words == "free"
    assert station.parameters_words == "not in the recording"
    assert len(station.log.find("a replay accepts")) == 2
    assert {line.clock_s for line in station.log} == {None}
    asyncio.run(station.close())


def test_recording_provides_world_and_parameters() -> None:
    play = Play()
    station = Station(ReceivingBus(play.bus), "r1", play.clock)
    assert station.world is not None
    assert station.world.name == "box"
    assert station.parameters_words == "5"
    assert station.scene().size_m == (6.0, 4.0)
