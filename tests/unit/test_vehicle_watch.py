"""`mavlink watch`: shows vehicles of all kinds as they are, live or not, and commands none."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from math import pi
from pathlib import Path
from struct import pack, unpack
from threading import Event, Thread
from typing import Any

import pytest
from pymavlink import mavutil

from ground.app.appearance import Appearance
from ground.app.vehicle_app import VehicleApp, scene_of, state_rows
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import words_of
from tests.support.each import each
from tests.support.gateway.fake_port import CommandedPort, WholeGateway, everything, odometry
from tests.support.vehicle_check.broken import (
    ArduPilotLike,
    CarelessVehicle,
    GarbageVehicle,
    HastyVehicle,
    MuteVehicle,
)
from tests.support.vehicle_check.core import Core, MemoryNetwork, Peer
from tests.support.vehicle_check.good import LAT, LON, GoodVehicle
from vehicle_check.mavlink_frames import mavlink
from vehicle_check.networks import Heard, VehicleNetwork, network_of
from vehicle_check.watch import Freshness, VehicleWatch, mode_name

READS = {
    *("HEARTBEAT", "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ"),
    *("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK"),
}
ITEM = ((3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0), (LAT + 1000, LON), 2.5)
KEYS = ("1", "2", "3", "4", "5", "tab", "a", "s", "plus", "minus", "f", "up", "down", "pageup",
        "pagedown", "home", "end", "space", "enter", "h", "e", "delete", "r", "r")  # fmt: skip


class Recorder(MemoryNetwork):
    """A network that keeps what is sent to the vehicle."""

    def __init__(self, *vehicles: Any) -> None:
        super().__init__(*vehicles)
        self.frames: list[bytes] = []

    def send(self, peer: int, data: bytes) -> None:
        """Keep it, too."""
        self.frames.append(data)
        super().send(peer, data)


def expect_only_reads(frames: list[bytes]) -> None:
    """Expect heartbeats of a ground station and requests to read, and nothing else."""
    parser = mavlink.MAVLink(None)
    sent = [one for data in frames for one in parser.parse_buffer(data) or ()]
    assert sent
    for one in sent:
        if one.get_type() == "COMMAND_LONG":
            assert one.command == mavlink.MAV_CMD_REQUEST_MESSAGE
        else:
            assert one.get_type() in READS, one
    for one in sent:
        if one.get_type() == "HEARTBEAT":
            assert (one.type, one.autopilot, one.base_mode) == (6, 8, 0)
        elif one.get_type() == "MISSION_ACK":
            assert one.type == mavlink.MAV_MISSION_ACCEPTED


def watched(network: VehicleNetwork, seconds: float = 8.0, **options: Any) -> VehicleWatch:
    """Watch for some simulated time."""
    watch = VehicleWatch(network, **options)
    go_on(watch, seconds)
    return watch


def go_on(watch: VehicleWatch, seconds: float) -> None:
    """Watch on."""
    for _ in range(round(seconds * 10)):
        watch.stations.wait(0.1)
        watch.poll()


KINDS = (ArduPilotLike, MuteVehicle, CarelessVehicle, GarbageVehicle, HastyVehicle)


@each("kind", KINDS)
def test_watch_only_reads_from_vehicles_of_all_kinds(kind: type[Core]) -> None:
    network = Recorder(kind())
    watched(network)
    expect_only_reads(network.frames)


async def test_no_key_sends_more_than_reads(tmp_path: Path) -> None:
    vehicle = GoodVehicle()
    vehicle.plans[0] = [ITEM, ITEM]
    network = Recorder(vehicle)
    app = VehicleApp(network, 0, tmp_path, appearance=Appearance(hz=0))
    async with app.run_test(size=(100, 30)) as pilot:
        for key in KEYS:
            go_on(app.watched, 0.3)
            await pilot.press(key)
            app.poll()
            app.draw()
    expect_only_reads(network.frames)
    assert (vehicle.mode, vehicle.is_armed) == (4, False)


@contextmanager
def on_a_socket(vehicle: GoodVehicle) -> Iterator[tuple[str, list[bytes]]]:
    """Serve a vehicle on a UDP socket that records."""
    frames: list[bytes] = []
    is_over = Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.settimeout(0.01)
        endpoint = f"udpout:127.0.0.1:{own.getsockname()[1]}"
        network = network_of(endpoint)

        def serve() -> None:
            client: Any = None
            while not is_over.is_set():
                try:
                    data, client = own.recvfrom(4096)
                    frames.append(data)
                    vehicle.receive(0, data, network.now_ns())
                except TimeoutError:
                    pass
                vehicle.due(network.now_ns())
                sends, vehicle.sends = vehicle.sends, []
                for _, data in sends if client else ():
                    own.sendto(data, client)

        thread = Thread(target=serve)
        thread.start()
        try:
            yield endpoint, frames
        finally:
            is_over.set()
            thread.join()
            network.close()


def test_recording_socket_receives_only_reads() -> None:
    vehicle = GoodVehicle()
    vehicle.plans[0] = [ITEM, ITEM]
    with on_a_socket(vehicle) as (endpoint, frames):
        network = network_of(endpoint)
        watch = VehicleWatch(network)
        for _ in range(300):
            watch.stations.wait(0.02)
            watch.poll()
            if watch.parameters.is_whole and watch.mission and None not in watch.mission:
                break
        network.close()
    assert watch.parameters.is_whole
    assert watch.mission is not None
    assert len(watch.mission) == 2
    expect_only_reads(frames)


def values_of(watch: VehicleWatch) -> dict[str, tuple[str, str]]:
    """Return words and role of each value by its name."""
    rows = state_rows(watch)
    return {row[0].text.strip(): (row[1].text, row[1].role) for row in rows}


def test_values_are_those_of_the_vehicle() -> None:
    vehicle = GoodVehicle()
    vehicle.plans[0] = [ITEM, ITEM]
    vehicle.x, vehicle.y, vehicle.yaw, vehicle.mode = 1.5, -2.5, 0.5, 15
    watch = watched(MemoryNetwork(vehicle))
    found = values_of(watch)
    assert {role for _, role in found.values()} == {"text"}
    assert {name: words for name, (words, _) in found.items()} == {
        "vehicle": "ArduPilot ground rover",
        "mode": "GUIDED, disarmed",
        "state": "standby",
        "place": f"{vehicle.place()[0] / 1e7:.7f} {vehicle.place()[1] / 1e7:.7f}",
        "local": "-2.50 E 1.50 N m",
        "heading": "29°",
        "speed": "0.00 m/s",
        "battery": "0.0 V, 0 %",
        "GPS": "3d fix, 10 satellites",
        "mission": "item 0",
        "loss": "0.0 %",
    }
    assert {name: one.value for name, one in watch.parameters.values.items()} == pytest.approx(
        vehicle.values
    )
    assert watch.mission is not None
    (_, item) = watch.mission
    assert item is not None
    assert (item.command, item.x, item.y, item.z) == (16, LAT + 1000, LON, 2.5)
    scene = scene_of(watch)
    assert scene.robot is not None
    assert (scene.robot.x_m, scene.robot.y_m) == pytest.approx((-2.5, 1.5))
    (target,) = scene.mission
    assert (target.x_m, target.y_m) == pytest.approx((0.0, 1000 * 0.011131949), abs=0.02)
    assert scene.live


def test_rate_age_and_loss_are_counted() -> None:
    good, careless = (watched(MemoryNetwork(one)) for one in (GoodVehicle(), CarelessVehicle()))
    attitude = good.seen("ATTITUDE")
    assert attitude is not None
    assert attitude.rate_hz(good.now_ns) == pytest.approx(10, abs=0.3)
    assert attitude.freshness(good.now_ns) is Freshness.LIVE
    assert good.loss_percent() == 0.0
    percent = careless.loss_percent()
    assert percent is not None
    assert 1.0 <= percent <= 3.0


class Mortal(GoodVehicle):
    """Ends when it is told."""

    is_dead = False

    def send(self, message: Any, peer: Peer | None = None) -> None:
        """Send nothing any more."""
        if not self.is_dead:
            super().send(message, peer)


async def test_nothing_of_a_silent_vehicle_is_live(tmp_path: Path) -> None:
    vehicle = Mortal()
    network = MemoryNetwork(vehicle)
    app = VehicleApp(network, 0, tmp_path, appearance=Appearance(hz=0))
    async with app.run_test(size=(100, 30)):
        watch = app.watched
        go_on(watch, 4.0)
        assert scene_of(watch).live
        vehicle.is_dead = True
        go_on(watch, 6.0)
        app.draw()
        found = values_of(watch)
        assert {role for _, role in found.values()} == {"faint"}
        assert all(words.endswith(" s old)") or words == "--" for words, _ in found.values())
        assert not scene_of(watch).live
        assert {one.freshness(watch.now_ns) for one in watch.messages.values()} == {Freshness.STALE}
        assert {one.rate_hz(watch.now_ns) for one in watch.messages.values()} == {0.0}
        assert watch.loss_percent() is None
        assert "NOT LIVE" in words_of(app.query_one("#status", Lines).rows[0])


async def test_what_was_never_sent_is_not_shown(tmp_path: Path) -> None:
    app = VehicleApp(MemoryNetwork(MuteVehicle()), 0, tmp_path, appearance=Appearance(hz=0))
    async with app.run_test(size=(100, 30)):
        go_on(app.watched, 5.0)
        found = values_of(app.watched)
        shown = {name: words for name, (words, _) in found.items() if words != "--"}
        assert sorted(shown) == ["loss", "mode", "state", "vehicle"]
        assert shown["mode"] == "mode 5, disarmed"
        scene = scene_of(app.watched)
        assert (scene.robot, scene.placed, scene.trail) == (None, False, ())
        assert app.watched.mission is None
        empty = VehicleApp(MemoryNetwork(), 0, tmp_path, appearance=Appearance(hz=0))
    async with empty.run_test(size=(100, 30)):
        go_on(empty.watched, 3.0)
        empty.draw()
        assert "no vehicle heard for 3 s" in words_of(empty.query_one("#status", Lines).rows[0])


async def test_recording_is_a_tlog_without_keys(tmp_path: Path) -> None:
    vehicle = GoodVehicle()
    app = VehicleApp(MemoryNetwork(vehicle), 0, tmp_path, appearance=Appearance(hz=0))
    async with app.run_test(size=(100, 30)) as pilot:
        go_on(app.watched, 2.0)
        await pilot.press("r")
        key = mavlink.MAVLink_setup_signing_message(1, 1, list(range(32)), 0)
        vehicle.send(key)
        vehicle.text("written down")
        for _ in range(5):
            go_on(app.watched, 1.0)
            app.poll()
        await pilot.press("r")
        app.draw()
        assert "recorded" in words_of(app.query_one("#status", Lines).rows[0])
    (path,) = tmp_path.glob("*.tlog")
    assert bytes(range(32)) not in path.read_bytes()
    log = mavutil.mavlink_connection(str(path))
    names = []
    while (one := log.recv_msg()) is not None:
        names.append(one.get_type())
    log.close()
    assert names.count("ATTITUDE") == pytest.approx(50, abs=3)
    assert "STATUSTEXT" in names
    assert "SETUP_SIGNING" not in names
    assert "BAD_DATA" not in names


class Replayed(MemoryNetwork):
    """The frames of a .tlog, at their times."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        data = path.read_bytes()
        self._due: list[tuple[int, bytes]] = []
        at = 0
        while at + 8 < len(data):
            time_us = int.from_bytes(data[at : at + 8], "big")
            length = data[at + 9] + (12 if data[at + 8] == 0xFD else 8)
            self._due.append((time_us * 1000, data[at + 8 : at + 8 + length]))
            at += 8 + length
        self._offset_ns = self.now_ns() - self._due[0][0]

    def _taken(self) -> list[Heard]:
        found = []
        while self._due and self._due[0][0] + self._offset_ns <= self.now_ns():
            found.append(Heard(0, self._due.pop(0)[1], self.now_ns()))
        return found


