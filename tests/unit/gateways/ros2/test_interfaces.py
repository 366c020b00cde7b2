"""Definitions and CDR of the types: their hashes, and messages that real nodes have sent."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateways.ros2.interfaces import Interfaces, actions_of, definitions
from gateways.ros2.wire import Distro, hash_of
from tests.support.each import each
from tests.support.gateway.ros_messages import TYPES, as_text, fields_of, kept
from tests.unit.gateways.ros2.test_wire import CAPTURES

ONLY_IN_JAZZY = "nav2_msgs/msg/MissedWaypoint"
SINCE_KILTED = "nav2_msgs/msg/WaypointStatus"
SAMPLES = json.loads((CAPTURES / "capture_face_peer_mode.json").read_text())["samples"]
JAZZY = Interfaces(Distro.JAZZY)
SENT = (
    *("nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Range"),
    *("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/JointState", "std_msgs/msg/String"),
    *("rosgraph_msgs/msg/Clock", "diagnostic_msgs/msg/DiagnosticArray", "rcl_interfaces/msg/Log"),
    *("nav_msgs/msg/Path", "visualization_msgs/msg/MarkerArray"),
    *("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"),
    *("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"),
    *("rcl_interfaces/msg/ParameterEvent", "action_msgs/msg/GoalStatusArray"),
)


@pytest.mark.parametrize("distro", Distro)
def test_definitions_have_the_hashes_of_the_distribution(distro: Distro) -> None:
    interfaces = Interfaces(distro)
    foreign = SINCE_KILTED if distro is Distro.JAZZY else ONLY_IN_JAZZY
    names = {name for name, _ in definitions(distro)} - {foreign}
    for name in (*sorted(names), *SENT):
        assert interfaces.hash_in_words(name) == hash_of(name, distro), name
    for name in actions_of(distro):
        assert hash_of(f"{name}_SendGoal", distro) != hash_of(f"{name}_GetResult", distro)


@each("key, sample", list(SAMPLES.items()))
def test_messages_of_real_nodes_are_read(key: str, sample: dict[str, Any]) -> None:
    package, kind, _, base = key.split("/")[-2].split("::")
    name, data = f"{package}/{kind}/{base[:-1]}", bytes.fromhex(sample["payload"])
    message = JAZZY.decode(name, data)
    assert message is not None
    assert str(JAZZY.decode(name, JAZZY.encode(name, message))) == str(message)


def test_captured_odometry_has_its_fields() -> None:
    (data,) = [one["payload"] for key, one in SAMPLES.items() if "Odometry" in key]
    found = JAZZY.decode("nav_msgs/msg/Odometry", bytes.fromhex(data))
    assert (found.header.frame_id, found.child_frame_id) == ("odom", "base_link")
    assert (found.pose.pose.position.y, found.twist.twist.linear.x) == (0.2, 0.3)


@each("padding", [b"\0", b"\0\0\0\0", b"\x07\x00\xff\x01"])
def test_request_without_fields_is_read_with_any_padding(padding: bytes) -> None:
    assert JAZZY.decode("std_srvs/srv/Trigger_Request", b"\0\1\0\0" + padding) is not None


def test_request_without_fields_is_written_as_real_nodes_do() -> None:
    request = JAZZY.make("std_srvs/srv/Trigger_Request", 0)
    assert JAZZY.encode("std_srvs/srv/Trigger_Request", request) == b"\0\1\0\0\0"


NAMES = sorted({*SENT, *(name for name, _ in definitions(Distro.JAZZY))})


@given(st.sampled_from(NAMES), st.binary(max_size=300))
def test_any_bytes_are_a_message_or_none(name: str, data: bytes) -> None:
    for payload in (data, b"\0\1\0\0" + data):
        found = JAZZY.decode(name, payload)
        assert found is None or JAZZY.encode(name, found)


@given(st.data())
def test_truncated_message_is_none(data: st.DataObject) -> None:
    (whole,) = [one["payload"] for key, one in SAMPLES.items() if "Odometry" in key]
    whole_bytes = bytes.fromhex(whole)
    length = data.draw(st.integers(0, len(whole_bytes) - 4))
    assert JAZZY.decode("nav_msgs/msg/Odometry", whole_bytes[:length]) is None


def test_messages_of_the_ros_wheels_are_read_field_by_field() -> None:
    found = kept()
    assert {one.type_name for one in found} == set(TYPES)
    for name, data, fields in found:
        message = JAZZY.decode(name, data)
        assert message is not None, name
        assert as_text(fields_of(JAZZY, name, message)) == as_text(fields), name
