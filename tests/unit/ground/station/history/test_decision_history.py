"""Any instant of the last minutes can be asked why the robot did what it did."""

import tracemalloc

from ground.station.history.decision_history import Frames, Moments
from ground.station.history.inbox import Arrival, Inbox
from protocol.topics import DECISION
from protocol.wire.codec import Encoder
from tests.support.ground.station.play import Play, S
from tests.support.ground.station.said import Robot


def test_an_instant_of_the_past_has_its_decision_and_the_one_before() -> None:
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
    assert moment.odometry is not None
    assert moment.odometry.x_m == 10 / 8
    assert moment.status is not None
    assert moment.cycle is not None
    assert moment.cycle.tick == 10


def test_unless_said_otherwise_it_is_now() -> None:
    play = Play().forward(1.0)
    moment = play.station.moment()
    assert moment is not None
    assert moment.time_ns == play.station.now_ns


def test_before_the_first_and_long_after_the_last_there_is_none() -> None:
    play = Play().forward(1.0)
    play.hang()
    play.forward(3.0)
    assert play.station.moment() is None
    assert play.station.moment(999 * S) is None
    assert play.station.moment(1001 * S) is not None


def test_decisions_between_two_polls_are_kept_too() -> None:
    play = Play().forward(1.0)
    play.forward(0.5, poll=False)
    play.station.poll()
    moment = play.station.moment(1001 * S + 200_000_000)
    assert moment is not None
    assert moment.time_ns == 1001 * S + 200_000_000


def test_what_cannot_be_read_is_left_out() -> None:
    frames = Frames()
    frames.add(Encoder(1, 1).encode(Robot().decision()), 1)
    frames.add(b"noise", 2)
    assert [arrived_ns for arrived_ns, _ in frames.until(5)] == [1]


def test_ten_minutes_at_50_hz_are_bounded() -> None:
    moments, encoder, robot = Moments(), Encoder(1, 1), Robot()
    tracemalloc.start()
    for number in range(2 * 12_000):
        moments.take(Arrival(DECISION.path, encoder.encode(robot.decision()), number))
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 5_000_000


def test_an_inbox_that_nobody_empties_keeps_the_newest() -> None:
    inbox = Inbox(size=3)
    take = inbox.taker("a")
    for number in range(5):
        take("key", bytes([number]), number)
    arrivals, overflowed = inbox.drain()
    assert [arrival.frame for arrival in arrivals] == [b"\2", b"\3", b"\4"]
    assert overflowed
    assert inbox.drain() == ([], False)
