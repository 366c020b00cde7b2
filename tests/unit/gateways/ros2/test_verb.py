"""`run ros2`: its words, and what it refuses before it connects to a robot."""

import argparse
import builtins
import io
import json
from pathlib import Path
from typing import Any

import pytest

from gateways.ros2.node import domain_in, session_config
from gateways.ros2.ros2_verb import arguments, as_ros2, namespace_of, run
from ground.client.connection import Common
from ground.text.output import Output
from protocol.bus.network import Network
from runtime.errors import UserError
from tests.support.each import each


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    arguments(parser)
    return parser.parse_args([*words, "--connect", "tcp/127.0.0.1:1"])


def output() -> Output:
    return Output(as_json=False, out=io.StringIO(), err=io.StringIO())


@each(
    "robot, given, namespace",
    [("r1", None, "/r1"), ("r-1", None, "/r_1"), ("r1", "", ""), ("r1", "/a/b", "/a/b")],
)
def test_namespace_is_the_robot_or_what_is_given(
    robot: str, given: str | None, namespace: str
) -> None:
    assert namespace_of(robot, given) == namespace


@each("given", ["1st", "a-b", "a//b", "ä"])
def test_namespace_that_ros_refuses_is_refused(given: str) -> None:
    with pytest.raises(UserError, match="--namespace"):
        namespace_of("r1", given)


@each(
    "words, why",
    [
        (("--distro", "humble"), "Humble is not supported"),
        (("--distro", "foxy"), "use one of jazzy"),
        (("--robots", "r1,r2", "--namespace", "a"), "is for one robot"),
        (("--robots", "r1,r1"), "a name of its own"),
        (("--domain", "300"), "from 0 to 232"),
        (("--router", "tcp"), "the settings of the ROS 2 network"),
    ],
)
def test_wrong_words_are_refused_before_a_connection(words: tuple[str, ...], why: str) -> None:
    with pytest.raises(UserError, match=why):
        run(parsed(*words), output())


def test_missing_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    real_import = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("gateways.ros2") or (rest[1:3] and "gateways.ros2" in str(rest[2])):
            raise ModuleNotFoundError(name, name="rosbags")
        return real_import(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match=r"needs rosbags.*pip install 'sidestep\[ros2\]'"):
        run(parsed(), output())


def test_gateway_is_a_person_of_its_own_on_an_open_bus() -> None:
    common = as_ros2(Common(network=Network(), robot="r1"))
    assert common.network.person.startswith("ros2-")


def test_environment_of_ros_users_sets_the_session(tmp_path: Path) -> None:
    plain = session_config({}, None)
    assert json.loads(plain.get_json("connect/endpoints")) == ["tcp/localhost:7447"]
    assert json.loads(plain.get_json("mode")) == "client"
    override = 'connect/endpoints=["tcp/10.0.0.1:7448"];mode="peer"'
    found = session_config({"ZENOH_CONFIG_OVERRIDE": override}, None)
    assert json.loads(found.get_json("connect/endpoints")) == ["tcp/10.0.0.1:7448"]
    assert json.loads(found.get_json("mode")) == "client"
    file = tmp_path / "session.json5"
    file.write_text('{mode: "peer", connect: {endpoints: ["tcp/10.0.0.2:7447"]}}')
    found = session_config({"ZENOH_SESSION_CONFIG_URI": str(file)}, None)
    assert json.loads(found.get_json("connect/endpoints")) == ["tcp/10.0.0.2:7447"]
    named = session_config({"ZENOH_SESSION_CONFIG_URI": str(file)}, "tcp/10.0.0.3:1")
    assert json.loads(named.get_json("connect/endpoints")) == ["tcp/10.0.0.3:1"]


@each("environment", [{"ZENOH_SESSION_CONFIG_URI": "/no/such"}, {"ZENOH_CONFIG_OVERRIDE": "x=1"}])
def test_wrong_environment_is_refused(environment: dict[str, str]) -> None:
    with pytest.raises(UserError, match="the settings of the ROS 2 network"):
        session_config(environment, None)


def test_domain_is_that_of_the_environment() -> None:
    assert (domain_in({}), domain_in({"ROS_DOMAIN_ID": "42"})) == (0, 42)
    with pytest.raises(UserError, match="ROS_DOMAIN_ID 'x'"):
        domain_in({"ROS_DOMAIN_ID": "x"})
