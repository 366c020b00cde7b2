"""Goals of ROS 2: NavigateToPose, FollowWaypoints and /goal_pose, with a stack in this process."""

import asyncio
import uuid
from functools import partial
from math import nan
from typing import Any

import numpy as np
import pytest

from gateways.ros2.actions import ANY
from gateways.ros2.face import RobotFace
from gateways.ros2.navigation import FOLLOW, NAVIGATE
from gateways.ros2.node import MAX_QUERIES, TOO_MANY
from gateways.ros2.wire import Attachment, Distro
from protocol.wire.enums import GoalState
from tests.support.gateway.ros_network import RosPeer, free_endpoint, presented, until
from tests.support.stacks import Paced

CANCEL = "action_msgs/srv/CancelGoal"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


async def ready(face: RobotFace) -> None:
    await until(lambda: face.is_ready() and face.limits[0] > 0, "telemetry and parameters")


def pose(peer: RosPeer, x_m: float, y_m: float, frame: str = "map") -> Any:
    make = peer.interfaces.make
    header = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 0, 0), frame)
    where = make("geometry_msgs/msg/Point", x_m, y_m, 0.0)
    rotation = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 0.0)
    inner = make("geometry_msgs/msg/Pose", where, rotation)
    return make("geometry_msgs/msg/PoseStamped", header, inner)


class ActionClient:
    """A client of one action of /r1."""

    def __init__(self, peer: RosPeer, name: str, type_name: str) -> None:
        self.peer, self.type = peer, type_name
        self.name = f"/r1/{name}/_action"
        self.feedback = peer.listen(f"{self.name}/feedback", f"{type_name}_FeedbackMessage")

    async def send(self, *fields: Any, goal_id: bytes = b"") -> bytes | None:
        """Return the id of the goal; None if it was not accepted."""
        make, number = self.peer.interfaces.make, goal_id or uuid.uuid4().bytes
        goal = make(f"{self.type}_Goal", *fields)
        request = make(f"{self.type}_SendGoal_Request", self._id(number), goal)
        answer = await self.peer.ask(f"{self.name}/send_goal", f"{self.type}_SendGoal", request)
        return number if answer.accepted else None

    async def result(self, goal_id: bytes | None) -> Any:
        assert goal_id is not None, "the goal was refused"
        make, name = self.peer.interfaces.make, f"{self.type}_GetResult"
        return await self.peer.ask(
            f"{self.name}/get_result", name, make(f"{name}_Request", self._id(goal_id))
        )

    async def cancel(self, goal_id: bytes, stamp: tuple[int, int] = (0, 0)) -> Any:
        make = self.peer.interfaces.make
        time = make("builtin_interfaces/msg/Time", *stamp)
        info = make("action_msgs/msg/GoalInfo", self._id(goal_id), time)
        request = make(f"{CANCEL}_Request", info)
        return await self.peer.ask(f"{self.name}/cancel_goal", CANCEL, request)

    def _id(self, number: bytes) -> Any:
        return self.peer.interfaces.make(
            "unique_identifier_msgs/msg/UUID", np.frombuffer(number, np.uint8)
        )


def navigator(peer: RosPeer) -> ActionClient:
    return ActionClient(peer, "navigate_to_pose", NAVIGATE)


def near(stack: Paced, forward_m: float = 0.3) -> tuple[float, float]:
    return stack.world.start.x_m + forward_m, stack.world.start.y_m


FAR_M = 4.0
BASE = "base_link"


def moves(stack: Paced) -> bool:
    return abs(stack.truth.speed_m_s) > 0.05


async def test_goal_is_reached_with_feedback_on_the_way(stack: Paced, peer: RosPeer) -> None:
    client = navigator(peer)
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        goal_id = await client.send(pose(peer, *near(stack)), "")
        found = await client.result(goal_id)
        late = await client.result(goal_id)
    assert (found.status, found.result.error_code, found.result.error_msg) == (SUCCEEDED, 0, "")
    assert late.status == SUCCEEDED
    assert stack.goal_state == GoalState.REACHED
    distances = [message.feedback.distance_remaining for message, _ in client.feedback]
    assert distances
    assert max(distances) < 0.4
    assert {bytes(message.goal_id.uuid) for message, _ in client.feedback} == {goal_id}


