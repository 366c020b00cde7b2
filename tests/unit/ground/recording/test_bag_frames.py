"""Bags of ROS 2 that are played as recordings, and bags that cannot be used."""

from itertools import pairwise
from math import inf, isnan, nan, pi
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from ground.cli.main import main
from ground.client.outcomes import NoProgress
from ground.commands.export import Export
from ground.commands.share import Share
from ground.recording.log_reader import open_log
from ground.ros2 import messages
from protocol import ros_bag
from protocol.ring import BEARINGS_RAD, RADIUS_M
from protocol.ros_bag import BagError, Mount, is_bag
from protocol.wire.codec import decode
from protocol.wire.messages import PlanarOdometry, SonarScan
from tests.support.ground.made_recordings import START_US, mcap, odometry, run
from tests.support.ros_bags import Read, made_bag

BEGIN_NS = START_US * 1000
STEP_NS = 50_000_000
HUMBLE = get_typestore(Stores.ROS2_HUMBLE).types
ODOM = "nav_msgs/msg/Odometry"
SCAN = "sensor_msgs/msg/LaserScan"


def odom(number: int, topic: str = "/odom", x_m: float = 0.0) -> Read:
    time_ns = BEGIN_NS + number * STEP_NS
    return Read(topic, ODOM, time_ns, messages.odometry(odometry(time_ns, x_m), time_ns))


def laser(number: int, ranges: list[float], frame: str = "base_link") -> Read:
    """Return a scan that begins behind the robot and goes around to the left."""
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__LaserScan as LaserScan

    time_ns, nothing = BEGIN_NS + number * STEP_NS, np.zeros(0, np.float32)
    step_rad = 2 * pi / len(ranges)
    top = messages.header(time_ns, frame)
    values = np.array(ranges, np.float32)
    scan = LaserScan(top, -pi, pi - step_rad, step_rad, 0.0, 0.0, 0.1, 10.0, values, nothing)
    return Read("/scan", SCAN, time_ns - 1, scan)


def static(frame: str, mount: Mount, number: int = 0) -> Read:
    rotation = messages.yawed(mount.yaw_rad)
    link = messages.transform("base_link", frame, 0, mount.x_m, mount.y_m, 0.1, rotation)
    found = messages.transforms([link])
    return Read("/tf_static", "tf2_msgs/msg/TFMessage", BEGIN_NS + number, found)


def found_in(path: Path, kind: type[Any], robot: str | None = None) -> list[Any]:
    log = open_log(path, robot)
    frames = [one for one in log if f"/{log.robot}/" in one.key]
    found = [decode(one.frame).message for one in frames]
    return [one for one in found if isinstance(one, kind)]


def test_recording_is_the_same_after_its_way_through_a_bag(tmp_path: Path) -> None:
    frames = list(run(40))
    file = mcap(tmp_path / "drive.mcap", frames)
    assert Export(file=str(file), ros2=str(tmp_path / "bag")).run(NoProgress()).ok
    for kind, fields in (
        (PlanarOdometry, ("x_m", "y_m", "heading_rad", "speed_m_s", "cov_xx_m2", "cov_hh_rad2")),
        (SonarScan, ("echo", "valid")),
    ):
        before, after = found_in(file, kind), found_in(tmp_path / "bag", kind)
        assert len(before) == len(after) == 40
        for name in fields:
            values = [getattr(one, name) for one in after]
            assert values == pytest.approx([getattr(one, name) for one in before], abs=1e-6)
        stamps = [one.time_ns for one in after]
        assert {b - a for a, b in pairwise(stamps)} == {STEP_NS}
    (scan, *_) = found_in(tmp_path / "bag", SonarScan)
    echoes = [scan.range_mm[sonar] for sonar in range(8) if scan.echo >> sonar & 1]
    assert echoes == [803, 804]


