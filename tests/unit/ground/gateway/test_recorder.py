"""Point 3: what the endpoints send and receive, recorded for tools that know only MAVLink."""

import errno
import runpy
import shutil
import sys
from itertools import pairwise
from math import cos, pi, remainder, sin, tau
from pathlib import Path
from threading import Event
from typing import Any, cast

import pytest
from pymavlink import mavutil

from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.traffic_recorder import TrafficRecorder, new_file
from ground.missions.qgroundcontrol import to_local
from ground.recording.log_writer import LogFile
from runtime.errors import UserError
from tests.support.gateway.fake_port import ORIGIN
from tests.support.gateway.telemetry import odometry, status
from tests.support.gateway.whole import SilentPort, WholeGateway
from tests.support.until import PATIENCE_S, until

UTC_NS = 1_800_000_000 * 10**9
KEY = list(range(100, 132))
HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
SIGNING = mavlink.MAVLink_setup_signing_message(1, 1, KEY, 0)


def driven(seconds: float) -> tuple[float, float, float]:
    """Return x, y and heading after a time: an arc of 2 m radius at 1 m/s, from north to west."""
    return 2.0 * cos(seconds / 2), 2.0 * sin(seconds / 2), pi / 2 + seconds / 2


class SimulatedPort(SilentPort):
    """A robot that drives along an arc."""

    def snapshot(self, now_ns: int) -> Any:
        x_m, y_m, heading_rad = driven(now_ns / 1e9)
        pose = odometry(time_ns=now_ns, x_m=x_m, y_m=y_m, heading_rad=heading_rad)
        self.telemetry["odometry"] = pose
        self.telemetry["status"] = status(time_ns=now_ns)
        return super().snapshot(now_ns)


class Drive(WholeGateway):
    """A gateway with a recorder."""

    def __init__(self, path: Path) -> None:
        self.recorder = TrafficRecorder(new_file(path), UTC_NS)
        super().__init__(SimulatedPort(), self.recorder)

    def end(self) -> str:
        self.close()
        return self.recorder.close()


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """Return the recording of a drive of three seconds with two clients."""
    path = tmp_path / "drive.tlog"
    drive = Drive(path)
    drive.send(HEARTBEAT, "a")
    drive.run(0.02)
    drive.send(HEARTBEAT, "b", is_mavlink1=True)
    drive.run(0.02)
    drive.send(SIGNING)
    drive.run(3.0)
    assert drive.end() == ""
    return path


def messages_in(path: Path) -> list[Any]:
    log = mavutil.mavlogfile(str(path), robust_parsing=True)
    found = []
    while (message := log.recv_msg()) is not None:
        found.append(message)
    log.close()
    return found


def test_standard_messages_alone_tell_the_drive(recorded: Path) -> None:
    found = messages_in(recorded)
    assert not [one for one in found if one.get_type() == "BAD_DATA"]
    places = [one for one in found if one.get_type() == "GLOBAL_POSITION_INT"]
    assert places[-1]._timestamp - places[0]._timestamp == pytest.approx(3.0, abs=0.3)
    assert places[0]._timestamp == pytest.approx(UTC_NS / 1e9, abs=0.5)
    beats = [one for one in found if one.get_type() == "HEARTBEAT"]
    assert {one.get_srcSystem() for one in beats} == {1, 255}
    assert {one.type for one in beats if one.get_srcSystem() == 1} == {
        mavlink.MAV_TYPE_GROUND_ROVER
    }


def test_positions_read_by_mavexplorer_are_the_driven_path(recorded: Path) -> None:
    log = mavutil.mavlink_connection(str(recorded))  # as MAVExplorer opens a file
    counts = {"GLOBAL_POSITION_INT": 0, "LOCAL_POSITION_NED": 0, "ATTITUDE": 0}
    while (one := log.recv_match(type=list(counts))) is not None:
        counts[one.get_type()] += 1
        x_m, y_m, heading_rad = driven(one.time_boot_ms / 1e3)
        if one.get_type() == "GLOBAL_POSITION_INT":
            assert to_local(ORIGIN, one.lat / 1e7, one.lon / 1e7) == pytest.approx(
                (x_m, y_m), abs=0.01
            )
        elif one.get_type() == "LOCAL_POSITION_NED":
            assert (one.y, one.x) == pytest.approx((x_m, y_m), abs=0.002)
        else:
            off_rad = remainder(pi / 2 - one.yaw - heading_rad, tau)
            assert off_rad == pytest.approx(0.0, abs=0.001)
    log.close()
    assert min(counts.values()) >= 12


