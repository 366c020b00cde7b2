"""The ROS 2 gateway as a process: a kill, and a flood of commands beside ten subscribers."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from checks.harness.crew import Crew, Witness
from checks.harness.processes import Running
from checks.harness.until import until
from protocol.wire.enums import Mode
from tests.support.gateway.ros_network import RosPeer, free_endpoint

pytestmark = pytest.mark.stack
TWIST = "geometry_msgs/msg/Twist"
SUBSCRIBERS = 10
TICKS = 200


def twist(peer: RosPeer, speed_m_s: float, turn_rad_s: float) -> Any:
    make, vector = peer.interfaces.make, "geometry_msgs/msg/Vector3"
    return make(TWIST, make(vector, speed_m_s, 0.0, 0.0), make(vector, 0.0, 0.0, turn_rad_s))


@contextmanager
def sending(peer: RosPeer, speed_m_s: float, turn_rad_s: float, pause_s: float) -> Iterator[None]:
    """Publish a command over and over, from a thread of its own."""
    over, message = threading.Event(), twist(peer, speed_m_s, turn_rad_s)

    def send() -> None:
        while not over.wait(pause_s):
            peer.put("/r1/cmd_vel", TWIST, message)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def robot_of_ros(crew: Crew) -> Iterator[tuple[RosPeer, Running, Witness]]:
    """Run a robot and its gateway beside a router with a node; yield node, gateway and witness."""
    crew.robot()
    crew.plant()
    peer = RosPeer(free_endpoint())
    try:
        with Witness(crew.endpoint) as witness:
            gateway = crew.dialling("run", "ros2", "--router", peer.endpoint)
            crew.in_real_time()
            until(lambda: any("cmd_vel" in one for one in peer.tokens()), "cmd_vel")
            yield peer, gateway, witness
    finally:
        peer.close()


@pytest.mark.parametrize("crew", [Crew(lockstep=True)])
def test_killed_gateway_leaves_the_graph_and_the_robot_stops(crew: Crew) -> None:
    with crew, robot_of_ros(crew) as (peer, gateway, witness):
        with sending(peer, 0.2, 0.0, 0.05):
            until(lambda: witness.truth.speed_m_s > 0.15, "driving")
            os.kill(gateway.pid, signal.SIGKILL)
            until(lambda: not peer.tokens(), "an empty graph")
        until(witness.standing, "standing")


@pytest.mark.realtime
def test_flood_of_commands_costs_the_robot_no_tick() -> None:
    with Crew() as crew, robot_of_ros(crew) as (peer, _, witness):
        kept = [peer.session.declare_subscriber("0/**", id) for _ in range(SUBSCRIBERS)]
        turns = sending(peer, 0.0, 0.5, 0.0005)
        with turns:
            until(lambda: witness.status.mode == Mode.MANUAL and witness.report, "MANUAL")
            before = witness.cycles[-1][0]
            until(lambda: witness.cycles[-1][0].tick >= before.tick + TICKS, "ticks", TICKS / 10)
            after = witness.cycles[-1][0]
        assert after.missed - before.missed == 0
        assert witness.status.mode == Mode.MANUAL
        assert len(kept) == SUBSCRIBERS
