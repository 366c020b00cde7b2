"""A robot as a ROS 2 node: a stack in this process, and a client on a Zenoh network of its own."""

import asyncio
import time
from collections.abc import Callable
from functools import partial
from io import StringIO
from math import inf, isinf, nan
from pathlib import Path
from random import Random
from typing import Any

import pytest
import zenoh

from checks.harness.in_process import ignore
from checks.harness.until import PATIENCE_S
from gateways.ros2.face import FaceSettings, RobotFace, present
from gateways.ros2.interfaces import Interfaces
from gateways.ros2.node import MAX_BYTES, RosSession, session_config
from gateways.ros2.parameters import value_of
from gateways.ros2.recorder import BagRecorder
from gateways.ros2.velocity import GAP_S
from gateways.ros2.wire import Distro, EntityKind, TokenParts, gid_of, read_token
from ground.client.connection import Common
from ground.client.robot_link import RobotLink
from ground.robot import Robot
from ground.ros2.offer import LATCHED
from ground.text.output import Output
from protocol.topics import ODOMETRY, TELEOP
from protocol.wire.enums import Mode, Vehicle
from tests.support.gateway.ros_network import (
    RosPeer,
    bus_of,
    free_endpoint,
    presented,
    seconds,
    until,
)
from tests.support.ros_bags import read_bag
from tests.support.stacks import Paced


async def test_topics_arrive_with_the_values_of_the_robot(stack: Paced, peer: RosPeer) -> None:
    odometry = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
    sonar = peer.listen("/r1/sonar_3", "sensor_msgs/msg/Range")
    joints = peer.listen("/r1/joint_states", "sensor_msgs/msg/JointState")
    moving = peer.listen("/r1/tf", "tf2_msgs/msg/TFMessage")
    clock = peer.listen("/clock", "rosgraph_msgs/msg/Clock")
    async with presented(stack, peer.endpoint) as face:
        await until(lambda: min(map(len, (odometry, sonar, joints, moving, clock))) > 3)
        poses = face.robot.stream(ODOMETRY)
        known = {pose.time_ns: pose for pose in [await anext(poses) for _ in range(3)]}
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
    expected = {"/r1/odom", "/r1/tf", "/r1/tf_static", "/r1/sonar_0", "/r1/scan", "/clock"}

    def shown() -> list[TokenParts]:
        return [one for one in map(read_token, peer.tokens()) if one]

    def topics() -> set[str]:
        return {one.topic for one in shown() if one.kind is EntityKind.PUBLISHER}

    async with presented(stack, peer.endpoint, scan=True):
        await until(lambda: expected <= topics())
        assert {one.node for one in shown()} == {"/r1/sidestep"}
    await until(lambda: not peer.tokens())


async def test_several_robots_are_presented_until_the_gateway_ends(
    stack: Paced, peer: RosPeer
) -> None:
    with bus_of(stack) as bus:
        link = RobotLink(bus, Common(network=bus.network, robot="r1"))
        session = RosSession(Interfaces(Distro.JAZZY), session_config({}, peer.endpoint))
        settings = {name: FaceSettings(namespace=f"/{name}") for name in ("r1", "r2")}
        running = asyncio.create_task(present(link, session, settings, lambda _: None))
        await until(partial(shows, peer, "%r2%emergency_stop/"))
        nodes = {parts.node for parts in map(read_token, peer.tokens()) if parts}
        assert nodes == {"/r1/sidestep", "/r2/sidestep"}
        assert (await peer.ask("/r1/arm", TRIGGER)).success
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        assert running.cancelled()
    await until(lambda: not peer.tokens())


async def test_robot_without_a_namespace_is_at_the_root(stack: Paced, peer: RosPeer) -> None:
    found = peer.listen("/odom", "nav_msgs/msg/Odometry")
    log = peer.listen("/rosout", "rcl_interfaces/msg/Log")
    async with presented(stack, peer.endpoint, namespace=""):
        await until(lambda: found and log)
        assert (await peer.ask("/emergency_stop", TRIGGER)).success
        nodes = {parts.node for parts in map(read_token, peer.tokens()) if parts}
    assert (nodes, log[0][0].name) == ({"/sidestep"}, "sidestep")


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
    async with presented(stack, peer.endpoint, distros=[distro]):
        await until(lambda: found)


TRIGGER = "std_srvs/srv/Trigger"
TWIST = "geometry_msgs/msg/Twist"
STAMPED = "geometry_msgs/msg/TwistStamped"