async def test_cancelled_goal_ends_with_a_standing_robot(stack: Paced, peer: RosPeer) -> None:
    client = navigator(peer)
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        goal_id = await client.send(pose(peer, *near(stack, FAR_M)), "")
        assert goal_id is not None
        await until(lambda: moves(stack))
        assert (await client.cancel(uuid.uuid4().bytes)).return_code == 2
        answer = await client.cancel(goal_id)
        assert [bytes(one.goal_id.uuid) for one in answer.goals_canceling] == [goal_id]
        assert (await client.result(goal_id)).status == CANCELED
        assert not moves(stack)
        assert (await client.cancel(goal_id)).return_code == 3


@pytest.mark.parametrize("stamp", [(0, 0), (2**31 - 1, 0)])
async def test_all_goals_are_cancelled_at_once(
    stack: Paced, peer: RosPeer, stamp: tuple[int, int]
) -> None:
    client = navigator(peer)
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        goal_id = await client.send(pose(peer, *near(stack, FAR_M)), "")
        await until(lambda: moves(stack))
        answer = await client.cancel(ANY, stamp)
        assert (answer.return_code, len(answer.goals_canceling)) == (0, 1)
        assert (await client.result(goal_id)).status == CANCELED


async def test_new_goal_aborts_the_old_one(stack: Paced, peer: RosPeer) -> None:
    client = navigator(peer)
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        old = await client.send(pose(peer, *near(stack, FAR_M)), "")
        await until(lambda: moves(stack))
        new = await client.send(pose(peer, *near(stack)), "")
        ended = await client.result(old)
        assert (ended.status, "replaced" in ended.result.error_msg) == (ABORTED, True)
        assert (await client.result(new)).status == SUCCEEDED


async def test_goal_of_a_client_that_vanishes_is_cancelled(stack: Paced, peer: RosPeer) -> None:
    client = navigator(peer)
    token = peer.show_client(f"{client.name}/send_goal", f"{NAVIGATE}_SendGoal")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await until(lambda: peer.gid in face.graph.entities)
        goal_id = await client.send(pose(peer, *near(stack, FAR_M)), "")
        await until(lambda: moves(stack))
        token.undeclare()
        assert (await client.result(goal_id)).status == CANCELED
        assert not moves(stack)


async def test_emergency_stop_aborts_a_goal_with_its_reason(stack: Paced, peer: RosPeer) -> None:
    client = navigator(peer)
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        goal_id = await client.send(pose(peer, *near(stack, FAR_M)), "")
        await until(lambda: moves(stack))
        assert (await peer.ask("/r1/emergency_stop", "std_srvs/srv/Trigger")).success
        ended = await client.result(goal_id)
        assert (ended.status, ended.result.error_code) == (ABORTED, 9000)
        assert "emergency stop" in ended.result.error_msg
        again = await client.result(await client.send(pose(peer, *near(stack)), ""))
        assert (again.status, "emergency stop" in again.result.error_msg) == (ABORTED, True)


async def test_goals_that_cannot_be_are_not_accepted(stack: Paced, peer: RosPeer) -> None:
    client, log = navigator(peer), peer.listen("/rosout", "rcl_interfaces/msg/Log")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        assert await client.send(pose(peer, nan, 0.0), "") is None
        assert await client.send(pose(peer, 1.0, 1.0, "camera"), "") is None
        assert await client.send(pose(peer, 1e9, 1.0), "") is None
        assert await client.send(pose(peer, 1.0, 1.0), "", goal_id=ANY) is None
        await until(lambda: any("frame 'camera'" in one.msg for one, _ in log))
        assert (await client.result(uuid.uuid4().bytes)).status == 0
    assert stack.goal_state == GoalState.NONE


async def test_same_goal_sent_twice_is_driven_once(stack: Paced, peer: RosPeer) -> None:
    client = navigator(peer)
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        goal_id = await client.send(pose(peer, *near(stack)), "")
        assert goal_id is not None
        assert await client.send(pose(peer, *near(stack)), "", goal_id=goal_id) is None


