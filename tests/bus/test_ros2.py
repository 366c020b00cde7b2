"""A robot as a ROS 2 node: a stack in this process, and a client on a Zenoh network of its own."""

from collections.abc import Iterator
from functools import partial
from math import isinf

import pytest

from gateways.ros2.wire import LATCHED, Distro, EntityKind, gid_of, read_token
from protocol.topics import ODOMETRY
from tests.support.gateway.ros_network import RosPeer, free_endpoint, presented, seconds, until
from tests.support.stacks import Paced


@pytest.fixture
def stack() -> Iterator[Paced]:
    with Paced() as found, found.going():
        yield found


@pytest.fixture
def peer() -> Iterator[RosPeer]:
    found = RosPeer(free_endpoint())
    yield found
    found.close()


async def test_topics_arrive_with_the_values_of_the_robot(stack: Paced, peer: RosPeer) -> None:
    odometry = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
    sonar = peer.listen("/r1/sonar_3", "sensor_msgs/msg/Range")
    joints = peer.listen("/r1/joint_states", "sensor_msgs/msg/JointState")
    moving = peer.listen("/r1/tf", "tf2_msgs/msg/TFMessage")
    clock = peer.listen("/clock", "rosgraph_msgs/msg/Clock")
    async with presented(stack, peer.endpoint) as face:
        poses = face.robot.stream(ODOMETRY)
        await until(lambda: min(map(len, (odometry, sonar, joints, moving, clock))) > 3)
        known = {pose.time_ns: pose for pose in [await anext(poses) for _ in range(3)]}
        await until(lambda: {one[0].header.stamp.sec for one in odometry})
        await until(lambda: any(ns_of(one[0].header.stamp) in known for one in odometry))
    found = next(one for one, _ in odometry if ns_of(one.header.stamp) in known)
    pose = known[ns_of(found.header.stamp)]
    assert (found.pose.pose.position.x, found.pose.pose.position.y) == (pose.x_m, pose.y_m)
    assert found.pose.covariance[0] == pose.cov_xx_m2
    assert sonar[0][0].header.frame_id == "sonar_3"
    assert isinf(sonar[0][0].range) or sonar[0][0].range > 0
    frames = {one.child_frame_id for message, _ in moving for one in message.transforms}
    assert frames == {"base_link", "left_wheel", "right_wheel"}
    times = [seconds(message.clock) for message, _ in clock]
    assert times == sorted(times)


def ns_of(stamp: object) -> int:
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)  # type: ignore[attr-defined]


async def test_samples_are_counted_and_name_their_publisher(stack: Paced, peer: RosPeer) -> None:
    found = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
    async with presented(stack, peer.endpoint):
        await until(lambda: len(found) > 5)
        tokens = peer.tokens()
    numbers = [attachment.sequence for _, attachment in found]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    (token,) = [one for one in tokens if "%r1%odom/" in one]
    assert {attachment.gid for _, attachment in found} == {gid_of(token)}


async def test_graph_has_the_node_and_its_topics_until_it_ends(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint, scan=True):
        await until(partial(shows, peer, "%r1%scan/"))
        parts = [read_token(token) for token in peer.tokens()]
    assert {one.node for one in parts if one} == {"/r1/sidestep"}
    topics = {one.topic for one in parts if one and one.kind is EntityKind.PUBLISHER}
    assert {"/r1/odom", "/r1/tf", "/r1/tf_static", "/r1/sonar_0", "/r1/scan", "/clock"} <= topics
    await until(lambda: not peer.tokens())


async def test_late_joiner_gets_the_latched_topics(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint):
        live = peer.listen("/r1/tf_static", "tf2_msgs/msg/TFMessage")
        await until(lambda: peer.late("/r1/tf_static", "tf2_msgs/msg/TFMessage", LATCHED))
        (description,) = peer.late("/r1/robot_description", "std_msgs/msg/String", LATCHED)
        (static,) = peer.late("/r1/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
    assert description.data.startswith('<?xml version="1.0"?>\n<robot name="r1">')
    assert len(static.transforms) == 9
    assert len(live) <= 1


async def test_face_starts_without_a_router_and_comes_back_after_one(stack: Paced) -> None:
    endpoint, notes = free_endpoint(), list[str]()
    async with presented(stack, endpoint, note=notes.append):
        await until(lambda: notes)
        assert "no ROS 2 router" in notes[0]
        for _ in range(2):
            peer = RosPeer(endpoint)
            found = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
            await until(partial(len, found))
            await until(partial(shows, peer, "%r1%odom/"))
            assert peer.late("/r1/robot_description", "std_msgs/msg/String", LATCHED)
            peer.close()


def shows(peer: RosPeer, part: str) -> bool:
    return any(part in token for token in peer.tokens())


async def test_other_domain_hears_nothing(stack: Paced, peer: RosPeer) -> None:
    keys: set[str] = set()
    listening = peer.session.declare_subscriber("**", lambda one: keys.add(str(one.key_expr)))
    async with presented(stack, peer.endpoint):
        await until(lambda: any("odom" in key for key in keys))
    listening.undeclare()
    assert {key.partition("/")[0] for key in keys} == {"0"}


@pytest.mark.parametrize("distro", [Distro.KILTED, Distro.LYRICAL])
async def test_later_distributions_have_the_same_topics(
    stack: Paced, peer: RosPeer, distro: Distro
) -> None:
    found = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
    async with presented(stack, peer.endpoint, distro=distro):
        await until(lambda: found)
