"""A network of ROS 2 with a client of its own: a Zenoh router that publishes, reads and asks.

It is written with plain Zenoh, and with the names and bytes of `gateways.ros2.wire`, which other
tests compare with those of real nodes.
"""

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any

import zenoh
from zenoh import ext

from checks.harness import until as harness
from gateways.ros2.face import FaceSettings, RobotFace
from gateways.ros2.interfaces import Interfaces
from gateways.ros2.node import RosSession, session_config
from gateways.ros2.wire import (
    Attachment,
    Distro,
    Endpoint,
    EntityKind,
    NodeName,
    gid_of,
    hash_of,
    read_attachment,
)
from ground.client.connection import Common
from ground.robot import Robot
from ground.ros2.offer import RELIABLE, Qos, RosTopic
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from runtime.units import NS_PER_S
from tests.support.stacks import Lively

FETCH_S = 0.5
"""Time for what a latched topic has kept."""


def free_endpoint() -> str:
    """Return an endpoint of this machine that no process uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


async def until(condition: Callable[[], object], what: str = "") -> None:
    """Wait on the event loop until the condition holds; TimeoutError when it does not in time."""
    try:
        async with asyncio.timeout(harness.PATIENCE_S):
            while not condition():
                await asyncio.sleep(0.005)
    except TimeoutError:
        raise TimeoutError(f"not in time: {what}") from None


class RosPeer:
    """A node on the network, at the router that it is itself."""

    def __init__(self, endpoint: str, domain: int = 0, distro: Distro = Distro.JAZZY) -> None:
        self.endpoint = endpoint
        config = zenoh.Config()
        settings = {
            "mode": "router",
            "listen/endpoints": [endpoint],
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,
        }
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        self.session: Any = zenoh.open(config)
        self.interfaces, self.domain = Interfaces(distro), domain
        self.seen: dict[str, list[tuple[Any, Attachment]]] = {}
        self._sequence = self._count = 0
        self.gid = bytes(range(16))
        self._kept: list[Any] = []

    def close(self) -> None:
        self.session.close()

    def key(self, name: str, type_name: str) -> str:
        hashed = hash_of(type_name, self.interfaces.distro)
        return Endpoint(name, type_name, hashed).key(self.domain)

    def tokens(self) -> list[str]:
        """Return all liveliness tokens."""
        replies = self.session.liveliness().get(f"@ros2_lv/{self.domain}/**", timeout=1.0)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok]

    def show_client(self, service: str, type_name: str) -> Any:
        """Show the token of a client of a service, whose id its requests then carry."""
        self._count += 1
        endpoint = Endpoint(service, type_name, hash_of(type_name, self.interfaces.distro))
        node = NodeName("", "tester")
        zid = str(self.session.zid())
        token = node.endpoint_token(
            self.domain, zid, self._count, EntityKind.CLIENT, endpoint, RELIABLE
        )
        self.gid = gid_of(token)
        return self.session.liveliness().declare_token(token)

    def listen(self, name: str, type_name: str) -> list[tuple[Any, Attachment]]:
        """Return the list to which each message of a topic is added, with its attachment."""
        found = self.seen.setdefault(name, [])

        def take(sample: Any) -> None:
            message = self.interfaces.decode(type_name, sample.payload.to_bytes())
            attachment = read_attachment(sample.attachment.to_bytes())
            assert message is not None
            assert attachment is not None
            found.append((message, attachment))

        self._kept.append(self.session.declare_subscriber(self.key(name, type_name), take))
        return found

    def late(self, name: str, type_name: str, qos: Qos) -> list[Any]:
        """Return what a subscriber gets that comes after a latched topic was published."""
        found: SimpleQueue[Any] = SimpleQueue()
        subscriber: Any = ext.declare_advanced_subscriber(
            self.session,
            self.key(name, type_name),
            found.put,
            history=ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth),
        )
        messages = []
        with suppress(Empty):
            while True:
                sample = found.get(timeout=FETCH_S)
                messages.append(self.interfaces.decode(type_name, sample.payload.to_bytes()))
        subscriber.undeclare()
        return messages

    def attachment(self) -> bytes:
        self._sequence += 1
        return Attachment(self._sequence, time.time_ns(), self.gid).packed()

    def put(self, name: str, type_name: str, message: object) -> None:
        data = self.interfaces.encode(type_name, message)
        # As a reliable publisher of ROS: by default Zenoh drops what a busy link cannot take.
        self.session.put(
            self.key(name, type_name),
            data,
            attachment=self.attachment(),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    async def ask(self, name: str, type_name: str, request: object = None) -> Any:
        """Return the answer of a service; AssertionError for one that is none."""
        if request is None:
            request = self.interfaces.make(f"{type_name}_Request", 0)
        data = self.interfaces.encode(f"{type_name}_Request", request)
        return await asyncio.to_thread(self._ask, self.key(name, type_name), type_name, data)

    def _ask(self, key: str, type_name: str, data: bytes) -> Any:
        beside = self.attachment()
        found: list[Any] = []

        def is_answered() -> bool:
            replies = self.session.get(
                key,
                payload=data,
                attachment=beside,
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=harness.PATIENCE_S,
            )
            found.extend(one.ok or one.err for one in replies)
            return bool(found)

        harness.until(is_answered, key)  # a server that is not there yet, for which ROS waits
        (reply,) = found
        assert isinstance(reply, zenoh.Sample), reply.payload.to_string()
        assert reply.attachment is not None
        mine, theirs = read_attachment(beside), read_attachment(reply.attachment.to_bytes())
        assert mine is not None
        assert theirs is not None
        assert (mine.sequence, mine.gid) == (theirs.sequence, theirs.gid)
        response = self.interfaces.decode(f"{type_name}_Response", reply.payload.to_bytes())
        assert response is not None
        return response


def bus_of(stack: Lively, person: str = "ros2") -> Bus:
    """Open a bus of an operator beside the stack."""
    network = Network(mode="client", connect=(stack._hub,), prefix=stack._prefix, person=person)
    return open_bus(network, Role.GROUND, "r1")


@asynccontextmanager
async def presented(
    stack: Lively,
    endpoint: str,
    *,
    distros: Sequence[Distro] = (Distro.JAZZY,),
    note: Callable[[str], None] = lambda _: None,
    record: Callable[[RosTopic, bytes], None] | None = None,
    **settings: Any,
) -> AsyncIterator[RobotFace]:
    """Present the robot of a stack at the router of this endpoint."""
    with bus_of(stack) as bus:
        robot = Robot(bus, Common(network=bus.network, robot="r1"), "ros2")
        await robot.open()
        first, *others = map(Interfaces, distros)
        config = session_config({}, endpoint)
        session = RosSession(first, config, note=note, others=others, record=record)
        session.start()
        face = RobotFace(robot, session, FaceSettings(**{"namespace": "/r1", **settings}), note)
        running = asyncio.create_task(face.run())
        try:
            yield face
            assert not running.done(), running.exception()
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
            await robot.close()
            await asyncio.to_thread(session.close)


def seconds(stamp: Any) -> float:
    """Return a time of ROS in seconds."""
    return float(stamp.sec + stamp.nanosec / NS_PER_S)