@pytest.mark.parametrize("distro", Distro)
async def test_waypoints_are_followed_and_a_missed_one_listed(stack: Paced, distro: Distro) -> None:
    peer = RosPeer(free_endpoint(), distro=distro)
    client = ActionClient(peer, "follow_waypoints", FOLLOW)
    async with presented(stack, peer.endpoint, distros=list(Distro)) as face:
        await ready(face)
        places = [near(stack), (1e5, 0.0), near(stack, 0.6)]
        poses = [pose(peer, *place) for place in places]
        found = await client.result(await client.send(0, 0, poses))
        assert (found.status, found.result.error_code) == (SUCCEEDED, 0)
        (missed,) = found.result.missed_waypoints
        index = missed.index if distro is Distro.JAZZY else missed.waypoint_index
        assert index == 1
        assert await client.send(0, 3, poses) is None
        driving = navigator(peer)
        ended = await driving.result(await driving.send(pose(peer, *near(stack, 0.2)), ""))
        assert ended.status == SUCCEEDED
        assert driving.feedback
    assert [one.feedback.current_waypoint for one, _ in client.feedback] == [0, 1, 2]
    peer.close()


async def test_goal_pose_drives_as_the_action_does(stack: Paced, peer: RosPeer) -> None:
    log = peer.listen("/rosout", "rcl_interfaces/msg/Log")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await until(partial(shows, peer, "%r1%goal_pose/"))
        peer.put("/r1/goal_pose", "geometry_msgs/msg/PoseStamped", pose(peer, 0.2, 0.0, BASE))
        await until(lambda: any(one.msg == "goal_pose: done" for one, _ in log))
    assert stack.goal_state == GoalState.REACHED


def shows(peer: RosPeer, part: str) -> bool:
    return any(part in token for token in peer.tokens())


async def test_initial_pose_sets_the_pose(stack: Paced, peer: RosPeer) -> None:
    make, name = peer.interfaces.make, "geometry_msgs/msg/PoseWithCovarianceStamped"
    inner = pose(peer, 1.5, 2.5)
    inner.pose.orientation.w = 1.0
    covered = make("geometry_msgs/msg/PoseWithCovariance", inner.pose, np.zeros(36))
    odometry = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await until(partial(shows, peer, "%r1%initialpose/"))
        peer.put("/r1/initialpose", name, make(name, inner.header, covered))
        there = pytest.approx(1.5, abs=1e-3)
        await until(lambda: odometry and odometry[-1][0].pose.pose.position.x == there)


async def test_goal_that_is_cancelled_before_it_began_ends(stack: Paced, peer: RosPeer) -> None:
    make, number = peer.interfaces.make, uuid.uuid4().bytes
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        assert face.navigation is not None
        server = face.navigation.navigate
        goal = make(f"{NAVIGATE}_Goal", pose(peer, *near(stack, FAR_M)), "")
        request = make(f"{NAVIGATE}_SendGoal_Request", navigator(peer)._id(number), goal)
        assert (await server._send_goal(request, Attachment(1, 0, bytes(16)))).accepted
        server.goals[number].cancel()
        assert (await navigator(peer).result(number)).status == CANCELED
        assert not server.running


async def test_goals_leave_nothing_behind(stack: Paced, peer: RosPeer) -> None:
    client = navigator(peer)

    async def one(number: int) -> int:
        goal_id = await client.send(pose(peer, *near(stack, FAR_M)), "")
        assert goal_id is not None
        if number % 2:
            await client.cancel(goal_id)
        return int((await client.result(goal_id)).status)

    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        assert face.navigation is not None
        ends = asyncio.gather(*map(one, range(20)))
        while not (await asyncio.wait({ends}, timeout=0.2))[0]:
            await client.cancel(ANY)  # the last one would drive on
        assert set(ends.result()) <= {CANCELED, ABORTED}
        server = face.navigation.navigate
        assert not server.running
        assert len(server.goals) == 20
    assert not moves(stack)


async def test_too_many_requests_are_refused_and_later_ones_answered(
    stack: Paced, peer: RosPeer
) -> None:
    client, name = navigator(peer), f"{NAVIGATE}_GetResult"
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        goal_id = await client.send(pose(peer, *near(stack, FAR_M)), "")
        assert goal_id is not None
        request = peer.interfaces.make(f"{name}_Request", client._id(goal_id))
        data = peer.interfaces.encode(f"{name}_Request", request)
        key, found = peer.key(f"{client.name}/get_result", name), list[Any]()
        for _ in range(MAX_QUERIES + 6):
            beside = peer.attachment()
            peer.session.get(key, found.append, payload=data, attachment=beside, timeout=60.0)
        await until(lambda: len(found) == 6)
        assert {one.err.payload.to_string() for one in found} == {TOO_MANY}
        await client.cancel(goal_id)
        await until(lambda: len(found) == MAX_QUERIES + 6)
        assert (await client.result(goal_id)).status == CANCELED
