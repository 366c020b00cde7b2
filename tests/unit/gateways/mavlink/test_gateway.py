"""The whole gateway: its settings, the pace of its loop, two robots, and lossy lines."""

import argparse
import asyncio
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec, module_from_spec
from itertools import cycle, islice, pairwise
from pathlib import Path
from random import Random
from typing import Any

import pytest

from gateways.mavlink.clients import ClientLink
from gateways.mavlink.endpoints import EXAMPLE
from gateways.mavlink.gateway import FINISH_NS, Pace
from gateways.mavlink.gateway_verb import (
    LOW_RATE_BYTES_S,
    GatewaySettings,
    arguments,
    as_gateway,
    guard_of,
    settings_of,
    systems_of,
    with_policy,
)
from gateways.mavlink.mavlink_dialect import (
    AvailableModes,
    ControlStatus,
    CurrentMode,
    MavMessage,
    mavlink,
)
from gateways.mavlink.operator_control import LOST_NS, PATIENCE_NS, SILENCE_NS
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import EPOCH_S, Policy, SigningGuard
from ground.cli.main import main
from ground.client.connection import Common
from ground.user.mavlink_keys import KeyRing, new_key, write_keys
from protocol.bus.network import Network, Tls, gateway_here
from runtime.errors import ConfigError, UserError
from runtime.units import NS_PER_MS as MS
from tests.support.each import each
from tests.support.gateway.fake_port import (
    CLIENT,
    Bench,
    CommandedPort,
    WholeGateway,
    acks,
    command,
    everything,
)


def rounds_until(pace: Pace, from_ms: int, to_ms: int) -> int:
    return sum(pace.is_due(now_ms * MS) for now_ms in range(from_ms, to_ms))


def test_rounds_are_calm_while_clients_only_watch() -> None:
    pace = Pace(0)
    for kind in ("HEARTBEAT", "PING", "TIMESYNC", "RADIO_STATUS"):
        pace.note(getattr(mavlink, f"MAVLINK_MSG_ID_{kind}"), 0)
    assert rounds_until(pace, 0, 1000) == 10


def test_rounds_are_fast_while_clients_ask() -> None:
    pace = Pace(0)
    pace.is_due(0)
    pace.note(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, 1 * MS)
    assert rounds_until(pace, 2, 21) == 0
    assert rounds_until(pace, 21, 1021) == 50
    rounds_until(pace, 1021, 2100)
    assert rounds_until(pace, 2100, 3100) == 10


def test_missed_rounds_are_skipped() -> None:
    pace = Pace(0)
    assert pace.is_due(1000 * MS)
    assert rounds_until(pace, 1001, 1100) == 1


def test_rounds_follow_fast_streams() -> None:
    pace = Pace(0)
    assert sum(pace.is_due(now_ms * MS, 50 * MS) for now_ms in range(1000)) == 20


class LatePort(CommandedPort):
    """A robot that answers a stop `late_ns` after the gateway was told to end."""

    late_ns = 0
    is_told = False

    @property
    def is_busy(self) -> bool:
        """Whether a stop is not answered."""
        if not self.is_told:
            self.is_told = True
            asyncio.get_running_loop().call_later(self.late_ns / 1e9, self._end_stops)
        return bool(self.stops)

    def _end_stops(self) -> None:
        for end in self.stops:
            end(self.accepted)
        self.stops.clear()


@each(("late_ns", "count"), [(100 * MS, 1), (2 * FINISH_NS, 0)])
def test_end_waits_half_a_second_for_the_answer_to_a_stop(late_ns: int, count: int) -> None:
    port = LatePort()
    whole = WholeGateway(port)
    port.late_ns = late_ns
    port.telemetry |= everything()
    whole.send(command(185, 1))
    whole.run(0.04)
    assert port.stops
    whole.loop.run(whole.gateway.finish())
    whole.close()
    assert len(acks(whole.sent_to("a", "COMMAND_ACK"))) == count


def keep_alive(whole: WholeGateway, seconds: int) -> None:
    """Let time pass, with the heartbeat of a client each second."""
    for _ in range(seconds):
        whole.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        whole.run(1.0)


def test_streams_that_a_client_has_asked_for_keep_no_round_busy() -> None:
    whole, rounds = WholeGateway(CommandedPort()), 0
    whole.port.telemetry |= everything()
    for message in (command(512, AvailableModes.id), command(32100, 1, 0, 0, 255)):
        whole.send(message)
        whole.run(0.1)
    keep_alive(whole, 8)  # it answers no PING, and is asked five times
    due = whole.face.due

    def counted(now_ns: int) -> None:
        nonlocal rounds
        rounds += 1
        due(now_ns)

    whole.face.due = counted  # type: ignore[method-assign]
    whole.endpoint.sent.clear()
    keep_alive(whole, 10)
    whole.close()
    sent = Counter(int.from_bytes(frame[7:10], "little") for _, frame in whole.endpoint.sent)
    assert (sent[CurrentMode.id], sent[ControlStatus.id]) == (5, 10)
    assert rounds <= 105