def twist(peer: RosPeer, speed_m_s: float, turn_rad_s: float = 0.0) -> Any:
    make = peer.interfaces.make
    vector = "geometry_msgs/msg/Vector3"
    return make(TWIST, make(vector, speed_m_s, 0.0, 0.0), make(vector, 0.0, 0.0, turn_rad_s))


def stamped(peer: RosPeer, speed_m_s: float, stamp_ns: int) -> Any:
    time_of = peer.interfaces.make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9))
    header = peer.interfaces.make("std_msgs/msg/Header", time_of, "")
    return peer.interfaces.make(STAMPED, header, twist(peer, speed_m_s))


def is_in(stack: Paced, state: Vehicle) -> bool:
    return stack.state == state


async def ready(face: RobotFace) -> None:
    await until(lambda: face.is_ready() and face.limits[0] > 0, "telemetry and parameters")


async def send_until(condition: Callable[[], object], send: Callable[[], object]) -> None:
    """Send at 20 Hz until the condition holds."""

    def sent() -> object:
        send()
        return condition()

    async with asyncio.timeout(PATIENCE_S):
        while not sent():
            await asyncio.sleep(0.05)


async def test_services_have_success_or_the_reason(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        armed = await peer.ask("/r1/arm", TRIGGER)
        assert armed.success
        assert is_in(stack, Vehicle.ACTIVE)
        refused = await peer.ask("/r1/resume", TRIGGER)
        assert not refused.success
        assert "goal" in refused.message
        assert (await peer.ask("/r1/hold", TRIGGER)).success
        assert (await peer.ask("/r1/disarm", TRIGGER)).success
        assert is_in(stack, Vehicle.STANDBY)


async def test_emergency_stop_latches_until_it_is_cleared(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await peer.ask("/r1/arm", TRIGGER)
        for answer in await asyncio.gather(
            *(peer.ask("/r1/emergency_stop", TRIGGER) for _ in range(3))
        ):
            assert answer.success, answer.message
        assert is_in(stack, Vehicle.EMERGENCY_STOP)
        refused = await peer.ask("/r1/arm", TRIGGER)
        assert (refused.success, "emergency stop" in refused.message) == (False, True)
        await send_until(
            lambda: "emergency stop" in face.velocity.refusal,
            lambda: peer.put("/r1/cmd_vel", TWIST, twist(peer, 0.2)),
        )
        assert stack.truth.speed_m_s == 0.0
        assert (await peer.ask("/r1/clear", TRIGGER)).success
        assert is_in(stack, Vehicle.STANDBY)


async def test_read_only_serves_the_emergency_stop_alone(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint, read_only=True) as face:
        await until(face.is_ready)
        await until(partial(shows, peer, "%r1%emergency_stop/"))
        tokens = peer.tokens()
        assert not any(
            word in token for token in tokens for word in ("cmd_vel", "%arm/", "_action")
        )
        assert (await peer.ask("/r1/emergency_stop", TRIGGER)).success
        assert stack.state == Vehicle.EMERGENCY_STOP
        (result,) = await set_parameters(peer, v_max_m_s=0.2)
        assert (result.successful, "read-only" in result.reason) == (False, True)


async def test_twist_drives_and_its_end_stops_the_robot(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        peer.put("/r1/cmd_vel", TWIST, twist(peer, 0.0))  # begins nothing
        await send_until(
            lambda: stack.truth.speed_m_s > 0.15,
            lambda: peer.put("/r1/cmd_vel", TWIST, twist(peer, 0.2)),
        )
        assert stack.status.mode == Mode.MANUAL
        sent_s = asyncio.get_running_loop().time()
        await until(lambda: not face.velocity.is_driving)
        assert asyncio.get_running_loop().time() - sent_s >= 0.4
        await until(lambda: stack.truth.speed_m_s == 0.0 and stack.status.mode == Mode.HOLD)


async def test_flood_of_commands_sends_the_robot_no_more_than_its_rate(
    stack: Paced, peer: RosPeer
) -> None:
    arrived: list[float] = []
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        with bus_of(stack, "observer") as bus:
            clock = asyncio.get_running_loop().time
            bus.stream(TELEOP, lambda *_: arrived.append(clock()), "r1")
            await send_until(
                lambda: arrived, lambda: peer.put("/r1/cmd_vel", TWIST, twist(peer, 0.1))
            )
            began_s, before = clock(), len(arrived)
            for number in range(2000):
                peer.put("/r1/cmd_vel", TWIST, twist(peer, 0.1 + number / 1e5))
                if number % 10 == 0:
                    await asyncio.sleep(0)
            await until(lambda: face.velocity._speeds[0] > 0.1199)
            most = (clock() - began_s) / GAP_S + 2
    assert len(arrived) - before <= most


async def test_stamped_twist_drives_unless_its_stamp_is_old(stack: Paced, peer: RosPeer) -> None:
    log = peer.listen("/rosout", "rcl_interfaces/msg/Log")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await until(partial(shows, peer, "cmd_vel/geometry_msgs::msg::dds_::TwistStamped"))
        old_ns = time.time_ns() - 2 * 10**9
        await send_until(
            lambda: [one for one, _ in log if "its stamp" in one.msg],
            lambda: peer.put("/r1/cmd_vel", STAMPED, stamped(peer, 0.2, old_ns)),
        )
        assert not face.velocity.is_driving
        await send_until(
            lambda: stack.truth.speed_m_s > 0.1,
            lambda: peer.put("/r1/cmd_vel", STAMPED, stamped(peer, 0.2, time.time_ns())),
        )


async def test_commands_that_are_no_numbers_are_refused_and_logged_once(
    stack: Paced, peer: RosPeer
) -> None:
    log = peer.listen("/rosout", "rcl_interfaces/msg/Log")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        for value in (nan, inf, -inf, nan):
            peer.put("/r1/cmd_vel", TWIST, twist(peer, value))
        await send_until(
            lambda: any("too fast" in one.msg for one, _ in log),
            lambda: peer.put("/r1/cmd_vel", TWIST, twist(peer, 1e9, -1e9)),
        )
        assert face.velocity._speeds == (face.limits[0], -face.limits[1])
    assert [one.msg for one, _ in log if "not a number" in one.msg] == [
        "cmd_vel: refused, a value is not a number"
    ]


async def test_second_source_of_commands_is_ignored_and_told(stack: Paced, peer: RosPeer) -> None:
    told = peer.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        gids = [bytes(16), bytes([7] * 16)]

        def send() -> None:
            for speed_m_s, peer.gid in zip((0.1, -0.2), gids, strict=True):
                peer.put("/r1/cmd_vel", TWIST, twist(peer, speed_m_s))

        await send_until(
            lambda: [
                one
                for message, _ in told
                for one in message.status
                if "two nodes publish it" in one.message
            ],
            send,
        )
        assert face.velocity._speeds == (0.1, 0.0)


async def test_loser_of_the_lease_is_told(stack: Paced, peer: RosPeer) -> None:
    with bus_of(stack, "anna") as bus:
        anna = Robot(bus, Common(network=bus.network, robot="r1"), "anna")
        await anna.open()
        assert (await anna.arm()).ok
        async with presented(stack, peer.endpoint) as face:
            await ready(face)
            await send_until(
                lambda: face.velocity.refusal,
                lambda: peer.put("/r1/cmd_vel", TWIST, twist(peer, 0.2)),
            )
            assert "anna" in face.velocity.refusal
            assert stack.truth.speed_m_s == 0.0
            answer = await peer.ask("/r1/arm", TRIGGER)
            assert "anna" in answer.message
        await anna.close()


PARAMETER = "rcl_interfaces/msg/Parameter"


def parameter(peer: RosPeer, name: str, value: float | int | bool) -> Any:
    kinds: dict[type, tuple[int, str]] = {
        bool: (1, "bool_value"),
        int: (2, "integer_value"),
        float: (3, "double_value"),
    }
    kind, field = kinds[type(value)]
    made = value_of(kind)
    setattr(made, field, value)
    return peer.interfaces.make(PARAMETER, name, made)


async def set_parameters(peer: RosPeer, **values: float | int | bool) -> Any:
    name = "rcl_interfaces/srv/SetParameters"
    asked = [parameter(peer, key, value) for key, value in values.items()]
    request = peer.interfaces.make(f"{name}_Request", asked)
    return (await peer.ask("/r1/sidestep/set_parameters", name, request)).results


async def test_six_parameter_services_answer(stack: Paced, peer: RosPeer) -> None:
    names, service = ["v_max_m_s", "side", "use_sim_time", "none"], "rcl_interfaces/srv/{}"

    async def asked(path: str, kind: str, *values: Any) -> Any:
        name = service.format(kind)
        request = peer.interfaces.make(f"{name}_Request", *values)
        return await peer.ask(f"/r1/sidestep/{path}", name, request)

    events = peer.listen("/parameter_events", "rcl_interfaces/msg/ParameterEvent")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        listed = (await asked("list_parameters", "ListParameters", [], 0)).result.names
        assert {"v_max_m_s", "use_sim_time"} < set(listed)
        values = (await asked("get_parameters", "GetParameters", names)).values
        assert [value.type for value in values] == [3, 2, 1, 0]
        assert (values[0].double_value, values[2].bool_value) == (face.limits[0], True)
        types = (await asked("get_parameter_types", "GetParameterTypes", names)).types
        assert list(types) == [3, 2, 1, 0]
        speed, side, *_ = (
            await asked("describe_parameters", "DescribeParameters", names)
        ).descriptors
        (limits,) = speed.floating_point_range
        assert (limits.from_value, limits.to_value) == (0.01, 3.0)
        assert side.integer_range[0].step == 1
        good, unknown, wrong, high = await set_parameters(
            peer, v_max_m_s=0.25, none=1.0, side=True, yaw_max_rad_s=1e3
        )
        assert good.successful, good.reason
        assert [one.successful for one in (unknown, wrong, high)] == [False] * 3
        assert [
            why in one.reason
            for why, one in (("no parameter", unknown), ("integer", wrong), ("at most", high))
        ] == [True] * 3
        await until(lambda: any(one.changed_parameters for one, _ in events))
    (changed,) = [one for one, _ in events if one.changed_parameters]
    assert (changed.node, changed.changed_parameters[0].name) == ("/r1/sidestep", "v_max_m_s")


async def test_parameters_are_set_all_or_none(stack: Paced, peer: RosPeer) -> None:
    name = "rcl_interfaces/srv/SetParametersAtomically"

    async def set_all(**values: float) -> Any:
        asked = [parameter(peer, key, value) for key, value in values.items()]
        request = peer.interfaces.make(f"{name}_Request", asked)
        path = "/r1/sidestep/set_parameters_atomically"
        return (await peer.ask(path, name, request)).result

    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        before = await face.robot.parameters.get("v_max_m_s")
        await peer.ask("/r1/arm", TRIGGER)
        # The robot itself refuses the second one: a safety parameter, while it is armed.
        refused = await set_all(v_max_m_s=0.2, wheel_max_m_s=0.4)
        assert not refused.successful
        assert (await face.robot.parameters.get("v_max_m_s")).value == before.value
        assert not (await set_all(v_max_m_s=0.2, none=1.0)).successful
        assert (await set_all(v_max_m_s=0.2, yaw_max_rad_s=1.0)).successful
        assert (await face.robot.parameters.get("v_max_m_s")).value == pytest.approx(0.2)


async def test_lifecycle_of_the_navigator_is_active(stack: Paced, peer: RosPeer) -> None:
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        name = "lifecycle_msgs/srv/GetState"
        state = (await peer.ask("/r1/bt_navigator/get_state", name)).current_state
    assert (state.id, state.label) == (3, "active")


async def test_texts_of_the_robot_are_logged(stack: Paced, peer: RosPeer) -> None:
    log = peer.listen("/rosout", "rcl_interfaces/msg/Log")
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await peer.ask("/r1/emergency_stop", TRIGGER)
        await until(lambda: any("stop" in one.msg.lower() for one, _ in log))
    assert {one.name for one, _ in log} == {"r1.sidestep"}


async def test_false_frames_are_dropped_and_counted(stack: Paced, peer: RosPeer) -> None:
    key, whole = peer.key("/r1/cmd_vel", TWIST), peer.interfaces.encode(TWIST, twist(peer, 0.2))
    stop = peer.key("/r1/emergency_stop", TRIGGER)
    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await until(partial(shows, peer, "%r1%emergency_stop/"))
        beside = peer.attachment()
        for data, attachment in (
            (whole, None),
            (whole, beside[:-1]),
            (whole, b"\0" * 33),
            (whole[:20], beside),
            (b"", beside),
            (whole + bytes(MAX_BYTES), beside),
        ):
            peer.session.put(
                key, data, attachment=attachment, congestion_control=zenoh.CongestionControl.BLOCK
            )
        await until(lambda: face.node.session.rejected == 6)

        def ask(data: bytes, attachment: bytes | None) -> list[Any]:
            found = peer.session.get(stop, payload=data, attachment=attachment, timeout=PATIENCE_S)
            return [one.err.payload.to_string() for one in found]

        assert await asyncio.to_thread(ask, b"\0\1\0\0\0", None) == []
        assert await asyncio.to_thread(ask, b"\7", beside) == ["the request is malformed"]
        assert stack.state != Vehicle.EMERGENCY_STOP
        assert not face.velocity.is_driving


async def test_humble_and_a_second_gateway_are_told(stack: Paced, peer: RosPeer) -> None:
    notes: list[str] = []
    humble = "geometry_msgs::msg::dds_::Twist_/TypeHashNotSupported/::,10:,:,:,,"
    parts = ["0/1/MP/%/%/old/%chatter/" + humble, "1/1/NN/%/%r1/sidestep"]
    tokens = [
        peer.session.liveliness().declare_token(f"@ros2_lv/0/{peer.session.zid()}/{part}")
        for part in parts
    ]
    async with presented(stack, peer.endpoint, note=notes.append):
        await until(lambda: len([one for one in notes if "r1: " in one]) == 2, str(notes))
    assert any("/old is a node of Humble" in note for note in notes)
    assert any("another process presents /r1/sidestep" in note for note in notes)
    assert tokens


SUBSCRIBED = (
    ("/r1/cmd_vel", TWIST),
    ("/r1/cmd_vel", STAMPED),
    ("/r1/goal_pose", "geometry_msgs/msg/PoseStamped"),
    ("/r1/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
)
SERVED = (
    ("/r1/arm", TRIGGER),
    ("/r1/sidestep/set_parameters", "rcl_interfaces/srv/SetParameters"),
    ("/r1/sidestep/describe_parameters", "rcl_interfaces/srv/DescribeParameters"),
    ("/r1/navigate_to_pose/_action/send_goal", "nav2_msgs/action/NavigateToPose_SendGoal"),
    ("/r1/navigate_to_pose/_action/cancel_goal", "action_msgs/srv/CancelGoal"),
)


async def test_fuzzed_frames_and_tokens_end_nothing(stack: Paced, peer: RosPeer) -> None:
    draw = Random(40)

    def payload(header: bytes) -> bytes:
        return header + draw.randbytes(draw.randrange(120))

    def attachment() -> bytes | None:
        if draw.random() < 0.5:
            return peer.attachment()
        return draw.choice([None, b"", draw.randbytes(33)])

    async with presented(stack, peer.endpoint) as face:
        await ready(face)
        await until(partial(shows, peer, "%r1%navigate_to_pose%_action%cancel_goal/"))
        shown = []
        for _ in range(60):
            header = draw.choice([b"\0\1\0\0", b"\0\0\0\0", b""])
            for name, type_name in SUBSCRIBED:
                key = peer.key(name, type_name)
                peer.session.put(key, payload(header), attachment=attachment())
            for name, type_name in SERVED:
                if type_name != TRIGGER or header != b"\0\1\0\0":  # which may be a good one
                    key = peer.key(name, type_name)
                    asked = payload(header)
                    peer.session.get(key, ignore, payload=asked, attachment=attachment(), timeout=1)
            words = ["".join(draw.choices("%:,NS0é", k=4)) for _ in range(draw.choice([6, 10]))]
            token = "/".join(("@ros2_lv/0", *words))
            shown.append(peer.session.liveliness().declare_token(token))
            await asyncio.sleep(0)
        assert (await peer.ask("/r1/emergency_stop", TRIGGER)).success
        assert face.is_ready()
        assert face.node.session.rejected > 100
    assert stack.truth.speed_m_s == 0.0


async def test_what_is_published_is_recorded_and_hidden_topics_are_not(
    stack: Paced, peer: RosPeer, tmp_path: Path
) -> None:
    seen = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
    both = (Distro.JAZZY, Distro.LYRICAL)
    output = Output(as_json=False, out=StringIO(), err=StringIO())
    with BagRecorder(tmp_path, None, output) as recorder:
        async with presented(stack, peer.endpoint, distros=both, record=recorder.take):
            await until(lambda: len(seen) > 5)
    (folder,) = tmp_path.iterdir()
    found = read_bag(folder)
    stamps = {ns_of(one.message.header.stamp) for one in found if one.topic == "/r1/odom"}
    assert {ns_of(message.header.stamp) for message, _ in seen} <= stamps
    names = {one.topic for one in found}
    assert {"/r1/tf", "/r1/sonar_0", "/r1/joint_states", "/clock", "/rosout"} <= names
    assert not any("/_" in name for name in names)
