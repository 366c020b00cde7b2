"""Names and bytes of rmw_zenoh, against what real nodes have put on the wire."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateways.ros2.wire import (
    Attachment,
    Distro,
    Endpoint,
    EntityKind,
    NodeName,
    distro_named,
    gid_of,
    hash_of,
    qos_text,
    read_attachment,
    read_token,
)
from ground.ros2.offer import LATCHED, PARAMETERS, RELIABLE, ROSOUT, SENSOR_DATA, Qos
from runtime.errors import UserError
from tests.support.each import each

CAPTURES = Path(__file__).parents[3] / "data" / "ros2"
PROFILES = (RELIABLE, SENSOR_DATA, LATCHED, PARAMETERS, ROSOUT)


def captured(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((CAPTURES / f"capture_{name}.json").read_text())
    return found


PEER = captured("face_peer_mode")
TOKENS = sorted({token for _, token in [*captured("rclpy_node")["tokens"], *PEER["tokens"]]})
SAMPLES = list(PEER["samples"].items())


@each("token", TOKENS)
def test_tokens_of_real_nodes_are_written_alike(token: str) -> None:
    parts, found = token.split("/"), read_token(token)
    assert found is not None
    namespace, _, name = found.node.rpartition("/")
    node = NodeName(namespace, name, int(parts[3]))
    if found.kind is EntityKind.NODE:
        assert node.token(0, found.zid) == token
        return
    package, kind, base = found.type_in_key.replace("dds_::", "").split("::")
    type_name = f"{package}/{kind}/{base[:-1]}"
    assert hash_of(type_name, Distro.JAZZY) == found.type_hash
    (qos,) = [profile for profile in PROFILES if qos_text(profile) == found.qos]
    endpoint = Endpoint(found.topic, type_name, found.type_hash)
    assert node.endpoint_token(0, found.zid, int(parts[4]), found.kind, endpoint, qos) == token


@each("key, sample", SAMPLES)
def test_samples_of_real_nodes_carry_the_hash_of_a_token(key: str, sample: dict[str, Any]) -> None:
    data = bytes.fromhex(sample["attachment"])
    found = read_attachment(data)
    assert found is not None
    assert found.packed() == data
    (token,) = [one for one in TOKENS if gid_of(one) == found.gid]
    parts = read_token(token)
    assert parts is not None
    package, kind, base = parts.type_in_key.replace("dds_::", "").split("::")
    endpoint = Endpoint(parts.topic, f"{package}/{kind}/{base[:-1]}", parts.type_hash)
    assert endpoint.key(0) == key


def test_attachment_has_the_order_of_little_endian() -> None:
    packed = Attachment(1, 2, bytes(range(16))).packed()
    assert packed.hex() == f"{'01':0<16}{'02':0<16}10{bytes(range(16)).hex()}"


@each("data", [None, b"", bytes(32), bytes(33), bytes(34), b"\x10" * 32])
def test_wrong_attachment_is_none(data: bytes | None) -> None:
    assert read_attachment(data) is None


@given(st.text(alphabet="@ros2_lv/%0SSNMP:,", max_size=80) | st.text(max_size=40))
def test_false_token_is_none_or_has_all_parts(token: str) -> None:
    found = read_token(token)
    assert found is None or isinstance(found.kind, EntityKind)


def test_lyrical_may_add_a_field_to_a_token() -> None:
    token = next(one for one in TOKENS if "/MP/" in one)
    assert read_token(f"{token}/zenoh") == read_token(token)
    assert read_token(f"{token}/zenoh/more") is None


def test_default_depth_is_an_empty_field() -> None:
    assert qos_text(Qos(depth=42)) == "::,:,:,:,,"


@each(
    "name, resolved",
    [("odom", "/r1/odom"), ("~/get_parameters", "/r1/sidestep/get_parameters"), ("/tf", "/tf")],
)
def test_names_are_resolved_below_the_namespace(name: str, resolved: str) -> None:
    assert NodeName("/r1", "sidestep").resolve(name) == resolved


def test_node_without_a_namespace_has_names_at_the_root() -> None:
    node = NodeName("", "sidestep")
    assert node.resolve("odom") == "/odom"
    assert node.token(0, "a") == "@ros2_lv/0/a/0/0/NN/%/%/sidestep"


def test_humble_is_refused_with_the_reason() -> None:
    with pytest.raises(UserError, match="no type hashes"):
        distro_named("Humble")
    with pytest.raises(UserError, match="use one of jazzy, kilted, lyrical"):
        distro_named("foxy")
    assert distro_named("kilted") is Distro.KILTED


def test_hashes_of_waypoints_differ_between_jazzy_and_kilted() -> None:
    name = "nav2_msgs/action/FollowWaypoints_GetResult"
    jazzy, kilted, lyrical = (hash_of(name, distro) for distro in Distro)
    assert jazzy != kilted == lyrical