def unpatched_dialect() -> Any:
    """Return pymavlink's dialect as a client imports it, without the messages of the gateway."""
    spec = find_spec("pymavlink.dialects.v20.ardupilotmega")
    assert spec is not None
    assert spec.loader is not None
    dialect = module_from_spec(spec)
    spec.loader.exec_module(dialect)
    return dialect


def test_client_counts_no_lost_frame_on_a_clean_line() -> None:
    port = CommandedPort()
    port.telemetry |= everything()
    whole = WholeGateway(port)
    for message in (command(400, 1), command(176, 1, 15), command(512, 148), command(400, 0)):
        whole.send(message)
        whole.run(0.1)
        while port.waiting:
            port.answer()
    keep_alive(whole, 60)
    whole.close()
    parser = unpatched_dialect().MAVLink(None)
    parser.robust_parsing = True
    sent = parser.parse_buffer(b"".join(frame for _, frame in whole.endpoint.sent))
    known = [one for one in sent if not one.get_type().startswith(("UNKNOWN", "BAD_DATA"))]
    gaps = [(b.get_seq() - a.get_seq()) % 256 - 1 for a, b in pairwise(known)]
    assert (len(known) > 2000, sum(gaps)) == (True, 0)


NUMBERS = (400, 176, 185, 192, 20, 300, 193, 178, 179, 246, 32100)
LOW_RATE_LIMIT = 4_500


def test_1000_commands_for_one_robot_never_reach_the_other() -> None:
    first, second = Bench(system=1), Bench(system=2)
    for bench in (first, second):
        bench.face = face_of(bench.vehicle)
        bench.port.telemetry |= everything()
        bench.due()
        bench.vehicle.outbox.take()
    for turn, number in enumerate(islice(cycle(NUMBERS), 1_000)):
        sender = CLIENT._replace(system=100 + turn % 50)
        command = mavlink.MAVLink_command_long_message(2, 1, number, 0, 1, 15, 0, 0, 0, 0, 0)
        command._header.seq = turn & 0xFF
        assert first.send(command, sender) == []
        second.send(command, sender)
    assert (first.port.performed, first.port.stops, first.port.leases) == ([], [], [])
    assert first.vehicle.control.owner is None
    assert second.port.stops
    assert second.port.leases


def test_low_rate_profile_fits_57600_baud_with_signatures() -> None:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry |= everything()
    bench.face.join(CLIENT.client, LOW_RATE_BYTES_S)
    ring = KeyRing(key=(new_key(),))
    guard = SigningGuard(lambda: EPOCH_S * 10**9 + bench.now_ns, ring)
    link = ClientLink(CLIENT.client, "radio", 0)
    bench.after(2.0)
    sizes = [len(link.encode(1, message, guard)) for message in bench.after(20.0)]
    assert 2_000 < sum(sizes) / 20.0 <= LOW_RATE_LIMIT


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
        self._encoder = mavlink.MAVLink(None, *IDS)
        self._parser = mavlink.MAVLink(None)
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
            whole.advance(ROUND_NS)
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


FILE = """
robot = "r9"
[gateway]
endpoints = ["udpin:0.0.0.0:14550,require", "serial:/dev/ttyUSB0:57600"]
robots = ["r1", "r2"]
systems = { r2 = 20 }
origin = [47.4, 8.5]
altitude_m = 400.0
low_rate = true
keys = "keys.toml"
"""


def settings(*words: str, config: str | None = None) -> GatewaySettings:
    parser = argparse.ArgumentParser()
    arguments(parser)
    return settings_of(parser.parse_args(words), "r1", config)


def test_defaults_present_one_robot_as_system_1() -> None:
    found = settings()
    assert found.endpoints == (EXAMPLE,)
    assert found.systems == {"r1": 1}
    assert (found.home.latitude_deg, found.low_rate) == (-35.3632621, False)


def test_file_overrides_defaults_and_words_override_the_file(tmp_path: Path) -> None:
    path = tmp_path / "ground.toml"
    path.write_text(FILE)
    found = settings(config=str(path))
    assert found.systems == {"r1": 1, "r2": 20}
    assert (found.origin, found.altitude_m, found.low_rate) == ((47.4, 8.5), 400.0, True)
    words = ("tcpin:0.0.0.0:5760", "--robots", "r3,r2", "--system", "r3=7", "r2=9")
    found = settings(*words, "--origin", "1", "-2", config=str(path))
    assert found.endpoints == ("tcpin:0.0.0.0:5760",)
    assert found.systems == {"r3": 7, "r2": 9}
    assert found.origin == (1.0, -2.0)


def test_systems_are_numbered_in_the_order_of_the_names() -> None:
    assert systems_of(["r3", "r1", "r2"], {}) == {"r3": 3, "r1": 1, "r2": 2}
    assert systems_of(["b", "a", "c"], {"c": 1}) == {"b": 3, "a": 2, "c": 1}


