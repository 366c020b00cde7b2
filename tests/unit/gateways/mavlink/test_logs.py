"""Recordings by the LOG protocol, and the record of what the endpoints send and receive."""

import errno
import os
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

from checks.harness.until import PATIENCE_S, until
from gateways.mavlink.log_protocol import BLOCK, LAST_BLOCKS, MAX_RANGES
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.traffic_recorder import TrafficRecorder, new_file
from ground.missions.qgroundcontrol import to_local
from ground.recording.log_writer import LogFile
from protocol.wire.enums import Vehicle
from runtime.errors import UserError
from tests.support.each import each
from tests.support.gateway.benches import ParameterBench, of_type
from tests.support.gateway.fake_port import (
    CLIENT,
    ORIGIN,
    OTHER,
    SilentPort,
    WholeGateway,
    odometry,
    status,
)

OLD, NEW = "20261122T080000Z-r1.tlog", "20261123T131200Z-r1.tlog"
CONTENTS = {OLD: b"o" * 90 * 3, NEW: bytes(range(256)) * 40}
END = mavlink.MAVLink_log_request_end_message(1, 1)


@pytest.fixture
def bench(tmp_path: Path) -> ParameterBench:
    for name, content in CONTENTS.items():
        (tmp_path / name).write_bytes(content)
    return ParameterBench(tmp_path)


def wanted_list(start: int = 0, end: int = 0xFFFF) -> MavMessage:
    return mavlink.MAVLink_log_request_list_message(1, 1, start, end)


def wanted(number: int, offset: int = 0, count: int = 0xFFFF_FFFF) -> MavMessage:
    return mavlink.MAVLink_log_request_data_message(1, 1, number, offset, count)


def blocks(bench: ParameterBench, message: MavMessage) -> list[MavMessage]:
    return of_type(bench.send(message) + bench.after(2.0), "LOG_DATA")


def content(found: list[MavMessage]) -> bytes:
    return b"".join(bytes(one.data[: one.count]) for one in found)


def texts(messages: list[MavMessage]) -> str:
    return "".join(one.text for one in of_type(messages, "STATUSTEXT"))


def test_logs_are_listed_with_time_and_size(bench: ParameterBench) -> None:
    found = of_type(bench.send(wanted_list()) + bench.after(0.1), "LOG_ENTRY")
    assert [(one.id, one.num_logs, one.last_log_num) for one in found] == [(1, 2, 2), (2, 2, 2)]
    assert [one.size for one in found] == [len(CONTENTS[OLD]), len(CONTENTS[NEW])]
    assert found[1].time_utc - found[0].time_utc == 29 * 3600 + 12 * 60


@pytest.mark.parametrize(
    ("start", "end", "numbers"),
    [(2, 2, [2]), (0, 1, [1]), (3, 0xFFFF, []), (2, 1, []), (0, 0, [])],
)
def test_part_of_the_list(bench: ParameterBench, start: int, end: int, numbers: list[int]) -> None:
    found = of_type(bench.send(wanted_list(start, end)) + bench.after(0.1), "LOG_ENTRY")
    assert [one.id for one in found] == numbers


@each("folder", [None, Path("/nonexistent")])
def test_no_logs_are_one_empty_entry(folder: Path | None) -> None:
    (entry,) = of_type(ParameterBench(folder).send(wanted_list()), "LOG_ENTRY")
    assert (entry.id, entry.num_logs, entry.size) == (0, 0, 0)


@pytest.mark.parametrize(("number", "name"), [(1, OLD), (2, NEW)])
def test_log_is_sent_byte_for_byte(bench: ParameterBench, number: int, name: str) -> None:
    found = blocks(bench, wanted(number))
    assert content(found) == CONTENTS[name]
    assert [one.ofs for one in found] == [BLOCK * at for at in range(len(found))]
    assert {one.count for one in found[:-1]} == {BLOCK}
    assert found[-1].count < BLOCK
    assert {one.id for one in found} == {number}


def test_entries_and_last_blocks_are_repeated_on_a_lossy_line(bench: ParameterBench) -> None:
    bench.vehicle.lossy = {CLIENT.client}
    found = of_type(bench.send(wanted_list(1, 1)) + bench.after(0.1), "LOG_ENTRY")
    assert [one.id for one in found] == [1, 1]
    assert [one.ofs for one in blocks(bench, wanted(1, 0, 180))] == [0, *LAST_BLOCKS * [90]]


