"""A bag as the readers of Foxglove see it: the same messages as rosbags and mcap-ros2-support."""

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from checks.built import BuildError, node_modules
from ground.client.outcomes import NoProgress
from ground.commands.export import Export
from tests.support.ground.made_recordings import mcap, run
from tests.support.ros_bags import read_bag

pytestmark = pytest.mark.interop

HERE = Path(__file__).parent
READER = HERE / "read_bag.mjs"
READ_S = 60.0


def packages() -> Path:
    """Return the folder with the readers; the test is skipped where they cannot be had."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed")
    lines = (HERE / "foxglove.txt").read_text().splitlines()
    try:
        return node_modules("foxglove", [line for line in lines if line[:1] != "#"])
    except BuildError as error:
        pytest.skip(f"the readers of Foxglove are not installed: {error}")


def test_foxglove_reads_each_message_of_a_bag(tmp_path: Path) -> None:
    modules = packages()
    file = mcap(tmp_path / "drive.mcap", list(run(200)))
    assert Export(file=str(file), ros2=str(tmp_path / "bag")).run(NoProgress()).ok
    found = read_bag(tmp_path / "bag")
    (part,) = (tmp_path / "bag").glob("*.mcap")
    script = tmp_path / READER.name  # Node looks for packages beside the script
    script.write_bytes(READER.read_bytes())
    (tmp_path / "node_modules").symlink_to(modules)
    command = ["node", str(script), str(part), "/r1/odom"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=READ_S, check=False)
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout)
    assert read["profile"] == "ros2"
    assert read["counts"] == Counter(one.topic for one in found)
    places = [one.message.pose.pose.position for one in found if one.topic == "/r1/odom"]
    assert read["places"] == [[place.x, place.y] for place in places]
