"""The live bridge, seen as a viewer sees it: over its WebSocket, by the published protocol."""

import asyncio
import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from typing import Any

import aiohttp
import pytest

from gateways.foxglove_bridge import Bridge, place, served
from ground.client.connection import Common
from ground.client.link import Link
from ground.recording.mcap_file import RAW_TOPIC
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import ENCODING, WORLD, Role
from protocol.wire.codec import decode
from runtime.clock import WallClock
from runtime.errors import UserError
from tests.support.bus.robots import played
from tests.support.ground.recording.made import WORLD_TEXT
from tests.support.until import PATIENCE_S, until

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
            bridge = Bridge(Link(bus, common, WallClock()))
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
