"""A station over a played log: everything is seen, and nothing commanded."""

from ground.client.telemetry import Age
from ground.station import Lease, Station
from protocol.topics import STATUS
from runtime.clock import ManualClock
from tests.support.ground.station.play import Play, S
from tests.support.ground.station.said import Robot
from tests.support.played_bus import PlayedBus


class Heard:
    """A bus that only hears, as one that plays a log."""

    def __init__(self, bus: PlayedBus) -> None:
        self.mailbox = bus.mailbox
        self.stream = bus.stream
        self.present = bus.present
        self.ask = bus.ask


class Replay:
    """A robot's log, played and turned back by the test."""

    def __init__(self) -> None:
        self.clock = ManualClock(1000 * S)
        self.bus = PlayedBus(self.clock)
        self.robot = Robot()
        self.station = Station(Heard(self.bus), "r1", self.clock)

    def forward(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            for topic, message in self.robot.said():
                self.bus.say(topic, message)
            self.station.poll()
            self.clock.advance(50_000_000)


def test_over_a_log_everything_is_seen_and_nothing_commanded() -> None:
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
    station.take_lease()
    station.reread()
    assert station.refusal() == "this is a replay: nothing can be commanded"
    assert (station.stopping, station.lease, station.round_trip_ms) == ("", Lease(), None)
    assert station.lease.words == "free"
    assert station.parameters_words == "a log without a list"
    assert len(station.log.find("this is a replay")) == 2
    station.close()


def test_a_recording_tells_its_world_and_parameters() -> None:
    play = Play()
    station = Station(Heard(play.bus), "r1", play.clock)
    assert station.world is not None
    assert station.world.name == "box"
    assert station.parameters_words == "2"
    assert station.scene().size_m == (6.0, 4.0)