@each(
    ("words", "error"),
    [
        (("--system", "r1"), "use ROBOT=ID"),
        (("--system", "r1=0"), "1 to 250"),
        (("--system", "r1=255"), "1 to 250"),
        (("--system", "r2=1"), "the gateway has no r2"),
        (("--robots", "r1,r2", "--system", "r1=4", "r2=4"), "an id of its own"),
        (("--robots", "r1", "--robots", "r1"), "only once"),
        (("--origin", "91", "0"), "LAT -85 to 85"),
        (("--origin", "47", "181"), "LON -180 to 180"),
        (("--origin", "0", "0"), "not both 0"),
    ],
)
def test_wrong_words_are_refused_with_the_fix(words: tuple[str, ...], error: str) -> None:
    with pytest.raises(UserError, match=error):
        settings(*words)


@each(
    "line",
    [
        "low_rat = true",
        "systems = { r1 = 0 }",
        "systems = { r1 = 256 }",
        "origin = [99, 0]",
        "origin = [0.0, 0.0]",
        'robots = ["R!"]',
        'robots = ["r1", "r1"]',
        "systems = { r1 = 4, r2 = 4 }",
        "endpoints = 5",
    ],
)
def test_wrong_key_of_the_file_is_refused(tmp_path: Path, line: str) -> None:
    path = tmp_path / "ground.toml"
    path.write_text(f"[gateway]\n{line}\n")
    with pytest.raises((ConfigError, UserError)):
        settings(config=str(path))


@each(
    ("words", "error"),
    [
        (("udpinn:127.0.0.1:1",), "did you mean udpin?"),
        (("udpin:127.0.0.1:14550,sing",), "is none of require, loopback, accept"),
        (("tcpin:0.0.0.0:14550,accept",), "use require"),
        (("udpin:127.0.0.1:0",), "port 0"),
        (("serial:/dev/none:57600",), "no such device"),
        (("--system", "r1=0"), "1 to 250"),
    ],
)
def test_wrong_words_are_refused_before_the_connection(
    words: tuple[str, ...], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["gateway", *words, "--connect", "tcp/127.0.0.1:1"]) == 2
    assert error in capsys.readouterr().err


def test_policy_follows_the_endpoint_after_a_comma() -> None:
    assert with_policy("udpin:127.0.0.1:14550").policy is Policy.LOOPBACK
    assert with_policy("udpin:0.0.0.0:1,accept") == ("udpin:0.0.0.0:1", Policy.ACCEPT)
    with pytest.raises(UserError, match=r"as in udpin:0\.0\.0\.0:1,require"):
        with_policy("udpin:0.0.0.0:1,requrie")


@each("host", ["0.0.0.0", "192.0.2.1", "[::]", "//0.0.0.0"])
def test_unsigned_commands_by_tcp_are_taken_by_a_plain_word_only(host: str) -> None:
    with pytest.raises(UserError, match=r"require.*udpin.*anyone"):
        with_policy(f"tcpin:{host}:5760,accept")
    for word in ("require", "loopback", "anyone"):
        assert with_policy(f"tcpin:{host}:5760,{word}").policy is Policy(word)
    for host in ("localhost", "[::1]", "//127.0.0.1"):
        assert with_policy(f"tcpin:{host}:5760,accept").policy is Policy.ACCEPT
    with pytest.raises(UserError, match="unknown host"):
        with_policy("tcpin:no.such.host.invalid:5760,accept")


def test_compose_publishes_no_tcp_port_that_takes_unsigned_commands() -> None:
    text = (Path(__file__).parents[4] / "docker-compose.yml").read_text()
    found = [with_policy(one) for one in re.findall(r"(?:udpin|udpout|tcpin):[\w.:,]+", text)]
    assert found
    by_tcp = [one for one in found if one.text.startswith("tcpin")]
    assert all(one.policy is Policy.REQUIRE for one in by_tcp)


@each("person", ["", "ada"])
def test_gateway_is_another_person_than_its_user(person: str) -> None:
    """Its clients may be anybody, so they share no lease with the user's app."""
    common = Common(network=Network(person=person), robot="r1")
    assert as_gateway(common).network.person == gateway_here()
    locked = Common(network=Network(tls=Tls(ca="a", certificate="b", key="c")), robot="r1")
    assert as_gateway(locked) == locked


def test_required_signing_needs_a_key(tmp_path: Path) -> None:
    path = tmp_path / "keys.toml"
    wanted, endpoints = GatewaySettings(keys=str(path)), [with_policy("udpin:0.0.0.0:1,require")]
    with pytest.raises(UserError, match="sidestep keys signing new"):
        guard_of(wanted, endpoints)
    write_keys(path, KeyRing(key=(new_key(),)))
    guard = guard_of(wanted, endpoints)
    assert guard.is_signing
    assert guard.is_required
