"""Point 3: what the endpoints send and receive, recorded for tools that know only MAVLink."""

import runpy
import shutil
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

from ground.gateway.dialect import mavlink
from ground.gateway.endpoints.recorder import TrafficRecorder, new_file
from runtime.errors import UserError
from tests.support.gateway.fake_port import ORIGIN
from tests.support.gateway.telemetry import odometry, status
from tests.support.gateway.whole import SilentPort, WholeGateway

UTC_NS = 1_800_000_000 * 10**9
KEY = list(range(100, 132))
HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
SIGNING = mavlink.MAVLink_setup_signing_message(1, 1, KEY, 0)


class SimulatedPort(SilentPort):
    """A robot that drives one metre per second to the east."""

    def snapshot(self, now_ns: int) -> Any:
        self.telemetry["odometry"] = odometry(time_ns=now_ns, x_m=now_ns / 1e9, y_m=0.0)
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
    span = places[-1]._timestamp - places[0]._timestamp
    assert span == pytest.approx(3.0, abs=0.3)
    assert places[0]._timestamp == pytest.approx(UTC_NS / 1e9, abs=0.5)
    metres = (places[-1].lon - places[0].lon) / 1e7 * 111_320 * 0.677
    assert metres == pytest.approx(span, rel=0.02)
    assert {one.lat for one in places} == {round(ORIGIN.latitude_deg * 1e7)}
    beats = [one for one in found if one.get_type() == "HEARTBEAT"]
    assert {one.get_srcSystem() for one in beats} == {1, 255}
    assert {one.type for one in beats if one.get_srcSystem() == 1} == {
        mavlink.MAV_TYPE_GROUND_ROVER
    }


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


def test_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "old.tlog"
    path.write_bytes(b"old")
    with pytest.raises(UserError, match=r"cannot record to .*old\.tlog: File exists"):
        new_file(path)
    assert path.read_bytes() == b"old"
