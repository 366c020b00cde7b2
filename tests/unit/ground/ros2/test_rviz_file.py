"""The rviz file of the examples: its topics, types and frames are those of the gateway."""

from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from ground.ros2 import messages
from ground.ros2.messages import Geometry
from ground.ros2.offer import SONAR_FRAMES, topics

FILE = Path(__file__).parents[4] / "examples" / "robot.rviz"
SHOWN = {
    "RobotModel": ("Description Topic", "std_msgs/msg/String"),
    "Odometry": ("Topic", "nav_msgs/msg/Odometry"),
    "Range": ("Topic", "sensor_msgs/msg/Range"),
    "Path": ("Topic", "nav_msgs/msg/Path"),
    "MarkerArray": ("Topic", "visualization_msgs/msg/MarkerArray"),
}
"""Where a display of rviz2 has its topic, and the type that it reads."""

ROBOT = topics(scan=False)


def manager() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(FILE.read_text())["Visualization Manager"]
    return found


def displays() -> list[tuple[str, dict[str, Any]]]:
    """Return the displays with a topic, by their classes."""
    prefix = "rviz_default_plugins/"
    found = [(one["Class"].removeprefix(prefix), one) for one in manager()["Displays"]]
    return [(name, one) for name, one in found if name in SHOWN]


def test_displays_read_topics_of_the_gateway_by_their_types() -> None:
    shown: Counter[str] = Counter()
    for name, display in displays():
        place, type_name = SHOWN[name]
        topic = display[place]
        own = topic["Value"].removeprefix("/r1/")
        assert ROBOT[own].type_name == type_name
        qos = ROBOT[own].qos
        assert (topic["Reliability Policy"] == "Reliable") == qos.is_reliable
        assert (topic["Durability Policy"] == "Transient Local") == qos.is_latched
        shown[own] += 1
    assert shown == dict.fromkeys(
        (*SONAR_FRAMES, "odom", "robot_description", "plan", "markers"), 1
    )


def test_displays_are_enabled_and_show_the_covariance() -> None:
    assert all(one["Enabled"] for one in manager()["Displays"])
    (odometry,) = (one for name, one in displays() if name == "Odometry")
    assert odometry["Covariance"]["Value"]
    assert odometry["Covariance"]["Position"]["Value"]
    assert odometry["Covariance"]["Orientation"]["Value"]
    assert "rviz_default_plugins/TF" in {one["Class"] for one in manager()["Displays"]}


def test_frames_of_the_view_are_those_of_the_robot() -> None:
    links = messages.static_transforms(Geometry(), 0).transforms
    frames = {messages.MAP, messages.BASE} | {one.child_frame_id for one in links}
    assert manager()["Global Options"]["Fixed Frame"] in frames
    assert manager()["Views"]["Current"]["Target Frame"] in frames


def test_tools_publish_what_the_gateway_takes() -> None:
    source = (FILE.parents[1] / "gateways/ros2/navigation.py").read_text()
    tools = {one["Class"].rpartition("/")[2]: one for one in manager()["Tools"]}
    for name, topic, type_name in (
        ("SetGoal", "goal_pose", "geometry_msgs/msg/PoseStamped"),
        ("SetInitialPose", "initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
    ):
        assert tools[name]["Topic"]["Value"] == f"/r1/{topic}"
        assert f'"{topic}"' in source
        assert type_name in source
