"""Bags of ROS 2 that are made of recordings, or recorded, as readers of others see them."""

import errno
import io
import os
import signal
import subprocess
import sys
from collections import Counter
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from gateways.ros2.recorder import BagRecorder
from gateways.ros2.wire import Distro, hash_of
from ground.client.outcomes import NoProgress
from ground.commands.export import Export
from ground.ros2.bag_file import Bag, bag_log, definition_of, encoded, new_bag
from ground.ros2.offer import LATCHED, TOPICS, RosTopic, own_namespace, topics
from ground.text.output import Output
from protocol.topics import CLOCK
from protocol.wire.messages import SystemTime
from runtime.errors import UserError
from runtime.units import NS_PER_S
from tests.support.each import each
from tests.support.ground.made_recordings import (
    PERIOD_US,
    START_US,
    PublishedFrame,
    TopicEncoder,
    mcap,
    run,
    tlog,
)
from tests.support.ros_bags import Read, read_bag

POINT = RosTopic("/r1/point", "geometry_msgs/msg/Point")
NAME = RosTopic("/r1/robot_description", "std_msgs/msg/String", LATCHED)


def exported(tmp_path: Path, frames: list[PublishedFrame], **options: Any) -> list[Read]:
    """Return the messages of the bag that is made of frames."""
    file = mcap(tmp_path / "drive.mcap", frames)
    outcome = Export(file=str(file), ros2=str(tmp_path / "bag"), **options).run(NoProgress())
    found = read_bag(tmp_path / "bag")
    assert outcome.ok
    assert f"{len(found)} messages" in outcome.text
    return found


def on(found: list[Read], topic: str) -> list[Read]:
    return [one for one in found if one.topic == topic]


def test_recording_becomes_a_bag_with_the_topics_of_the_gateway(tmp_path: Path) -> None:
    found = exported(tmp_path, list(run(40)))
    types = {one.topic: one.type_name for one in found}
    wanted = {
        topic.below("/r1").name: topic.type_name for topic in TOPICS if topic.name != "/clock"
    }
    assert types == wanted
    counts = Counter(one.topic for one in found)
    assert (counts["/r1/odom"], counts["/r1/sonar_3"], counts["/r1/joint_states"]) == (40, 40, 40)
    assert (counts["/r1/plan"], counts["/diagnostics"], counts["/rosout"]) == (4, 2, 1)
    poses = [one.message.pose.pose.position for one in on(found, "/r1/odom")]
    assert poses[-1].x == pytest.approx(0.6 + 0.0125 * 29)
    assert [len(one.message.poses) for one in on(found, "/r1/plan")] == [0, 3, 3, 3]
    assert on(found, "/rosout")[0].message.msg == "goal reached"
    assert on(found, "/diagnostics")[0].message.status[0].name == "r1.sidestep: robot"


def test_times_of_a_bag_are_those_of_arrival_and_measurement(tmp_path: Path) -> None:
    found = on(exported(tmp_path, list(run(40))), "/r1/odom")
    times = [one.time_ns - START_US * 1000 for one in found]
    assert times == pytest.approx([(tick * PERIOD_US + 300) * 1000 for tick in range(40)], abs=2000)
    stamps = [one.message.header.stamp for one in found]
    measured = [one.sec * NS_PER_S + one.nanosec for one in stamps]
    apart = {after - before for before, after in pairwise(measured)}
    assert apart == {PERIOD_US * 1000}
    assert 0 <= found[-1].time_ns - measured[-1] <= 300_000


def test_bag_of_a_simulation_advances_with_the_simulation(tmp_path: Path) -> None:
    encoder, frames = TopicEncoder(), []
    for one in run(40):
        stamp_ns = getattr(one.message, "time_ns", None)
        hurried_us = START_US + (one.time_us - START_US) // 10
        frames.append(one._replace(time_us=hurried_us))
        if stamp_ns is not None and "decision" in one.key:
            now = SystemTime(time_unix_usec=stamp_ns // 1000, time_boot_ms=0)
            frames.append(encoder.publish(CLOCK, now, hurried_us))
    found = exported(tmp_path, frames)
    odom = on(found, "/r1/odom")
    assert (odom[-1].time_ns - odom[0].time_ns) == 39 * PERIOD_US * 1000
    assert [one.message.header.stamp.nanosec for one in odom[:3]] == [0, 50_000_000, 100_000_000]
    assert len(on(found, "/clock")) == 40


def test_robots_of_a_recording_have_namespaces_of_their_own(tmp_path: Path) -> None:
    frames = sorted([*run(20), *run(10, "r-2")], key=lambda one: one.time_us)
    found = exported(tmp_path, frames)
    assert (len(on(found, "/r1/odom")), len(on(found, "/r_2/odom"))) == (20, 10)
    assert own_namespace("r-2") == "/r_2"


def test_bag_holds_a_part_of_a_recording(tmp_path: Path) -> None:
    found = exported(tmp_path, list(run(40)), begin_s=0.5, end_s=1.0)
    assert len(on(found, "/r1/odom")) == 11
    assert len(on(found, "/r1/tf_static")) == 1


def test_tlog_becomes_a_bag_too(tmp_path: Path) -> None:
    file = tlog(tmp_path / "drive.tlog", list(run(10)))
    assert Export(file=str(file), ros2=str(tmp_path / "bag")).run(NoProgress()).ok
    assert len(on(read_bag(tmp_path / "bag"), "/r1/odom")) == 10


@each("named", [{"out": "t.csv"}, {"shape": "wide"}, {"format": "parquet", "out": "t"}])
def test_bag_and_table_exclude_each_other(tmp_path: Path, named: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="--ros2 writes a bag"):
        Export(file="drive.mcap", ros2=str(tmp_path / "bag"), **named)


def test_bag_is_a_new_folder(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="exists: a bag is a new folder"):
        Export(file="drive.mcap", ros2=str(tmp_path))


def test_bag_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    file = mcap(tmp_path / "drive.mcap", list(run(2)))
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="Not a directory"):
        Export(file=str(file), ros2=str(tmp_path / "file" / "bag")).run(NoProgress())