@pytest.mark.parametrize("sqlite3", [True, False])
def test_laser_becomes_the_nearest_point_in_each_cone(tmp_path: Path, sqlite3: bool) -> None:
    ranges = [inf] * 360
    ranges[182] = 2.0  # ahead
    ranges[275] = 1.0  # left, outside of all cones
    ranges[180 - 78] = 0.5
    ranges[180 - 70] = 0.05  # too near to be one
    frames = [static("laser", Mount(0.0, 0.0, 0.0)), laser(0, ranges, "laser"), odom(0)]
    path = made_bag(tmp_path / "bag", frames, sqlite3=sqlite3)
    (scan,) = found_in(path, SonarScan)
    assert (scan.valid, scan.echo) == (0b11111111, 0b00010001)
    assert scan.range_mm[4] == pytest.approx(1000 * (2.0 - RADIUS_M), abs=1)
    assert scan.range_mm[0] == pytest.approx(1000 * (0.5 - RADIUS_M), abs=1)


def test_sensor_counts_from_its_place_on_the_robot(tmp_path: Path) -> None:
    ranges = [1.0] + [nan] * 7
    frames = [static("laser", Mount(0.3, 0.0, pi)), laser(0, ranges, "laser"), odom(0)]
    (scan,) = found_in(made_bag(tmp_path / "bag", frames), SonarScan)
    assert (scan.valid, scan.echo) in ((0b10000, 0b10000), (0b01000, 0b01000))
    assert max(scan.range_mm) == pytest.approx(1000 * (1.3 - RADIUS_M), abs=1)
    inner = Mount(1.0, 0.0, pi / 2).of(Mount(1.0, 0.0, 0.5))
    assert inner == pytest.approx((1.0, 1.0, pi / 2 + 0.5))


def test_ranges_of_humble_are_read(tmp_path: Path) -> None:
    kinds = HUMBLE
    time = kinds["builtin_interfaces/msg/Time"](1790000000, 0)
    top = kinds["std_msgs/msg/Header"](time, "sonar_3")
    one = kinds["sensor_msgs/msg/Range"](top, 0, 0.4, 0.02, 3.0, 0.75)
    mount = Mount(RADIUS_M, 0.0, BEARINGS_RAD[3])
    frames = [static("sonar_3", mount), Read("/front", "sensor_msgs/msg/Range", BEGIN_NS, one)]
    path = made_bag(tmp_path / "bag", [*frames, odom(0)], humble=True)
    (scan,) = found_in(path, SonarScan)
    assert scan.echo == 0b1000
    assert scan.range_mm[3] == pytest.approx(750, abs=10)


def test_robots_of_a_bag_are_told_apart(tmp_path: Path) -> None:
    frames = [
        odom(n, name, x_m) for n in range(3) for name, x_m in (("/r1/odom", 1), ("/B/odom", 2))
    ]
    path = made_bag(tmp_path / "bag", frames)
    assert {one.x_m for one in found_in(path, PlanarOdometry, "r1")} == {1.0}
    assert {one.x_m for one in found_in(path, PlanarOdometry, "b")} == {2.0}
    with pytest.raises(BagError, match="no robot 'r9', but b, r1"):
        open_log(path, "r9")


def test_unknown_place_stays_unknown(tmp_path: Path) -> None:
    lost = odometry(0, 1.0)
    lost = type(lost)(
        **{name: getattr(lost, name) for name in lost.__struct_fields__} | {"cov_xx_m2": nan}
    )
    one = Read("/odom", ODOM, BEGIN_NS, messages.odometry(lost, 0))
    (found,) = found_in(made_bag(tmp_path / "bag", [one]), PlanarOdometry)
    assert isnan(found.cov_xx_m2)


def test_malformed_messages_are_skipped_and_counted(tmp_path: Path) -> None:
    bad = Read("/odom", ODOM, BEGIN_NS + 1, b"\0\1\0\0short")
    turned = messages.odometry(odometry(0, 1.0), 0)
    turned.pose.pose.orientation.w = nan
    frames = [
        odom(0),
        bad,
        Read("/odom", ODOM, BEGIN_NS + 2, turned),
        laser(1, [1.0] * 8, "?"),
        odom(1),
    ]
    log = open_log(made_bag(tmp_path / "bag", frames))
    assert len(list(log)) == 2
    assert "2 messages are malformed" in log.damage()
    assert "ranges of ? were left out: no transform leads there" in log.damage()