def tlog(path: Path, kind: int, autopilot: int, base_mode: int, mode: int) -> Path:
    """Write a log as ground stations do: eight bytes with the time before each frame."""
    encoder = mavlink.MAVLink(None, 3, 1)
    found = b""
    for tick in range(40):
        messages = [
            mavlink.MAVLink_attitude_message(tick * 250, 0, 0, 1.0, 0, 0, 0),
            mavlink.MAVLink_global_position_int_message(
                tick * 250, 473_977_418 + 50 * tick, 85_455_939, 488_000, 0, 0, 0, 0, 5730
            ),
        ]
        if tick % 4 == 0:
            messages.append(
                mavlink.MAVLink_heartbeat_message(kind, autopilot, base_mode, mode, 4, 3)
            )
        for one in messages:
            found += (1_700_000_000_000_000 + tick * 250_000).to_bytes(8, "big")
            found += one.pack(encoder)
            encoder.seq = (encoder.seq + 1) % 256
    path.write_bytes(found)
    return path


@each(
    ("kind", "autopilot", "base_mode", "mode", "vehicle", "shown"),
    [
        (2, 3, 209, 5, "ArduPilot quadrotor", "LOITER, armed"),
        (10, 3, 65, 4, "ArduPilot ground rover", "HOLD, disarmed"),
        (1, 3, 81, 11, "ArduPilot fixed wing", "RTL, disarmed"),
        (2, 12, 209, 4 << 16 | 4 << 24, "PX4 quadrotor", "AUTO MISSION, armed"),
        (2, 12, 81, 3 << 16, "PX4 quadrotor", "POSCTL, disarmed"),
        (10, 0, 81, 7, "generic ground rover", "mode 7, disarmed"),
    ],
)
def test_replayed_logs_of_autopilots_are_shown(
    kind: int, autopilot: int, base_mode: int, mode: int, vehicle: str, shown: str, tmp_path: Path
) -> None:
    path = tlog(tmp_path / f"{kind}-{autopilot}-{mode}.tlog", kind, autopilot, base_mode, mode)
    watch = watched(Replayed(path), 9.0)
    found = values_of(watch)
    assert (found["vehicle"][0], found["mode"][0]) == (vehicle, shown)
    assert found["heading"] == ("57°", "text")
    assert found["battery"] == ("--", "faint")
    assert found["loss"][0] == "0.0 %"
    assert watch.trail[-1].y_m - watch.trail[0].y_m == pytest.approx(35 * 50 * 0.0111, rel=0.1)
    go_on(watch, 8.0)
    assert values_of(watch)["mode"] == (f"{shown} (8 s old)", "faint")


