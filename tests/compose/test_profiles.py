"""Profiles: two robots behind mutual TLS, each with a recorder, and a MAVLink gateway.

One stack serves all tests of this file. A client without a key, or with a wrong one, is refused.
"""

import socket
from collections.abc import Iterator
from contextlib import suppress
from math import nan
from pathlib import Path
from typing import Final

import pytest

from checks.harness.mavlink_client import MavlinkClient, UdpLine
from checks.harness.processes import free_port
from checks.harness.until import until
from gateways.mavlink.mavlink_dialect import mavlink
from protocol.wire.enums import Vehicle
from tests.support.compose import LAST_WORDS, POLL_S, Compose, docker, project

pytestmark = pytest.mark.compose

SERVICES: Final = ("router", "plant", "robot", "web")
OPEN_DOOR: Final = ("--connect", "tcp/router:7447")
SOON_S: Final = 60.0
ARRIVE_S: Final = 180.0
DRIVE: Final = ("--profile", "fleet", "up", "-d", "--no-build", "--no-deps")
TWO_OF: Final = "--scale={}=2"


@pytest.fixture(scope="module")
def fleet(image: str) -> Iterator[Compose]:
    """Start two robots with a recorder each and a gateway, all with keys of their own."""
    settings = {"WORLD": "open", "MAVLINK_PORT": str(free_port(socket.SOCK_DGRAM))}
    with project(image, "secure", "mavlink", "record", settings=settings) as compose:
        compose.up(TWO_OF.format("robot"), TWO_OF.format("record"))
        yield compose


def pose_of(compose: Compose, robot: str) -> tuple[float, float]:
    """Return the estimated position of a robot, rounded to centimetres."""
    seen = compose.verb("watch", "--json", "--id", robot).object
    pose = seen["streams"]["tlm/odometry"]["message"]
    return round(pose["x_m"], 2), round(pose["y_m"], 2)


def test_robots_of_one_world_have_names_and_places_of_their_own(fleet: Compose) -> None:
    assert "plant: world open with r1, r2" in fleet.logs("plant")
    for number in (1, 2):
        said = docker("logs", fleet.container("robot", number))
        assert f"robot r{number}: ready" in said
    assert pose_of(fleet, "r1") != pose_of(fleet, "r2")


def test_restarted_robot_keeps_its_name(fleet: Compose) -> None:
    fleet.inside("robot", "sh", "-c", "kill -9 -1", number=2)
    until(
        lambda: fleet.inspected("robot", 2)["RestartCount"] == 1,
        within_s=SOON_S,
        what="another r2",
        poll_s=POLL_S,
    )
    fleet.recovers()
    assert docker("logs", fleet.container("robot", 2)).count("robot r2: ready") == 2


@pytest.fixture(scope="module")
def under_way(fleet: Compose) -> None:
    """Set all robots off to their goals; the next tests, which change nothing, do not wait."""
    fleet.does(*DRIVE, TWO_OF.format("drive"), "drive")


@pytest.mark.usefixtures("under_way")
def test_client_without_a_key_is_refused_with_a_reason(fleet: Compose) -> None:
    words = ("run", "--rm", "--network", fleet.network(), fleet.image, "hold", *OPEN_DOOR)
    with pytest.raises(AssertionError, match="accepts only TLS, and this one uses plain TCP"):
        docker(*words)


def test_key_of_a_robot_cannot_command_others(fleet: Compose) -> None:
    words = ("sidestep", "estop", "--config", "/keys/r1/bus.toml")
    done = fleet.inside("robot", *words, user="20001")
    assert (done.code, "is the robot r1 and may not" in done.said) == (1, True), done.said
    seen = fleet.verb("watch", "--json").object["streams"]["tlm/status"]["message"]
    assert seen["vehicle"] != Vehicle.EMERGENCY_STOP


def test_each_service_has_its_own_keys_and_no_others(fleet: Compose) -> None:
    for service in SERVICES:
        fleet.becomes("healthy", service)
    keys = {
        service: sorted(
            name
            for name in fleet.inside(service, "ls", "/keys").said.split()
            if name.endswith(".key")
        )
        for service in SERVICES
    }
    assert keys.pop("robot") == []
    assert keys == {"router": ["router.key"], "plant": ["plant.key"], "web": ["ground.key"]}