def test_missing_ranges_are_sent_one_after_the_other(bench: ParameterBench) -> None:
    bench.send(wanted(2, 90, 180))
    found = blocks(bench, wanted(2, 900, 90))
    assert [(one.ofs, one.count) for one in found] == [(90, 90), (180, 90), (900, 90)]
    assert content(found[2:]) == CONTENTS[NEW][900:990]


@pytest.mark.parametrize("offset", [len(CONTENTS[NEW]), 0xFFFF_FFFF])
def test_offset_behind_the_end_gives_an_empty_block(bench: ParameterBench, offset: int) -> None:
    (block,) = blocks(bench, wanted(2, offset))
    assert (block.ofs, block.count) == (offset, 0)


def test_count_of_zero_gives_an_empty_block(bench: ParameterBench) -> None:
    (block,) = blocks(bench, wanted(2, 0, 0))
    assert block.count == 0


@pytest.mark.parametrize("number", [0, 3, 0xFFFF])
def test_unknown_log_is_refused_with_its_number(bench: ParameterBench, number: int) -> None:
    found = bench.send(wanted(number))
    assert of_type(found, "LOG_DATA") == []
    assert f"no log {number}" in texts(found)


def test_end_stops_the_download_and_closes_the_file(bench: ParameterBench) -> None:
    before = len(os.listdir("/proc/self/fd"))
    bench.send(wanted(2))
    bench.send(END)
    assert bench.after(1.0) == []
    assert len(os.listdir("/proc/self/fd")) == before


def test_another_log_replaces_the_one_that_is_sent(bench: ParameterBench) -> None:
    before = len(os.listdir("/proc/self/fd"))
    for number in (1, 2) * 500:
        bench.send(wanted(number))
    assert content(of_type(bench.after(2.0), "LOG_DATA")) == CONTENTS[NEW]
    bench.face.forget(CLIENT.client)
    assert len(os.listdir("/proc/self/fd")) == before


def test_flood_of_requests_is_bounded(bench: ParameterBench) -> None:
    for _ in range(10_000):
        bench.receive(wanted(2, 0, 1), CLIENT)
    assert len(of_type(bench.after(2.0), "LOG_DATA")) == MAX_RANGES


def test_two_clients_download_at_once(bench: ParameterBench) -> None:
    bench.receive(wanted(1), CLIENT)
    bench.receive(wanted(2), OTHER)
    found = of_type(bench.after(2.0), "LOG_DATA")
    assert content([one for one in found if one.id == 1]) == CONTENTS[OLD]
    assert content([one for one in found if one.id == 2]) == CONTENTS[NEW]


@pytest.mark.parametrize("message", [wanted_list(), wanted(1)])
def test_logs_are_refused_while_armed(bench: ParameterBench, message: MavMessage) -> None:
    bench.port.telemetry["status"] = status(vehicle=Vehicle.ACTIVE)
    bench.after(0.02)
    found = bench.send(message)
    assert len(of_type(found, "STATUSTEXT")) == len(found) == 1
    assert "disarm" in texts(found)


def test_arming_ends_a_download(bench: ParameterBench, tmp_path: Path) -> None:
    (tmp_path / NEW).write_bytes(CONTENTS[NEW] * 100)
    bench.send(wanted(2))
    assert of_type(bench.after(0.02), "LOG_DATA") != []
    bench.port.telemetry["status"] = status(vehicle=Vehicle.ACTIVE)
    found = bench.after(0.5)
    assert of_type(found, "LOG_DATA") == []
    assert "disarm" in texts(found)


def test_erasing_is_refused(bench: ParameterBench, tmp_path: Path) -> None:
    assert "not erased" in texts(bench.send(mavlink.MAVLink_log_erase_message(1, 1)))
    assert sorted(path.name for path in tmp_path.iterdir()) == [OLD, NEW]


def test_numbers_stay_those_of_the_list(bench: ParameterBench, tmp_path: Path) -> None:
    bench.send(wanted_list())
    (tmp_path / OLD).unlink()
    bench.after(2.0)
    assert content(blocks(bench, wanted(2))) == CONTENTS[NEW]
    assert "no log 1" in texts(bench.send(wanted(1)))


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
    assert skipped == 0
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
