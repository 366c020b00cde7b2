"""Worlds that are made of bags of ROS 2: of a map, or of ranges along a drive."""

from math import cos, inf, isfinite, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__MapMetaData as MapMetaData
from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__OccupancyGrid as OccupancyGrid
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__LaserScan as LaserScan

from ground.ros2 import messages
from plant.cli import main
from plant.imports import ros_bag
from plant.imports.ros_bag import load_bag
from plant.model.errors import WorldError
from plant.world.file import load
from tests.support.ground.made_recordings import mcap, odometry, run
from tests.support.ros_bags import Read, made_bag

STEP_NS = 50_000_000
ROOM_M = 2.0
"""The walls are so far from the origin on each side."""


def pose(number: int, x_m: float, y_m: float, heading_rad: float) -> Read:
    time_ns = number * STEP_NS
    found = messages.odometry(odometry(time_ns, x_m, y_m, heading_rad), time_ns)
    return Read("/odom", "nav_msgs/msg/Odometry", time_ns, found)


def wall_m(x_m: float, y_m: float, away_rad: float) -> float:
    """Return the distance of the wall of the room in a direction."""
    found = [
        (side * ROOM_M - start) / step
        for start, step in ((x_m, cos(away_rad)), (y_m, sin(away_rad)))
        for side in (-1, 1)
        if abs(step) > 1e-9
    ]
    return min(one for one in found if one > 0)


def laser(number: int, x_m: float, y_m: float, heading_rad: float, max_m: float) -> Read:
    step_rad, time_ns = 2 * pi / 180, number * STEP_NS
    far = [wall_m(x_m, y_m, heading_rad - pi + one * step_rad) for one in range(180)]
    ranges = np.array([one if one < max_m else inf for one in far], np.float32)
    top, nothing = messages.header(time_ns, "base_link"), np.zeros(0, np.float32)
    angles = (-pi, pi - step_rad, step_rad)
    scan = LaserScan(top, *angles, 0.0, 0.0, 0.05, max_m, ranges, nothing)
    return Read("/scan", "sensor_msgs/msg/LaserScan", time_ns - 1, scan)


def drive(max_m: float = 8.0) -> list[Read]:
    places = [(-1.0 + 0.15 * number, 0.3 * sin(number), number / 5) for number in range(1, 14)]
    return [
        one
        for number, place in enumerate(places, 1)
        for one in (laser(number, *place, max_m), pose(number, *place))
    ]


def grid(data: Any, topic: str = "/map", time_ns: int = 0, cell_m: float = 0.5) -> Read:
    rows = np.array(data, np.int8)
    where = messages.pose_of(odometry(0, -1.0, -2.0))
    time = messages.time_of(0)
    info = MapMetaData(time, cell_m, rows.shape[1], rows.shape[0], where)
    found = OccupancyGrid(messages.header(0, "map"), info, rows.reshape(-1))
    return Read(topic, "nav_msgs/msg/OccupancyGrid", time_ns, found)


def test_map_of_a_bag_becomes_cells(tmp_path: Path) -> None:
    old = [[100] * 3] * 3
    new = [[0, 25, 26], [0, 0, -1], [100, 0, 0]]
    path = made_bag(tmp_path / "bag", [grid(old), grid(new, time_ns=9), grid(old, "/other")])
    cells = load_bag(path, None)
    assert cells.blocked.tolist() == [
        [False, False, True],
        [False, False, True],
        [True, False, False],
    ]
    assert (cells.cell_m, cells.corner) == (0.5, (-1.0, -2.0))


def test_map_of_a_bag_has_cells_of_its_own(tmp_path: Path) -> None:
    path = made_bag(tmp_path / "bag", [grid([[0]])])
    with pytest.raises(WorldError, match="--cell: its map has cells"):
        load_bag(path, 0.1)


@pytest.mark.parametrize(
    ("data", "cell_m", "why"),
    [([[100]], 0.5, "no cell of the map on /map is free"), ([[0]], 50.0, "is malformed")],
)
def test_useless_map_is_refused(tmp_path: Path, data: Any, cell_m: float, why: str) -> None:
    path = made_bag(tmp_path / "bag", [grid(data, cell_m=cell_m)])
    with pytest.raises(WorldError, match=why):
        load_bag(path, None)


@pytest.mark.parametrize("max_m", [8.0, 2.5])
def test_room_is_found_again_from_a_laser(tmp_path: Path, max_m: float) -> None:
    cells = load_bag(made_bag(tmp_path / "bag", drive(max_m)), 0.1)
    left, low = cells.corner
    free = ~cells.blocked
    inner = [
        free[int((y_m - low) / 0.1), int((x_m - left) / 0.1)]
        for x_m in np.arange(-1.6, 1.7, 0.1)
        for y_m in np.arange(-1.6, 1.7, 0.1)
    ]
    assert np.mean(inner) > 0.98
    assert max(cells.size_m) <= 2 * ROOM_M + 0.3
    assert min(cells.size_m) >= 2 * ROOM_M - 0.3


def test_bag_becomes_a_world_to_drive_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made_bag(tmp_path / "my_drive", drive())
    assert main(["import", str(path), "--cell", "0.1", "--out", str(tmp_path / "out")]) == 0
    assert "1 world in" in capsys.readouterr().out
    world = load(str(tmp_path / "out" / "my_drive_1_000.toml"))
    assert world.shortest_path_m is not None
    assert isfinite(world.shortest_path_m)
    assert max(world.size_m) == pytest.approx(2 * ROOM_M, abs=0.3)


def words_of(path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return why a bag is refused, in one line."""
    assert main(["import", str(path), "--out", str(path.parent / "out"), *words]) == 2
    printed = capsys.readouterr().err
    assert "Traceback" not in printed
    assert printed.startswith(str(path))
    return printed


def test_bags_without_what_is_needed_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = [one for one in drive() if one.topic == "/scan"]
    odom = [one for one in drive() if one.topic == "/odom"]
    only = made_bag(tmp_path / "odom", odom)
    assert "no map and no ranges, only /odom (nav_msgs/msg/Odometry)" in words_of(only, capsys)
    only = made_bag(tmp_path / "scan", scans)
    assert "no odometry" in words_of(only, capsys)
    for one in scans:
        one.message.header.frame_id = "laser"
    lost = made_bag(tmp_path / "lost", [*scans, *odom])
    assert "no transform leads to laser; fix: record" in words_of(lost, capsys)


def test_drive_that_is_too_large_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made_bag(tmp_path / "bag", drive())
    monkeypatch.setattr(ros_bag, "MAX_CELLS", 100)
    assert "fix: take larger cells with --cell" in words_of(path, capsys)
    monkeypatch.setattr(ros_bag, "MAX_RAYS", 100)
    assert "cut it with `ros2 bag convert`" in words_of(path, capsys)


def test_own_recording_is_told_from_a_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = mcap(tmp_path / "drive.mcap", list(run(5)))
    assert "it is not of ROS 2; fix: if it is a recording of this project" in words_of(path, capsys)


def test_missing_bag_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "there is no such file" in words_of(tmp_path / "none.db3", capsys)
    (tmp_path / "empty").mkdir()
    assert "metadata.yaml is missing" in words_of(tmp_path / "empty", capsys)
