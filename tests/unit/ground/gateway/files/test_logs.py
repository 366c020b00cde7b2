"""Row 49: recordings by the LOG protocol."""

import os
from pathlib import Path

import pytest

from gateways.mavlink.log_protocol import BLOCK, LAST_BLOCKS, MAX_RANGES
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from protocol.wire.enums import Vehicle
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, OTHER
from tests.support.gateway.parameter_bench import ParameterBench, of_type
from tests.support.gateway.telemetry import status

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
        bench.face.receive(wanted(2, 0, 1), CLIENT, 0)
    assert len(of_type(bench.after(2.0), "LOG_DATA")) == MAX_RANGES


def test_two_clients_download_at_once(bench: ParameterBench) -> None:
    bench.face.receive(wanted(1), CLIENT, 0)
    bench.face.receive(wanted(2), OTHER, 0)
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
