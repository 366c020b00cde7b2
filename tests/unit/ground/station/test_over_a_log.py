"""A station over a recording shows everything and commands nothing."""

from ground.client.telemetry import Age
from ground.station.robot.lease_state import LeaseView
from ground.station.station import Station
from protocol.topics import STATUS
from runtime.clock import ManualClock
from tests.support.ground.station.play import Play, S
from tests.support.ground.station.said import Robot
from tests.support.played_bus import PlayedBus


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
    station.take_lease()
    station.reread()
    assert station.refusal() == "a replay accepts no commands"
    assert (station.stopping, station.lease, station.round_trip_ms) == ("", LeaseView(), None)
    assert station.lease.words == "free"
    assert station.parameters_words == "not in the recording"
    assert len(station.log.find("a replay accepts")) == 2
    assert {line.clock_s for line in station.log} == {None}
    station.close()


def test_recording_provides_world_and_parameters() -> None:
    play = Play()
    station = Station(ReceivingBus(play.bus), "r1", play.clock)
    assert station.world is not None
    assert station.world.name == "box"
    assert station.parameters_words == "5"
    assert station.scene().size_m == (6.0, 4.0)
