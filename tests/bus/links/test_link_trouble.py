"""Behaviour of the link when a process dies or returns."""

import socket
import subprocess
import sys

from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import WHEELS, Role
from protocol.wire.messages import WheelTicks
from tests.support.bus.nets import net
from tests.support.until import PATIENCE_S, until

TICKS = WheelTicks(time_ns=1, seq=1, left=2, right=-3, bumper=0, expired=0)

ANNOUNCED = """
import sys
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import Role
network = Network(mode="client", connect=(sys.argv[1],), prefix=sys.argv[2])
with open_bus(network, Role.GROUND, "r1") as bus:
    bus.announce()
    print("here", flush=True)
    sys.stdin.read()
"""


def test_presence_of_a_killed_process_ends_at_once() -> None:
    with net() as bus:
        gone: list[str] = []
        bus.robot.watch(lambda who, came: None if came else gone.append(who.role))
        with subprocess.Popen(
            [sys.executable, "-c", ANNOUNCED, bus.endpoint, bus.prefix],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={"PYTHONPATH": ":".join(sys.path)},
        ) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"here\n"
            until(lambda: [who.role for who in bus.robot.present()] == ["ground"])
            process.kill()
            until(lambda: gone == ["ground"])
        assert bus.robot.present() == []


def test_restarted_hub_receives_from_old_publishers() -> None:
    with open_bus(Network(mode="peer", listen=("tcp/127.0.0.1:0",)), Role.ROBOT, "r1") as first:
        endpoint = first.locator()
        network = Network(mode="client", connect=(endpoint,))
        plant = open_bus(network, Role.PLANT, "r1")
    with plant:
        wheels = plant.publisher(WHEELS)
        with open_bus(Network(mode="peer", listen=(endpoint,)), Role.ROBOT, "r1") as second:
            ticks = second.mailbox(WHEELS)
            assert plant.await_matched([wheels], PATIENCE_S) == []
            wheels.put(TICKS)
            until(ticks.latest)


def hub(endpoint: str) -> Bus:
    return open_bus(Network(mode="peer", listen=(endpoint,)), Role.ROBOT, "r1")


def test_client_distinguishes_an_ended_from_a_hung_hub() -> None:
    with hub("tcp/127.0.0.1:0") as first:
        endpoint = first.locator()
        client = open_bus(Network(mode="client", connect=(endpoint,)), Role.GROUND, "r1")
        assert client.lost() == ""
    with client:
        until(lambda: client.lost() == f"the process at {endpoint} has ended")
        host, _, port = endpoint.removeprefix("tcp/").partition(":")
        with socket.create_server((host, int(port))):  # takes the call, as a stopped one does
            assert client.lost().endswith("no longer answers: it is slow or hangs")


def test_a_publisher_knows_when_its_last_reader_has_left() -> None:
    with net() as bus:
        wheels = bus.plant.publisher(WHEELS)
        bus.ground.mailbox(WHEELS)
        assert bus.plant.await_matched([wheels], PATIENCE_S) == []
        bus.ground.close()
        until(lambda: not wheels.matched)
