"""`ros2 check`: a good robot, a broken one, and a network with nothing on it."""

import argparse
import asyncio
import io
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from itertools import count
from math import nan
from typing import Any

import numpy as np
import pytest

from gateways.ros2 import check_verb
from gateways.ros2.interfaces import Interfaces
from gateways.ros2.node import RosNode, RosSession, session_config
from gateways.ros2.wire import Distro
from ground.ros2.offer import LATCHED, SENSOR_DATA
from ground.text.output import Output
from runtime.errors import RemoteError
from tests.support.gateway.ros_network import RosPeer, presented, until
from tests.support.stacks import Paced


class Checked:
    """The exit code and the result of a check."""

    def __init__(self, code: int, text: str) -> None:
        self.code, self.result = code, json.loads(text)

    @property
    def rows(self) -> dict[str, tuple[str, str]]:
        """Verdict and evidence of each row by its title."""
        (robot,) = self.result["robots"]
        return {one["title"]: (one["verdict"], one["evidence"]) for one in robot["rows"]}

    def of(self, verdict: str) -> set[str]:
        return {title for title, (found, _) in self.rows.items() if found == verdict}


def check(endpoint: str, *words: str) -> Checked:
    parser = argparse.ArgumentParser()
    check_verb.arguments(parser)
    options = parser.parse_args(["check", "--router", endpoint, "--seconds", "2", "--json", *words])
    out = io.StringIO()
    code = check_verb.run(options, Output(as_json=True, out=out, err=io.StringIO()))
    return Checked(code, out.getvalue())


@pytest.mark.realtime
async def test_robot_of_this_project_passes(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint, scan=True) as face:
        await until(lambda: face.is_ready() and face.limits[0] > 0)
        found = await asyncio.to_thread(check, peer.endpoint)
    assert (found.code, found.of("fail")) == (0, set()), found.rows
    assert found.of("not tried") == {"x forward, turns to the left, m and rad (REP 103)"}
    assert found.of("not offered") == set()
    (robot,) = found.result["robots"]
    topics = {one["topic"]: one for one in robot["topics"]}
    assert robot["namespace"] == "/r1"
    assert topics["/r1/odom"]["rate_hz"] > 5
    assert topics["/r1/odom"]["age_ms"] is not None


ROTATION = "geometry_msgs/msg/Quaternion"


class Broken:
    """A node with most faults that a robot can have."""

    def __init__(self, session: RosSession) -> None:
        self.make, self.numbers = session.interfaces.make, count(1)
        node = RosNode(session, "/bad", "robot")
        RosNode(session, "/bad", "robot")
        self.odom = node.publisher("odom", "nav_msgs/msg/Odometry")
        self.tf = node.publisher("tf", "tf2_msgs/msg/TFMessage")
        self.sonar = node.publisher("sonar", "sensor_msgs/msg/Range", SENSOR_DATA)
        self.joints = node.publisher("joint_states", "sensor_msgs/msg/JointState")
        self.clock = node.publisher("/clock", "rosgraph_msgs/msg/Clock")
        urdf = node.publisher("robot_description", "std_msgs/msg/String", LATCHED)
        urdf.publish(self.make("std_msgs/msg/String", '<robot><link name="arm"/></robot>'))
        self.told = node.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        kind = "rcl_interfaces/srv/ListParameters"
        node.serve("~/list_parameters", kind, self.never)
        node.serve("bt_navigator/get_state", "lifecycle_msgs/srv/GetState", self.never)
        node.publisher("navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray")
        self.shown = node

    async def never(self, _request: Any, _attachment: Any) -> Any:
        raise RuntimeError("broken")

    def header(self, frame: str, stamp_s: int = 1) -> Any:
        time = self.make("builtin_interfaces/msg/Time", stamp_s, 0)
        return self.make("std_msgs/msg/Header", time, frame)

    def pose(self) -> Any:
        where = self.make("geometry_msgs/msg/Point", nan, 0.0, 0.0)
        return self.make("geometry_msgs/msg/Pose", where, self.make(ROTATION, 0.0, 0.0, 0.0, 0.0))

    def transform(self, parent: str, child: str) -> Any:
        vector = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        inner = self.make(
            "geometry_msgs/msg/Transform", vector, self.make(ROTATION, 0.0, 0.0, 0.0, 2.0)
        )
        name = "geometry_msgs/msg/TransformStamped"
        return self.make(name, self.header(parent), child, inner)

    def publish(self) -> None:
        make, vector = self.make, self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        covered = make("geometry_msgs/msg/PoseWithCovariance", self.pose(), np.zeros(36))
        still = make("geometry_msgs/msg/Twist", vector, vector)
        moving = make("geometry_msgs/msg/TwistWithCovariance", still, np.zeros(36))
        self.odom.publish(
            make("nav_msgs/msg/Odometry", self.header("world"), "robot", covered, moving)
        )
        found = [self.transform("a", "b"), self.transform("c", "b"), self.transform("x", "y")]
        self.tf.publish(make("tf2_msgs/msg/TFMessage", found))
        self.sonar.publish(
            make("sensor_msgs/msg/Range", self.header("none"), 0, 0.3, 0.1, 3.0, 5.0, 0.0)
        )
        part = make("diagnostic_msgs/msg/DiagnosticStatus", 9, "", "", "", [])
        self.told.publish(make("diagnostic_msgs/msg/DiagnosticArray", self.header(""), [part]))
        values = (np.zeros(2), np.zeros(0), np.zeros(0))
        self.joints.publish(make("sensor_msgs/msg/JointState", self.header(""), ["a"], *values))
        back = make("builtin_interfaces/msg/Time", 1000 - next(self.numbers), 0)
        self.clock.publish(make("rosgraph_msgs/msg/Clock", back))