def test_each_message_is_recorded_once_with_a_whole_sequence(recorded: Path) -> None:
    found = messages_in(recorded)
    ours = [one for one in found if one.get_srcSystem() == 1]
    skipped = sum((b.get_seq() - a.get_seq()) % 256 - 1 for a, b in pairwise(ours))
    unknown = [one for one in found if one.get_type() == "UNKNOWN_512"]  # CONTROL_STATUS
    assert skipped == len(unknown) > 0
    times = [one.time_boot_ms for one in ours if one.get_type() == "ATTITUDE"]
    assert len(times) == len(set(times)) > 20


def test_keys_are_never_recorded(recorded: Path) -> None:
    assert bytes(KEY) not in recorded.read_bytes()
    assert "SETUP_SIGNING" not in {one.get_type() for one in messages_in(recorded)}


def test_key_to_send_is_never_recorded(tmp_path: Path) -> None:
    recorder = TrafficRecorder(new_file(tmp_path / "x.tlog"), 0)
    recorder.sent(1, SIGNING, 1)
    recorder.close()
    assert recorder.path.read_bytes() == b""


def test_mavlogdump_prints_the_recording(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = shutil.which("mavlogdump.py", path=str(Path(sys.executable).parent))
    assert tool is not None
    monkeypatch.setattr(
        sys, "argv", [tool, "--types", "GLOBAL_POSITION_INT,ATTITUDE", str(recorded)]
    )
    runpy.run_path(tool, run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert sum("GLOBAL_POSITION_INT {" in line for line in lines) >= 12
    assert sum("ATTITUDE {" in line for line in lines) >= 25


def test_folder_gets_a_file_named_after_the_time(tmp_path: Path) -> None:
    recorder = TrafficRecorder(new_file(tmp_path / "new"), 0)
    assert recorder.close() == ""
    assert recorder.path.parent == tmp_path / "new"
    assert recorder.path.name.endswith("Z-mavlink.tlog")


class TroubledFile:
    """A file whose disk is full, or hangs until it is released."""

    def __init__(self, path: Path, error: OSError | None = None) -> None:
        self.path = path
        self.released = Event()
        self._error = error

    def append(self, batch: bytes) -> None:
        if self._error is not None:
            raise self._error
        self.released.wait(PATIENCE_S)

    def sync(self) -> None:
        """Synchronise nothing."""

    def close(self) -> None:
        """Close nothing."""


def test_full_disk_is_noted_once_and_holds_up_nothing(tmp_path: Path) -> None:
    file = TroubledFile(tmp_path / "x.tlog", OSError(errno.ENOSPC, "No space left on device"))
    notes: list[str] = []
    recorder = TrafficRecorder(cast("LogFile", file), 0, notes.append)

    def is_noted() -> bool:
        recorder.sent(1, HEARTBEAT, 2)
        return bool(notes)

    until(is_noted)
    for at in range(1_000):
        recorder.sent(1, HEARTBEAT, at)
    assert len(notes) == 1
    assert "No space left on device" in notes[0]
    assert "messages lost: No space left on device" in recorder.close()


def test_disk_that_hangs_is_noted_and_holds_up_nothing(tmp_path: Path) -> None:
    file, notes = TroubledFile(tmp_path / "x.tlog"), list[str]()
    recorder = TrafficRecorder(cast("LogFile", file), 0, notes.append)
    while recorder._writer.dropped == 0:
        recorder._writer.take("mavlink", bytes(60_000), 1)
    for at in range(100):
        recorder.sent(1, HEARTBEAT, at)
    assert len(notes) == 1
    assert "the disk took too long" in notes[0]
    file.released.set()
    assert "messages lost" in recorder.close()


def test_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "old.tlog"
    path.write_bytes(b"old")
    with pytest.raises(UserError, match=r"cannot record to .*old\.tlog: File exists"):
        new_file(path)
    assert path.read_bytes() == b"old"