def test_long_texts_are_joined_and_shown_once() -> None:
    vehicle = GoodVehicle()
    watch = watched(MemoryNetwork(vehicle), 2.0)
    words = "a reason that is longer than one message of fifty characters can hold"
    for chunk, at in enumerate(range(0, len(words), 50)):
        part = words.encode()[at : at + 50]
        vehicle.send(mavlink.MAVLink_statustext_message(4, part, 9, chunk))
    go_on(watch, 1.0)
    assert [one.text for one in watch.texts] == [words]


def test_chosen_system_is_watched_among_several() -> None:
    class Second(GoodVehicle):
        system = 2

    watch = watched(MemoryNetwork(GoodVehicle(), Second()), 3.0, system=2)
    assert watch.system == 2
    assert {frame.component for frame in watch.messages.values()} == {1}


def test_bytewise_integers_of_px4_are_integers() -> None:
    class Px4(GoodVehicle):
        def build_heartbeat(self) -> Any:
            return mavlink.MAVLink_heartbeat_message(2, 12, 81, 3 << 16, 3, 3)

        def value(self, name: str) -> Any:
            message = super().value(name)
            if name == "NAVIGATOR_X":
                message.param_value = unpack("<f", pack("<i", 2))[0]
            return message

    watch = watched(MemoryNetwork(Px4()), 3.0)
    assert watch.number(watch.parameters.values["NAVIGATOR_X"]) == 2
    assert watch.number(watch.parameters.values["RADIUS_X"]) == 0.5