@asynccontextmanager
async def on_network(peer: RosPeer, new: Callable[[RosSession], Any]) -> AsyncIterator[Any]:
    session = RosSession(Interfaces(Distro.JAZZY), session_config({}, peer.endpoint))
    made = new(session)
    session.start()
    try:
        yield made
    finally:
        await asyncio.to_thread(session.close)


async def test_each_fault_of_a_broken_node_is_named(peer: RosPeer) -> None:
    async with on_network(peer, Broken) as node:
        running = asyncio.create_task(asyncio.to_thread(check, peer.endpoint))
        key = peer.key("/bad/odom", "nav_msgs/msg/Odometry")
        while not running.done():
            node.publish()
            peer.session.put(key, b"\0\1\0\0")
            await asyncio.sleep(0.02)
        found = running.result()
    assert found.code == 1
    rows = found.rows
    for title, words in (
        ("nodes with names of their own", "2 nodes have the name /bad/robot"),
        ("each sample has its attachment", "/bad/odom: "),
        ("odometry: rate, frames, covariance", "'world' -> 'robot' instead of odom -> base_link"),
        ("transforms are one tree (REP 105)", "b has the parents a and c"),
        ("stamps are of the measurement, and fresh", "s old on arrival"),
        ("range sensors (REP 117)", "no transform to its frame 'none'"),
        ("joint states", "1 names, but {2} values"),
        ("robot_description is latched URDF", "no transform to its link arm"),
        ("/clock of a simulation", "it goes back"),
        ("/diagnostics and /rosout", "a level that is none"),
        ("six services of parameters", "/bad/robot: no describe_parameters"),
        ("action navigate_to_pose", "without send_goal, get_result, cancel_goal, feedback"),
        ("state of the navigator", "does not answer"),
    ):
        verdict, evidence = rows[title]
        assert (verdict, words in evidence) == ("fail", True), (title, rows[title])
    assert found.of("not offered") == {"cmd_vel is taken", "emergency_stop"}


def raised(endpoint: str, *words: str) -> str:
    with pytest.raises(RemoteError) as found:
        check(endpoint, *words)
    return str(found.value)


async def test_network_without_a_robot_says_what_is_there(
    peer: RosPeer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_verb, "GRAPH_S", 1.0)
    ask = partial(asyncio.to_thread, raised, peer.endpoint)
    assert "no node in domain 0" in await ask()

    async with on_network(peer, lambda session: RosNode(session, "/lab", "talker")):
        await until(lambda: peer.tokens())
        assert "domain 0 has /lab/talker; none of them publishes nav_msgs/Odometry" in await ask()
        assert "no node in domain 7" in await ask("--domain", "7")


async def test_missing_router_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_verb, "ROUTER_S", 0.3)
    why = await asyncio.to_thread(raised, "tcp/127.0.0.1:1")
    assert 'no ROS 2 router at ["tcp/127.0.0.1:1"]: start one with' in why