def test_a_robot_can_read_its_own_keys_and_those_of_no_other(fleet: Compose) -> None:
    own = fleet.inside("robot", "ls", "/keys/r1", user="20001").said.split()
    assert own == ["bus.toml", "ca.pem", "robot-r1.key", "robot-r1.pem", "robot-r1.stops"]
    others = [f"/keys/r{number}/robot-r{number}.key" for number in range(2, 21)]
    done = fleet.inside("robot", "cat", *others, user="20001")
    assert done.code == 1
    assert done.said.count("Permission denied") == len(others), done.said
    assert fleet.inside("robot", "ls", "/state/r1", user="20002").code != 0
    (key,) = (who for words, who in fleet.users("robot").items() if "sidestep run robot" in words)
    assert key == "20001"


def test_no_key_is_in_a_log_an_environment_or_the_image(fleet: Compose) -> None:
    for service in SERVICES:
        told = fleet.inside(service, "env").said + str(fleet.inspected(service)) + fleet.logs()
        assert "PRIVATE KEY" not in told
    done = fleet.inside("web", "find", "/", "-name", "*.key", "-not", "-path", "/proc/*")
    found = [line for line in done.said.splitlines() if line.endswith(".key")]
    assert found == ["/keys/ground.key"]


@pytest.mark.usefixtures("under_way")
def test_each_robot_drives_to_its_goal_behind_locked_doors(fleet: Compose) -> None:
    assert "router at tls/" in fleet.logs("router")
    arrived: set[str] = set()

    def all_arrived() -> bool:
        for robot in sorted({"r1", "r2"} - arrived):
            if docker("wait", fleet.container("drive", int(robot[1:]))).strip() == "0":
                arrived.add(robot)
            else:  # a busy machine stopped it: it goes on from there
                fleet.arms("--id", robot)
                docker("start", fleet.container("drive", int(robot[1:])))
        return len(arrived) == 2

    until(
        all_arrived,
        within_s=ARRIVE_S,
        what=lambda: fleet.logs("drive")[-LAST_WORDS:],
        poll_s=POLL_S,
    )


def test_mavlink_client_of_the_host_drives_a_robot(fleet: Compose) -> None:
    with MavlinkClient(UdpLine(int(fleet.settings["MAVLINK_PORT"]))) as client:
        drive_to_the_west(client)
    keys = fleet.inside("mavlink", "ls", "/keys").said.split()
    assert keys == ["bus.toml", "ca.pem", "gateway.key", "gateway.pem", "gateway.stops"]


def drive_to_the_west(client: MavlinkClient) -> None:
    before = client.next("GLOBAL_POSITION_INT")
    change_mode = float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
    to_the_west = (-1.0, change_mode, 0.0, nan, before.lat, before.lon - 80, 0.0)  # 0.7 m

    def has_moved() -> bool:  # a busy machine may stop a robot: it drives on when armed again
        with suppress(RuntimeError):
            client.arm()
        frame, number = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_DO_REPOSITION
        client.send(mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *to_the_west))
        return bool(client.next("GLOBAL_POSITION_INT").lon < before.lon - 20)

    until(has_moved, within_s=SOON_S, what="motion")
    client.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0.0)


def test_once_locked_the_doors_stay_locked(fleet: Compose) -> None:
    fleet.profiles = ()
    fleet.does("up", "-d", "--no-build", "--no-deps", "--force-recreate", "router")
    until(
        lambda: "router at tls/" in fleet.logs("router"),
        within_s=SOON_S,
        what="a router",
        poll_s=POLL_S,
    )
    until(
        lambda: fleet.verb("doctor").code == 0,
        within_s=2 * SOON_S,
        what=lambda: fleet.verb("doctor").said + fleet.logs("router")[-LAST_WORDS:],
        poll_s=POLL_S,
    )


def test_what_each_robot_did_is_recorded(fleet: Compose, tmp_path: Path) -> None:
    fleet.does("stop", "record")
    for number in (1, 2):
        fleet.does("cp", "--index", str(number), "record:/recordings", str(tmp_path))
    robots = {path.stem.rpartition("-")[2] for path in tmp_path.rglob("*.mcap")}
    assert robots == {"r1", "r2"}
    assert min(path.stat().st_size for path in tmp_path.rglob("*.tlog")) > 10_000
