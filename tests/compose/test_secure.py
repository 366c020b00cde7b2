"""Mutual TLS between containers: a client without a key, or with a wrong one, is refused."""

from collections.abc import Iterator
from math import nan

import pytest

from ground.gateway.dialect import mavlink
from protocol.wire.enums import Vehicle
from tests.support.compose.compose import Compose, docker, project
from tests.support.stack.mavlink_client import MavlinkClient, free_port
from tests.support.until import until

pytestmark = pytest.mark.compose

SERVICES = ("router", "plant", "robot", "web")
OPEN_DOOR = ("--connect", "tcp/router:7447")


@pytest.fixture(scope="module")
def locked(image: str) -> Iterator[Compose]:
    ports = {"MAVLINK_PORT": str(free_port()), "MAVLINK_TCP_PORT": "0"}
    with project(image, "secure", "mavlink", settings=ports) as compose:
        compose.up()
        yield compose


def test_a_script_commands_a_robot_behind_locked_doors(locked: Compose) -> None:
    assert "router at tls/" in locked.logs("router")
    done = locked.goes("1.0", "2.0")
    assert (done.code, done.object["outcome"]) == (0, "reached"), done.said


def test_mavlink_client_of_the_host_drives_a_robot(locked: Compose) -> None:
    client = MavlinkClient(int(locked.settings["MAVLINK_PORT"]))
    before = client.next("GLOBAL_POSITION_INT")
    change_mode = float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
    to_the_east = (-1.0, change_mode, 0.0, nan, before.lat, before.lon + 80, 0.0)  # 0.7 m

    def has_moved() -> bool:  # a busy machine may stop a robot: it drives on when armed again
        client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        client.link.mav.command_int_send(
            1, 1, frame, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, *to_the_east
        )
        return bool(client.next("GLOBAL_POSITION_INT").lon > before.lon + 20)

    until(has_moved)
    assert client.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0.0) == mavlink.MAV_RESULT_ACCEPTED
    client.link.close()
    keys = locked.inside("mavlink", "ls", "/keys").said.split()
    assert keys == ["bus.toml", "ca.pem", "gateway.key", "gateway.pem"]


def test_client_without_a_key_is_refused_with_a_reason(locked: Compose) -> None:
    words = ("run", "--rm", "--network", locked.network(), locked.image, "hold", *OPEN_DOOR)
    with pytest.raises(AssertionError, match="accepts only TLS, and this one uses plain TCP"):
        docker(*words)


def test_key_of_a_robot_cannot_command_others(locked: Compose) -> None:
    words = ("sidestep", "estop", "--config", "/keys/r1/bus.toml")
    done = locked.inside("robot", *words, user="20001")
    assert (done.code, "is the robot r1 and may not" in done.said) == (1, True), done.said
    seen = locked.verb("watch", "--json").object["streams"]["tlm/status"]["message"]
    assert seen["vehicle"] != Vehicle.EMERGENCY_STOP


def test_each_service_has_its_own_keys_and_no_others(locked: Compose) -> None:
    for service in SERVICES:
        locked.becomes("healthy", service)
    keys = {
        service: sorted(
            name
            for name in locked.inside(service, "ls", "/keys").said.split()
            if name.endswith(".key")
        )
        for service in SERVICES
    }
    assert keys.pop("robot") == []
    assert keys == {"router": ["router.key"], "plant": ["plant.key"], "web": ["ground.key"]}


def test_a_robot_can_read_its_own_keys_and_those_of_no_other(locked: Compose) -> None:
    own = locked.inside("robot", "ls", "/keys/r1", user="20001").said.split()
    assert own == ["bus.toml", "ca.pem", "robot-r1.key", "robot-r1.pem"]
    for number in range(2, 21):
        done = locked.inside("robot", "cat", f"/keys/r{number}/robot-r{number}.key", user="20001")
        assert (done.code, "Permission denied" in done.said) == (1, True), done.said
    assert locked.inside("robot", "ls", "/state/r1", user="20002").code != 0
    (key,) = (who for words, who in locked.users("robot").items() if "sidestep run robot" in words)
    assert key == "20001"


def test_no_key_is_in_a_log_an_environment_or_the_image(locked: Compose) -> None:
    for service in SERVICES:
        told = locked.inside(service, "env").said + str(locked.inspected(service)) + locked.logs()
        assert "PRIVATE KEY" not in told
    done = locked.inside("web", "find", "/", "-name", "*.key", "-not", "-path", "/proc/*")
    found = [line for line in done.said.splitlines() if line.endswith(".key")]
    assert found == ["/keys/ground.key"]


def test_once_locked_the_doors_stay_locked(locked: Compose) -> None:
    locked.profiles = ()
    locked.up("--force-recreate")
    assert "router at tls/" in locked.logs("router")
