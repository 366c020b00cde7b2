"""The profile ros2: a robot in containers is a node at a ROS 2 router on this machine."""

from contextlib import closing

import pytest

from checks.harness.processes import free_port
from checks.harness.until import until
from tests.support.compose import BUILD_S, LAST_WORDS, POLL_S, project
from tests.support.gateway.ros_network import RosPeer

pytestmark = pytest.mark.compose

SOON_S = 60.0


def test_robot_is_a_node_at_the_router_of_the_host(image: str) -> None:
    port = free_port()
    settings = {"WORLD": "open", "ROS2_ROUTER": f"tcp/host.docker.internal:{port}"}
    with (
        closing(RosPeer(f"tcp/0.0.0.0:{port}")) as peer,
        project(image, "ros2", settings=settings) as compose,
    ):
        compose.does("build", "ros2", within_s=BUILD_S)
        seen = peer.listen("/r1/odom", "nav_msgs/msg/Odometry")
        compose.up()
        until(
            lambda: len(seen) > 10,
            within_s=SOON_S,
            what=lambda: compose.logs("ros2")[-LAST_WORDS:],
            poll_s=POLL_S,
        )
        assert seen[0][0].child_frame_id == "base_link"
        assert any("/r1/sidestep" in token.replace("%", "/") for token in peer.tokens())
