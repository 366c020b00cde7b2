"""The decision history explains any instant of the last minutes."""

import tracemalloc

from ground.station.history.decision_history import DecisionHistory, Frames
from ground.station.history.event_log import Inbox, ReceivedFrame
from protocol.topics import DECISION
from protocol.wire.codec import Encoder
from tests.support.ground.station.play import Play, S
from tests.support.ground.station.said import Robot


def test_moment_has_its_decision_and_the_previous_one() -> None:
    play = Play()
    for step in range(40):
        play.robot.rotation_rad = step / 8
        play.robot.x_m = step / 8
        play.forward(0.05)
    moment = play.station.moment(1000 * S + 500_000_000)
    assert moment is not None
    assert moment.decision.rotation_rad == 10 / 8
    assert moment.previous is not None
    assert moment.previous.rotation_rad == 9 / 8
    assert moment.status is not None
    assert moment.cycle is not None
    assert moment.cycle.tick == 10


def test_moment_defaults_to_now() -> None:
    play = Play().forward(1.0)
    moment = play.station.moment()
    assert moment is not None
    assert moment.time_ns == play.station.now_ns


def test_moment_is_none_outside_the_history() -> None:
    play = Play().forward(1.0)
    play.hang()
    play.forward(3.0)
    assert play.station.moment() is None
    assert play.station.moment(999 * S) is None
    assert play.station.moment(1001 * S) is not None


def test_decisions_between_polls_are_kept() -> None:
    play = Play().forward(1.0)
    play.forward(0.5, poll=False)
    play.station.poll()
    moment = play.station.moment(1001 * S + 200_000_000)
    assert moment is not None
    assert moment.time_ns == 1001 * S + 200_000_000


def test_malformed_frames_are_skipped() -> None:
    frames = Frames()
    frames.add(Encoder(1, 1).encode(Robot().decision()), 1)
    frames.add(b"noise", 2)
    assert [arrived_ns for arrived_ns, _ in frames.until(5)] == [1]


def test_ten_minutes_at_50_hz_are_bounded() -> None:
    decision_history, encoder, robot = DecisionHistory(), Encoder(1, 1), Robot()
    tracemalloc.start()
    for number in range(2 * 12_000):
        decision_history.take(
            ReceivedFrame(DECISION.path, encoder.encode(robot.decision()), number)
        )
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 5_000_000


def test_full_inbox_keeps_the_newest() -> None:
    inbox = Inbox(size=3)
    take = inbox.taker("a")
    for number in range(5):
        take("key", bytes([number]), number)
    arrivals, overflowed = inbox.drain()
    assert [arrival.frame for arrival in arrivals] == [b"\2", b"\3", b"\4"]
    assert overflowed
    assert inbox.drain() == ([], False)
