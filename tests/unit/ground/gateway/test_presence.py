"""A ground station on a line that loses every fifth frame, and one that is really gone."""

from collections.abc import Iterator
from contextlib import contextmanager
from random import Random

import pytest

from gateways.mavlink.clients import NoFile
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.operator_control import LOST_NS, PATIENCE_NS, SILENCE_NS
from tests.support.each import each
from tests.support.gateway.messages import command
from tests.support.gateway.whole import CommandedPort, WholeGateway

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
ARM = command(400, 1)
LOSS = 0.2
ROUND_NS = 100_000_000
ROUNDS_PER_S = 10
IDS = 255, 190


class Station:
    """Sends a heartbeat a second, and answers PING if it is one that does.

    Frames in both directions are lost with the probability `loss`.
    """

    def __init__(self, whole: WholeGateway, *, answers: bool, loss: float, seed: int) -> None:
        self._whole = whole
        self._answers = answers
        self._loss = loss
        self._random = Random(seed)
        self._encoder = mavlink.MAVLink(NoFile(), *IDS)
        self._parser = mavlink.MAVLink(NoFile())
        self._rounds = 0
        self.control = whole.face.vehicle.control
        self.is_there = True

    def send(self, message: MavMessage) -> None:
        frame: bytes = message.pack(self._encoder)
        self._encoder.seq = (self._encoder.seq + 1) & 0xFF
        if self._random.random() >= self._loss:
            self._whole.endpoint.deliver("radio", frame)

    def run(self, seconds: float) -> None:
        """Let time pass in the gateway's slowest rounds."""
        whole = self._whole
        for _ in range(round(seconds * ROUNDS_PER_S)):
            if self.is_there and self._rounds % ROUNDS_PER_S == 0:
                self.send(HEARTBEAT)
            self._rounds += 1
            whole.clock.time_ns += ROUND_NS
            whole.gateway.round(longest_s=0.0)
            sent, whole.endpoint.sent = whole.endpoint.sent, []
            if self.is_there and self._answers:
                self._answer(b"".join(frame for _, frame in sent))

    def _answer(self, data: bytes) -> None:
        for one in self._parser.parse_buffer(data) or ():
            asks = one.get_type() == "PING" and one.target_system == 0
            if asks and self._random.random() >= self._loss:
                fields = one.time_usec, one.seq, one.get_srcSystem(), one.get_srcComponent()
                self.send(mavlink.MAVLink_ping_message(*fields))


@contextmanager
def station_in_control(*, answers: bool, loss: float, seed: int) -> Iterator[Station]:
    """Return a station that has taken control, by a gateway of its own."""
    whole = WholeGateway(CommandedPort())
    station = Station(whole, answers=answers, loss=loss, seed=seed)
    while not whole.port.performed:
        station.send(ARM)
        station.run(1.0)
    whole.port.answer()
    yield station
    whole.close()


def still_heard_s(station: Station) -> float:
    """Return for how long the robot gets heartbeats after the end of a station, in seconds."""
    station.is_there = False
    silent_s = 0.0
    while station.control.owner is not None:
        station.run(0.1)
        silent_s += 0.1
    return silent_s


@each("answers", [True, False])
def test_no_station_is_lost_in_an_hour_without_every_fifth_frame(
    answers: bool, pytestconfig: pytest.Config
) -> None:
    """Of one like QGroundControl, and of a script that sends only a heartbeat a second.

    The brief form has a quarter of an hour.
    """
    seconds = 900 if pytestconfig.getoption("--examples") == "brief" else 3_600
    with station_in_control(answers=answers, loss=LOSS, seed=1) as station:
        for _ in range(seconds):
            station.run(1.0)
            assert station.control._presence is not None, "it has lost control"
        longest_s = (SILENCE_NS if answers else PATIENCE_NS) / 1e9
        assert longest_s - 2.1 <= still_heard_s(station) <= longest_s + 0.11


@each(("answers", "loss"), [(True, 0.0), (False, 0.0), (True, LOSS)])
def test_station_that_is_gone_loses_control_in_time(answers: bool, loss: float) -> None:
    with station_in_control(answers=answers, loss=loss, seed=2) as station:
        station.run(60.0)
        assert still_heard_s(station) <= SILENCE_NS / 1e9 + 0.11
        station.run(LOST_NS / 1e9 + 0.1)
        assert station.control._presence is None