def test_replay_shows_the_drive_of_a_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made_bag(tmp_path / "bag", [odom(n, x_m=n / 10) for n in range(41)])
    assert main(["replay", str(path), "--plain"]) == 0
    printed = capsys.readouterr().out
    assert "pose 4.00 2.00 0 deg" in printed
    assert "41 frames of r1 in 2.0 s" in printed
    assert main(["rec", "export", str(path)][1:]) == 0
    assert "PLANAR_ODOMETRY,x_m,4" in capsys.readouterr().out


def cut(path: Path) -> Path:
    (file,) = path.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-40])
    return path


def without_metadata(path: Path) -> Path:
    (path / "metadata.yaml").unlink()
    return path


def with_bad_metadata(path: Path) -> Path:
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    return path


def with_other_bytes(path: Path) -> Path:
    (file,) = path.glob("*.db3")
    file.write_bytes(b"SQLite format 3\0" + bytes(500))
    return path


def point(_: int) -> Read:
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point

    return Read("/odom", "geometry_msgs/msg/Point", BEGIN_NS, Point(0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("spoil", "sqlite3", "why"),
    [
        (cut, False, "cannot be read (File end magic is invalid): if it was cut off, repair it"),
        (without_metadata, False, "metadata.yaml is missing: `ros2 bag reindex` writes it"),
        (without_metadata, True, "metadata.yaml is missing"),
        (with_bad_metadata, False, "it cannot be read (Could not load YAML"),
        (with_other_bytes, True, "it cannot be read ("),
    ],
)
def test_bag_that_is_spoilt_is_refused_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: Any, sqlite3: bool, why: str
) -> None:
    path = spoil(made_bag(tmp_path / "bag", [odom(0)], sqlite3=sqlite3))
    assert is_bag(path)
    assert main(["replay", str(path), "--plain"]) == 2
    printed = capsys.readouterr().err
    assert why in printed
    assert str(path) in printed
    assert "Traceback" not in printed


def test_bag_without_odometry_names_what_it_has(tmp_path: Path) -> None:
    path = made_bag(tmp_path / "bag", [point(0)])
    with pytest.raises(BagError, match=r"no odometry .*only /odom \(geometry_msgs/msg/Point\)"):
        open_log(path)


def test_damage_in_the_middle_of_a_bag_is_an_error(tmp_path: Path) -> None:
    file = mcap(tmp_path / "drive.mcap", list(run(40)))
    Export(file=str(file), ros2=str(tmp_path / "bag")).run(NoProgress())
    (part,) = (tmp_path / "bag").glob("*.mcap")
    data = bytearray(part.read_bytes())
    data[5000:5100] = bytes(100)
    part.write_bytes(data)
    with pytest.raises(BagError, match="cannot be read"):
        list(open_log(tmp_path / "bag"))


def test_bag_with_too_many_messages_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made_bag(tmp_path / "bag", [odom(n) for n in range(20)])
    monkeypatch.setattr(ros_bag, "MAX_MESSAGES", 19)
    with pytest.raises(BagError, match="20 messages of 1 topics, at most 19: cut it"):
        list(open_log(path))


def test_bag_needs_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    path = made_bag(tmp_path / "bag", [odom(0)])
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(BagError, match=r"pip install 'sidestep\[ros2\]'"):
        open_log(path)


def test_archive_of_a_bag_has_its_files(tmp_path: Path) -> None:
    path = made_bag(tmp_path / "bag", [odom(n) for n in range(3)])
    assert Share(file=str(path), out=str(tmp_path / "bag.zip")).run(NoProgress()).ok
    with ZipFile(tmp_path / "bag.zip") as archive:
        assert {"metadata.yaml", "bag.mcap"} <= set(archive.namelist())
