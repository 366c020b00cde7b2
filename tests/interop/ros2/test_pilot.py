"""Nodes of another project drive a robot through a forest, and record it."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from rosbags.highlevel import AnyReader

from checks.built import BuildError, environment
from checks.harness.crew import Crew
from gateways.ros2.interfaces import definitions
from gateways.ros2.wire import Distro, hash_of
from tests.support.gateway.ros_network import RosPeer, free_endpoint

pytestmark = pytest.mark.interop
HERE = Path(__file__).parent
NAVIGATE = "nav2_msgs/action/NavigateToPose"
TYPES = (
    *("nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Range"),
    *("geometry_msgs/msg/Twist", f"{NAVIGATE}_FeedbackMessage"),
    *(f"{NAVIGATE}_SendGoal", f"{NAVIGATE}_GetResult"),
    *(f"rcl_interfaces/srv/{name}Parameters" for name in ("List", "Get", "Set")),
)
GOAL = (6.4, 6.4)


def python_of_peers(zenoh: str) -> Path:
    """Return the Python of the other projects, with a version of Zenoh."""
    try:
        text = (HERE / "peers.txt").read_text("utf-8").replace("zenoh==1.10.2", f"zenoh=={zenoh}")
        pins = [one for one in text.split() if "==" in one]
        return environment("ros2-peers", pins, "python3.12")
    except BuildError as error:
        pytest.skip(f"zenoh-ros2-sdk and pyzeros are not installed: {error}")


def test_foreign_node_stops_the_robot(tmp_path: Path) -> None:
    python, endpoint = python_of_peers("1.10.2"), free_endpoint()
    router = RosPeer(endpoint)
    with Crew() as crew:
        words = ("--world", "open", "--no-goal", "--headless", "--no-record")
        up = crew.start("up", *words, "--ros2", endpoint)
        up.says("no goal")
        done = subprocess.run(
            [str(python), str(HERE / "stopper.py"), endpoint.rpartition(":")[2]],
            cwd=tmp_path,  # it compiles its messages there
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr[-3000:] + up.said[-1000:]
    router.close()
    x_m, is_stopped, words_of_it = json.loads(done.stdout.splitlines()[-1])
    assert (x_m, is_stopped) == (pytest.approx(0.6, abs=1e-3), True), words_of_it


@pytest.mark.parametrize("zenoh", ["1.7.2", "1.9.0", "1.10.2"])
def test_foreign_nodes_drive_a_robot_through_a_forest(tmp_path: Path, zenoh: str) -> None:
    """All distributions of ROS 2 contain Zenoh 1.8, of which there is no wheel for Python."""
    python = python_of_peers(zenoh)
    endpoint, order = free_endpoint(), tmp_path / "order.json"
    found = {
        "port": int(endpoint.rpartition(":")[2]),
        "types": dict(definitions(Distro.JAZZY)),
        "hashes": {name: hash_of(name, Distro.JAZZY) for name in TYPES},
        "goal": GOAL,
        "bag": str(tmp_path / "bag"),
    }
    order.write_text(json.dumps(found), encoding="utf-8")
    router = RosPeer(endpoint)
    with Crew() as crew:
        words = ("--world", "forest_dense", "--no-goal", "--headless", "--no-record")
        up = crew.start("up", *words, "--speed", "3", "--ros2", endpoint)
        up.says("no goal")
        done = subprocess.run(
            [str(python), str(HERE / "pilot.py"), str(order)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr[-3000:] + up.said[-1000:]
    router.close()
    steps: dict[str, dict[str, Any]] = {
        one["step"]: one for one in map(json.loads, done.stdout.splitlines())
    }
    assert steps["parameters"]["results"] == [True, True]
    assert steps["parameters"]["count"] > 40
    assert 0.1 <= steps["teleop"]["moved_m"] < 0.6
    ended = steps["navigate"]
    assert (ended["accepted"], ended["status"], ended["error_code"]) == (True, 4, 0), ended
    assert ended["place"] == pytest.approx(GOAL, abs=0.2)
    assert ended["feedback"] > 10
    with AnyReader([tmp_path / "bag"]) as bag:
        counts = {one.topic: one.msgcount for one in bag.connections}
        messages = [bag.deserialize(data, one.msgtype) for one, _, data in bag.messages()]
    steps["bag"].pop("step")
    recorded = {topic: count for topic, count in steps["bag"].items() if topic in counts}
    assert counts == recorded
    assert len(messages) == sum(counts.values()) > 300