def test_mode_of_an_unknown_autopilot_is_a_number() -> None:
    heartbeat = mavlink.MAVLink_heartbeat_message(10, 3, 1, 99, 4, 3)
    assert mode_name(heartbeat) == "mode 99"


def test_watch_needs_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    from ground.cli.main import main

    assert main(["mavlink", "watch", "udpout:127.0.0.1:14550"]) == 2
    assert "needs a terminal" in capsys.readouterr().err


class OwnGateway:
    """The gateway of this project, in simulated time, with a robot at 3 4 that looks to 135 deg."""

    def __init__(self) -> None:
        port = CommandedPort()
        port.telemetry |= everything()
        self.sends: list[tuple[int, bytes]] = []
        self.whole = WholeGateway(port)
        self._now_ns = 0

    def receive(self, peer: int, data: bytes, now_ns: int) -> None:
        """Take bytes of a client."""
        self.whole.endpoint.deliver(str(peer), data)

    def due(self, now_ns: int) -> None:
        """Let time pass."""
        self.whole.advance(now_ns - self._now_ns if self._now_ns else 0)
        self._now_ns = now_ns
        sent, self.whole.endpoint.sent = self.whole.endpoint.sent, []
        self.sends += [(int(peer), data) for peer, data in sent]


def test_values_of_our_gateway_are_those_of_the_robot() -> None:
    own = OwnGateway()
    watch = watched(MemoryNetwork(own), 6.0)
    found = values_of(watch)
    own.whole.close()
    robot = odometry()
    mark = scene_of(watch).robot
    assert mark is not None
    assert (mark.x_m, mark.y_m) == pytest.approx((robot.x_m, robot.y_m), abs=1e-5)
    assert mark.heading_rad % (2 * pi) == pytest.approx(robot.heading_rad, abs=1e-5)
    assert found["mode"] == ("HOLD, disarmed", "text")
    assert found["local"] == (f"{robot.x_m:.2f} E {robot.y_m:.2f} N m", "text")
    assert found["speed"] == (f"{robot.speed_m_s:.2f} m/s", "text")
    assert found["heading"] == ("315°", "text")
    assert found["loss"] == ("0.0 %", "text")
