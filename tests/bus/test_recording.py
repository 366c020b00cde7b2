"""Recorders, router and bridge over a bus, until a signal ends them."""

import asyncio
import contextlib
import json
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from checks.harness.until import PATIENCE_S, interrupt_when, until
from gateways.foxglove_bridge import Bridge, place, served
from ground.cli.main import main
from ground.client.connection import Common
from ground.client.robot_link import RobotLink
from ground.launch.recording_session import RecordingSession
from ground.recording.log_reader import open_log, read
from ground.recording.log_writer import LogFile
from ground.recording.mcap_file import RAW_TOPIC
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import ENCODING, MARK, SONAR, WORLD, Role
from protocol.wire.codec import decode
from protocol.wire.messages import Heartbeat, NavigatorStatus, Statustext
from protocol.wire.statustext import StatustextAssembler
from runtime.clock import WallClock
from runtime.errors import UserError
from tests.support.ground.made_recordings import WORLD_TEXT
from tests.support.played_robot import PlayedRobot, played


def size_of(folder: Path) -> int:
    return sum(log.stat().st_size for log in folder.glob("*.tlog"))


def test_every_frame_is_kept_and_what_is_no_frame_is_not(
    stage: tuple[PlayedRobot, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, endpoint = stage
    noise = robot.bus.publisher(SONAR)

    def enough() -> bool:
        noise.put_frame(b"garbage")
        return size_of(tmp_path) > 3000

    interrupt_when(enough)
    assert main(["record", str(tmp_path), "--connect", endpoint, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    kept = [record.frame for record in read(Path(told["file"]))]
    frames = [decode(frame).message for frame in kept]
    assert told["frames"] == len(frames)
    assert told["rejected"] > 0
    log = open_log(Path(told["mcap"]))
    assert [one.frame for one in log] == kept
    assert log.damage() == ""
    assert "d_obs_m" in log.facts["parameters"]
    assert {type(frame) for frame in frames} >= {Heartbeat, NavigatorStatus}


def test_a_full_disk_is_shouted_and_ends_with_1(
    stage: tuple[PlayedRobot, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tries: list[int] = []

    def full(log: LogFile, batch: bytes) -> None:
        tries.append(len(batch))
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(LogFile, "append", full)
    interrupt_when(lambda: len(tries) > 2)
    assert main(["record", str(tmp_path), "--connect", stage[1]]) == 1
    said = capsys.readouterr()
    assert "RECORDING FAILS: No space left on device; the robot drives on" in said.err
    assert said.err.count("RECORDING FAILS") == 1, "reported once, not four times a second"
    assert "LOST" in said.out


def test_a_folder_that_cannot_be_made_is_refused(stage: tuple[PlayedRobot, str]) -> None:
    assert main(["record", "/proc/nowhere", "--connect", stage[1]]) == 2


def test_export_writes_a_table_and_reports_damage(
    tmp_path: Path, stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt_when(lambda: size_of(tmp_path) > 1000)
    main(["record", str(tmp_path), "--connect", stage[1]])
    (log,) = tmp_path.glob("*.tlog")
    capsys.readouterr()
    assert main(["export", str(log)]) == 0
    assert capsys.readouterr().out.startswith("time_s,utc_s,topic,message,field,value\n")
    log.write_bytes(log.read_bytes()[:-3])
    assert main(["export", str(log), "--out", str(tmp_path / "t.csv"), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["lost_bytes"] > 0


def test_mark_reaches_the_recorder(
    stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    heard: list[Statustext] = []

    def take(_key: str, frame: bytes, _at_ns: int) -> None:
        message = decode(frame).message
        assert isinstance(message, Statustext)
        heard.append(message)

    words = "a cart stands in the way, and it was not there before lunch"
    assert main(["mark", words, "--connect", stage[1]]) == 1
    assert "no recorder is running" in capsys.readouterr().out
    stage[0].bus.stream(MARK, take)
    assert main(["mark", *words.split(), "--connect", stage[1]]) == 0
    until(lambda: len(heard) == 2)
    texts = StatustextAssembler()
    assert [texts.receive(piece) for piece in heard] == ["", words]


def test_ground_is_an_operator_until_it_is_ended(
    stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    robot, endpoint = stage
    interrupt_when(lambda: robot.beats >= 3)
    assert main(["ground", "--connect", endpoint]) == 130
    said = capsys.readouterr().err
    assert robot.beats >= 3
    assert "STANDBY GUIDED NONE" in said


def test_watch_only_looks(
    stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]
) -> None:
    robot, endpoint = stage
    said: list[str] = []

    def shown() -> bool:
        said.extend(capsys.readouterr())
        return "STANDBY" in "".join(said)

    interrupt_when(shown, signal.SIGTERM)
    assert main(["watch", "--connect", endpoint]) == 143
    assert robot.beats == 0
    assert "Traceback" not in "".join((*said, *capsys.readouterr()))


def test_router_forwards_samples(capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[bytes] = []

    def meet() -> bool:
        said = capsys.readouterr().err
        if "router at " not in said:
            return False
        network = Network(mode="client", connect=(said.split("router at ")[1].split()[0],))
        with (
            open_bus(network, Role.PLANT, "r1") as one,
            open_bus(network, Role.ROBOT, "r1") as two,
        ):
            two.stream(SONAR, lambda _key, frame, _at: heard.append(frame))
            publisher = one.publisher(SONAR)
            one.await_matched([publisher], timeout_s=PATIENCE_S)
            publisher.put_frame(b"hello")
            until(lambda: heard)
        return True

    interrupt_when(meet, signal.SIGTERM)
    assert main(["router", "--listen", "tcp/127.0.0.1:0"]) == 0
    assert heard == [b"hello"]


PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
DATA_HEAD = 1 + 4 + 8
WANTED = frozenset({"/world", "/robot/pose", "/tlm/status/NavigatorStatus", RAW_TOPIC})


@pytest.fixture
def port() -> Iterator[int]:
    """Run a bridge beside a publishing robot and yield its port."""
    with played() as (robot, endpoint):
        robot.pose = (1.25, 0.5, 0.0)
        robot.bus.serve(WORLD, lambda asked: asked.reply(WORLD_TEXT.encode()))
        network = Network(mode="client", connect=(endpoint,))
        common = Common(network=network, robot="r1")
        with open_bus(network, Role.GROUND, "r1") as bus:
            bridge = Bridge(RobotLink(bus, common, WallClock()))
            stop = threading.Event()
            rounds = threading.Thread(target=go_round, args=(bridge, stop))
            rounds.start()
            try:
                until(lambda: bridge.topics >= WANTED)
                server = served(place("127.0.0.1:0"), "r1")
                yield server.port
                server.stop()
            finally:
                stop.set()
                rounds.join()


def go_round(bridge: Bridge, stop: threading.Event) -> None:
    clock = WallClock()
    while not stop.wait(0.02):
        bridge.round(clock.now_ns())


async def viewed(port: int, topics: frozenset[str], origin: str | None = None) -> dict[str, Any]:
    """Return the first message of each topic that a newly connected viewer receives."""
    found: dict[str, Any] = {}
    channels: dict[int, str] = {}
    async with (
        asyncio.timeout(PATIENCE_S),
        aiohttp.ClientSession() as session,
        session.ws_connect(
            f"http://127.0.0.1:{port}", protocols=PROTOCOLS, origin=origin
        ) as viewer,
    ):
        while topics - set(found):
            frame = await viewer.receive()
            if frame.type is aiohttp.WSMsgType.TEXT:
                said = json.loads(frame.data)
                if said["op"] != "advertise":
                    continue
                new = {one["id"]: one["topic"] for one in said["channels"]}
                for one in said["channels"]:
                    raw = one["topic"] == RAW_TOPIC
                    assert one["encoding"] == (ENCODING if raw else "json")
                    assert raw or json.loads(one["schema"])["title"]
                channels |= new
                asked = [{"id": number, "channelId": number} for number in new]
                await viewer.send_json({"op": "subscribe", "subscriptions": asked})
            elif frame.type is aiohttp.WSMsgType.BINARY and frame.data[0] == 1:
                number = int.from_bytes(frame.data[1:5], "little")
                topic, data = channels[number], frame.data[DATA_HEAD:]
                found.setdefault(topic, data if topic == RAW_TOPIC else json.loads(data))
    return found


def test_a_viewer_that_connects_sees_the_robot_and_its_world(port: int) -> None:
    found = asyncio.run(viewed(port, WANTED))
    assert found["/robot/pose"]["pose"]["position"]["x"] == 1.25
    assert found["/world"]["entities"][0]["id"] == "walls"
    assert found["/tlm/status/NavigatorStatus"]["mode"] == 15
    assert decode(found[RAW_TOPIC]).message


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://foxglove.dev.evil.example"]
)
def test_page_of_another_site_sees_nothing(port: int, origin: str) -> None:
    with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
        asyncio.run(viewed(port, WANTED, origin))
    assert refused.value.status == 403


def test_foxglove_and_pages_of_this_computer_see_the_robot(port: int) -> None:
    for origin in ("https://app.foxglove.dev", "http://localhost:8080", "file://"):
        assert RAW_TOPIC in asyncio.run(viewed(port, frozenset({RAW_TOPIC}), origin))


def test_request_that_opens_no_web_socket_is_answered(port: int) -> None:
    """A page can send it without an origin, and might then use its connection."""

    async def status() -> int:
        async with (
            aiohttp.ClientSession() as session,
            session.get(f"http://127.0.0.1:{port}") as answer,
        ):
            assert "Foxglove" in await answer.text()
            return answer.status

    assert asyncio.run(status()) == 426


def test_connection_that_says_nothing_holds_up_no_viewer(port: int) -> None:
    with contextlib.ExitStack() as scope:
        for _ in range(10):
            scope.enter_context(socket.create_connection(("127.0.0.1", port)))
        assert RAW_TOPIC in asyncio.run(viewed(port, frozenset({RAW_TOPIC})))


def test_a_place_that_is_taken_is_named(port: int) -> None:
    with pytest.raises(UserError, match=f"cannot listen at 127.0.0.1:{port}"):
        served(place(f"127.0.0.1:{port}"), "r1")


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[RecordingSession]:
    with played() as (_, endpoint):
        network = Network(mode="client", connect=(endpoint,))
        common = Common(network=network, robot="r1")
        with RecordingSession(tmp_path, common, WallClock(), None) as found:
            yield found


def told_until(recording: RecordingSession, condition: Callable[[], bool]) -> list[str]:
    told: list[str] = []

    def met() -> bool:
        told.extend(recording.poll(is_receiving=True))
        return condition()

    until(met, what=lambda: f"told {told}")
    return told


def grown(recording: RecordingSession) -> bool:
    return recording.file is not None and recording.file.stat().st_size > 500


def test_it_is_begun_and_ended(recording: RecordingSession) -> None:
    recording.begin()
    assert told_until(recording, lambda: grown(recording)) == []
    assert recording.words == "REC"
    with pytest.raises(UserError, match="already recording"):
        recording.begin()
    file = Path(recording.end())
    assert recording.words == ""
    for path in (file, file.with_suffix(".mcap")):
        log = open_log(path)
        assert len(list(log)) > 0
        assert log.damage() == ""


def test_killed_recorder_is_reported_and_can_restart(
    recording: RecordingSession,
) -> None:
    recording.begin()
    told_until(recording, lambda: grown(recording))
    (child,) = recording._children.pids
    os.kill(child, signal.SIGKILL)
    (told,) = told_until(recording, lambda: recording.words == "REC!")
    assert "the recorder process exited unexpectedly (signal SIGKILL)" in told
    recording.begin()
    assert told_until(recording, lambda: grown(recording)) == []