def test_hashes_in_a_bag_are_those_of_the_gateway() -> None:
    for topic in topics(scan=True).values():
        assert definition_of(topic.type_name)[1] == hash_of(topic.type_name, Distro.JAZZY)


def point(x: float) -> bytes:
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point

    return encoded(POINT, Point(x, 0.0, 0.0))


def text(words: str) -> bytes:
    from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as String

    return encoded(NAME, String(words))


def output() -> Output:
    return Output(as_json=False, out=io.StringIO(), err=io.StringIO())


RECORDER = """
import io, sys
from pathlib import Path
from gateways.ros2.recorder import BagRecorder
from ground.text.output import Output
from tests.unit.ground.ros2.test_bags import POINT, point

with BagRecorder(Path(sys.argv[1]), None, Output(as_json=False, out=io.StringIO())) as bag:
    for number in range(10**9):
        bag.take(POINT, point(float(number)))
        if bag._log.tracks[0].writer.written > 0 and not number % 500:
            print(bag._log.tracks[0].writer.written, flush=True)
        bag._ending.wait(0.001)
"""


def test_bag_of_a_killed_recorder_is_read_without_a_repair(tmp_path: Path) -> None:
    command = [sys.executable, "-c", RECORDER, str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    with process:
        assert process.stdout is not None
        written = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
    (folder,) = tmp_path.iterdir()
    found = read_bag(folder)
    assert len(found) >= written > 0
    assert [one.message.x for one in found] == [float(number) for number in range(len(found))]


def test_recorder_writes_what_was_taken_at_its_end(tmp_path: Path) -> None:
    with BagRecorder(tmp_path, None, output()) as recorder:
        recorder.take(POINT, point(1.5))
    assert recorder.is_complete
    (folder,) = tmp_path.iterdir()
    (one,) = read_bag(folder)
    assert (one.topic, one.message.x) == ("/r1/point", 1.5)
    assert abs(one.time_ns - datetime.now(UTC).timestamp() * 1e9) < 3600e9


def test_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot record in"):
        BagRecorder(tmp_path / "file", None, output())


def test_full_disk_leaves_a_bag_that_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = Bag(tmp_path / "bag")
    bag.topics[POINT.name] = POINT
    log = bag_log(bag, part_bytes=10**9, part_s=1e9)
    log.take(POINT.name, point(1.0), START_US * 1000)
    log.flush(8, 100)
    real_write, left = os.pwrite, 40

    def nearly_full(fd: int, data: bytes, place: int) -> int:
        nonlocal left
        if place + len(data) > bag.files[0].path.stat().st_size and not left:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken, left = data[: left or len(data)], 0
        return real_write(fd, taken, place)

    with monkeypatch.context() as full:
        full.setattr(os, "pwrite", nearly_full)
        for number in range(2, 500):
            log.take(POINT.name, point(float(number)), START_US * 1000 + number * 1000)
        log.flush(16, 100)
        assert log.error == "No space left on device"
    bag.describe()
    assert [one.message.x for one in read_bag(bag.path)] == [1.0]
    assert log.close()
    assert [one.message.x for one in read_bag(bag.path)] == [float(one) for one in range(1, 500)]


def test_parts_of_a_bag_follow_each_other_and_begin_with_what_is_latched(tmp_path: Path) -> None:
    bag = new_bag(tmp_path, datetime(2026, 3, 4, tzinfo=UTC), 100_000)
    bag.topics |= {POINT.name: POINT, NAME.name: NAME}
    log = bag_log(bag, part_bytes=20_000, part_s=1e9)
    log.take(NAME.name, text("urdf"), START_US * 1000)
    for number in range(1, 40):
        for step in range(400):
            log.take(POINT.name, point(number * step / 7), (START_US + number * 1000) * 1000)
        log.flush(8 * number, 1000)
    assert log.close()
    assert log.parts > len(bag.files) > 1
    assert sum(file.path.stat().st_size for file in bag.files) < 160_000
    found = read_bag(bag.path)
    assert {file.path for file in bag.files} == set(bag.path.glob("*.mcap"))
    assert {one.message.data for one in on(found, NAME.name)} == {"urdf"}
    assert len(on(found, NAME.name)) == len(bag.files)


def test_oldest_bags_of_a_folder_are_deleted_first(tmp_path: Path) -> None:
    for day in (1, 2, 3):
        bag = new_bag(tmp_path, datetime(2026, 3, day, tzinfo=UTC), None)
        log = bag_log(bag, part_bytes=10**9, part_s=1e9)
        log.close()
        (bag.path / "data.mcap").write_bytes(bytes(40_000))
    (tmp_path / "other").mkdir()
    newest = new_bag(tmp_path, datetime(2026, 3, 4, tzinfo=UTC), 100_000)
    bag_log(newest, part_bytes=10**9, part_s=1e9).close()
    left = sorted(path.name[:8] for path in tmp_path.iterdir())
    assert left == ["20260302", "20260303", "20260304", "other"]
    again = new_bag(tmp_path, datetime(2026, 3, 4, tzinfo=UTC), None)
    assert again.path.name == "20260304T000000Z-ros2.1"
