"""Rates and losses follow from arrivals and sequence gaps."""

from typing import Any

from ground.client.telemetry import Age
from ground.station.link.streams import StreamCounter, StreamRow
from protocol.bus.network import Hub
from protocol.topics import HEARTBEAT, ODOMETRY, OPERATOR, SONAR, TEXT, Role, Topic
from protocol.wire.codec import Encoder
from tests.support.ground.station.play import Play
from tests.support.ground.station.said import BEAT

PERIOD_NS = 200_000_000


def rows(play: Play) -> dict[str, StreamRow]:
    return {one.topic.path: one for one in play.station.streams()}


def counted(sequences: list[int], topic: Topic[Any] = HEARTBEAT) -> StreamCounter:
    """Return a counter of these frames, one period apart for each step of the sequence."""
    counter, now_ns, last = StreamCounter(topic), 0, sequences[0] - 1
    for sequence in sequences:
        now_ns += PERIOD_NS * ((sequence - last) % 256 or 1)
        encoder = Encoder(1, 1)
        for _ in range(sequence):
            encoder.encode(BEAT)
        counter.take(encoder.encode(BEAT), now_ns)
        last = sequence
    return counter


def test_stream_without_gaps_has_no_loss() -> None:
    found = rows(Play().forward(6.0))[ODOMETRY.path]
    assert found.rate_hz is not None
    assert abs(found.rate_hz - 20.0) < 0.3
    assert (found.lost, found.lost_percent, found.received) == (0, 0.0, 120)
    assert found.age is Age.LIVE


def test_missing_frames_count_as_lost() -> None:
    play = Play().forward(2.0)
    play.delivered = False
    play.forward(0.5)
    play.delivered = True
    play.forward(2.5)
    found = rows(play)[SONAR.path]
    assert found.lost == 10
    assert abs(found.lost_percent - 10.0) < 0.2
    percent = play.station.link_percent
    assert percent is not None
    assert 85.0 < percent < 95.0


def test_frames_before_the_link_to_a_restarted_robot_are_not_lost() -> None:
    """The first frames of the new process were published before it could be reached."""
    play = Play().forward(0.2)
    play.bus.go(Role.ROBOT)
    play.robot.loop = False
    play.forward(0.5)
    play.bus._encoders.clear()
    play.robot.loop, play.robot.tick, play.delivered = True, 0, False
    play.forward(0.3)
    play.delivered = True
    play.bus.come(Role.ROBOT, zid="another")
    play.forward(1.0)
    assert play.station.restarts(Role.ROBOT) == 1
    own = [one for one in play.station.streams() if one.topic.publisher is Role.ROBOT]
    assert {one.topic.path: one.lost for one in own if one.lost} == {}
    assert play.station.link_percent == 100.0


def test_old_losses_leave_the_percentage() -> None:
    play = Play().forward(1.0)
    play.delivered = False
    play.forward(0.5)
    play.delivered = True
    play.forward(8.0)
    found = rows(play)[SONAR.path]
    assert (found.lost, found.lost_percent) == (10, 0.0)
    assert play.station.link_percent == 100.0


def test_silence_reduces_rate_and_link_to_zero() -> None:
    play = Play().forward(2.0)
    play.cut(Hub.UNREACHABLE)
    play.forward(6.0)
    found = rows(play)[ODOMETRY.path]
    assert found.rate_hz == 0.0
    assert found.age is Age.GONE
    assert play.station.link_percent == 0.0
    assert play.station.round_trip_ms is None


def test_no_rate_before_the_first_frame() -> None:
    play = Play()
    play.station.poll()
    assert play.station.link_percent is None
    assert rows(play)[ODOMETRY.path].rate_hz is None
    assert rows(play)[TEXT.path].rate_hz is None


def test_sequence_wraps_without_loss() -> None:
    assert counted([254, 255, 0, 1]).lost == 0
    assert counted([254, 1]).lost == 2


def test_restarted_sender_causes_no_loss() -> None:
    assert counted([7, 8, 0]).lost == 0
    counter = counted([100, 101])
    encoder = Encoder(1, 1)
    encoder.encode(BEAT)
    counter.take(encoder.encode(BEAT), 4 * PERIOD_NS)
    assert counter.lost == 0


def test_two_operators_on_one_key_cause_no_loss() -> None:
    assert counted([1, 9, 2, 10], OPERATOR).lost == 0


def test_noise_is_counted_as_rejected() -> None:
    play = Play().forward(1.0)
    play.bus.say_frame(ODOMETRY, b"noise")
    play.station.poll()
    found = rows(play)[ODOMETRY.path]
    assert (found.received, found.rejected) == (20, 1)
    assert found.last_rejection


def test_missed_polls_cause_no_loss() -> None:
    play = Play().forward(1.0)
    play.forward(60.0, poll=False)
    play.forward(1.0)
    assert rows(play)[ODOMETRY.path].lost == 0
    assert play.station.link_percent == 100.0


def test_round_trip_is_measured() -> None:
    play = Play()
    play.forward(0.5)
    assert play.station.round_trip_ms == 0.0


def test_cached_samples_are_not_lost() -> None:
    encoder = Encoder(1, 1)
    frames = [encoder.encode(BEAT) for _ in range(6)]
    counter = StreamCounter(HEARTBEAT)
    for at in (1, 2, 5):
        counter.take(frames[at], at * PERIOD_NS)
    assert (counter.lost, counter.recent(5 * PERIOD_NS)) == (2, (3, 2))
    for at in (3, 4):
        counter.take(frames[at], at * PERIOD_NS)
    assert (counter.lost, counter.received) == (0, 5)
    assert counter.recent(5 * PERIOD_NS)[1] == 0
