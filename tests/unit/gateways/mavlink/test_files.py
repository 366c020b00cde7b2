"""The FTP server: asked by frames, by pymavlink's client, on slow lines, and by hostile ones."""

import os
from io import BytesIO
from pathlib import Path

import pytest
from pymavlink.mavftp import MAVFTP, FtpError

from gateways.mavlink.ftp_messages import MAX_DATA, WRITING, Failure, Opcode, checksum
from gateways.mavlink.ftp_server import MAX_BURST, MAX_OF_CLIENT, MAX_OPEN
from gateways.mavlink.mav_service import FAST_BYTES_S, Pacing
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from protocol.wire.enums import Vehicle
from robot.parameter_table import SPECS
from tests.support.each import each
from tests.support.gateway.benches import (
    ParameterBench,
    Reply,
    SimulatedLink,
    asked,
    client_on,
    failure,
    got,
    of_type,
    replies,
    replies_in,
)
from tests.support.gateway.fake_port import CLIENT, OTHER, status, words

NAME = "20261123T131200Z-r1.tlog"
PATH = f"/recordings/{NAME}".encode()
CONTENT = bytes(range(256)) * 4 + b"end"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / NAME).write_bytes(CONTENT)
    return tmp_path


@pytest.fixture
def bench(folder: Path) -> ParameterBench:
    return ParameterBench(folder)


def opened(bench: ParameterBench, path: bytes = PATH, session: int = 0) -> int:
    (reply,) = replies(bench, asked(Opcode.OPEN, path, session=session))
    assert reply.opcode == Opcode.ACK
    return int.from_bytes(reply.data, "little")


def listing(bench: ParameterBench, path: bytes, opcode: int = Opcode.LIST) -> list[str]:
    names: list[str] = []
    while True:
        (reply,) = replies(bench, asked(opcode, path, offset=len(names)))
        if reply.opcode == Opcode.NAK:
            assert reply.data == bytes([Failure.END_OF_FILE])
            return names
        names += reply.data.decode().rstrip("\0").split("\0")


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_folders_and_files_are_listed(bench: ParameterBench) -> None:
    opened(bench, b"general.json.xz")
    names = [line.split("\t")[0] for line in listing(bench, b"/")]
    folders = ["D@MAV_LOG", "D@PARAM", "Drecordings"]
    assert names == [*folders, "Fgeneral.json.xz", "Fparameters.json.xz"]
    assert listing(bench, b"/recordings/") == [f"F{NAME}\t{len(CONTENT)}"]
    assert listing(bench, b"@MAV_LOG") == [f"F{NAME}.bin\t{len(CONTENT)}"]
    assert [line.split("\t")[0] for line in listing(bench, b"@PARAM")] == ["Fparam.pck"]


def test_folders_are_listed_with_times(bench: ParameterBench) -> None:
    (line,) = listing(bench, b"@MAV_LOG", Opcode.LIST_WITH_TIME)
    assert line == f"F{NAME}.bin\t{len(CONTENT)}\t{1_795_439_520}"
    assert listing(bench, b"/", Opcode.LIST_WITH_TIME)[0] == "D@MAV_LOG\t0\t0"


def arm(bench: ParameterBench) -> list[MavMessage]:
    bench.port.telemetry["status"] = status(vehicle=Vehicle.ACTIVE)
    return bench.after(0.02)


def test_recordings_of_an_armed_robot_are_not_read(bench: ParameterBench) -> None:
    """By FTP as little as by LOG: a slow disk must not hold up commands and heartbeats."""
    opened(bench, PATH, session=1)
    arm(bench)
    found = bench.send(asked(Opcode.OPEN, PATH, session=2))
    assert [one.data for one in replies_in(found)] == [bytes([Failure.FAIL])]
    assert "disarm" in words(found)
    for opcode in (Opcode.READ, Opcode.BURST):
        (reply,) = replies(bench, asked(opcode, b"x" * 80, session=1))
        assert (reply.opcode, reply.data) == (Opcode.NAK, bytes([Failure.FAIL]))
    (reply,) = replies(bench, asked(Opcode.CHECKSUM, PATH, session=3))
    assert reply.opcode == Opcode.NAK
    opened(bench, b"@PARAM/param.pck", session=4)


def test_arming_ends_bursts_and_checksums(bench: ParameterBench, folder: Path) -> None:
    (folder / NAME).write_bytes(CONTENT * 3_000)
    opened(bench)
    bench.send(asked(Opcode.BURST, b"x" * 80))
    bench.send(asked(Opcode.CHECKSUM, PATH, session=3))
    found = [reply for reply in replies_in(arm(bench)) if reply.opcode != Opcode.ACK]
    assert [reply.data for reply in found] == [bytes([Failure.FAIL])] * 2
    assert replies_in(bench.after(1.0)) == []


def test_list_of_an_armed_robot_is_the_last_one(bench: ParameterBench, folder: Path) -> None:
    assert len(listing(bench, b"recordings")) == 1
    arm(bench)
    (folder / "20261123T140000Z-r1.tlog").touch()
    bench.after(2.0)
    assert len(listing(bench, b"recordings")) == 1


def test_new_recording_is_listed_after_a_second(bench: ParameterBench, folder: Path) -> None:
    assert len(listing(bench, b"recordings")) == 1
    (folder / "20261123T140000Z-r1.tlog").touch()
    bench.after(1.0)
    assert len(listing(bench, b"recordings")) == 2


def test_long_folder_is_listed_in_parts(bench: ParameterBench, folder: Path) -> None:
    for number in range(60):
        (folder / f"20261123T1400{number:02}Z-r1.tlog").touch()
    assert len(listing(bench, b"recordings")) == 61


def test_only_recordings_of_this_robot_are_listed(bench: ParameterBench, folder: Path) -> None:
    for other in ("20261123T131200Z-r2.tlog", "20261123T131200Z-r1.mcap", "notes.tlog", ".x"):
        (folder / other).touch()
    (folder / "20261123T131201Z-r1.tlog").symlink_to("/etc/passwd")
    assert len(listing(bench, b"recordings")) == 1
    path = b"recordings/20261123T131201Z-r1.tlog"
    assert failure(replies(bench, asked(Opcode.OPEN, path))) == Failure.FILE_NOT_FOUND


def test_burst_carries_the_file_in_blocks_of_the_request(bench: ParameterBench) -> None:
    assert opened(bench) == len(CONTENT)
    found = replies(bench, asked(Opcode.BURST, size=110, sequence=7))
    assert b"".join(one.data for one in found) == CONTENT
    assert {len(one.data) for one in found[:-1]} == {110}
    assert [one.sequence for one in found] == list(range(8, 8 + len(found)))
    assert [one.is_last for one in found] == [False] * (len(found) - 1) + [True]
    assert {one.target for one in found} == {(CLIENT.system, CLIENT.component)}


def test_burst_behind_the_end_is_refused_as_end(bench: ParameterBench) -> None:
    opened(bench, session=3)
    message = asked(Opcode.BURST, offset=len(CONTENT), size=110, session=3)
    found = replies(bench, message)
    assert failure(found) == Failure.END_OF_FILE
    assert found[0].session == 3


def test_block_size_of_zero_is_the_largest(bench: ParameterBench) -> None:
    opened(bench)
    assert len(replies(bench, asked(Opcode.BURST))[0].data) == MAX_DATA


def test_parts_are_read_again(bench: ParameterBench) -> None:
    opened(bench)
    (reply,) = replies(bench, asked(Opcode.READ, offset=100, size=50))
    assert (reply.data, reply.offset) == (CONTENT[100:150], 100)
    (reply,) = replies(bench, asked(Opcode.READ, offset=len(CONTENT) - 3, size=50))
    assert reply.data == b"end"


@pytest.mark.parametrize("offset", [len(CONTENT), len(CONTENT) + 1, 0xFFFF_FFFF])
def test_offset_behind_the_end_is_refused(bench: ParameterBench, offset: int) -> None:
    opened(bench)
    message = asked(Opcode.READ, offset=offset, size=50)
    assert failure(replies(bench, message)) == Failure.END_OF_FILE


def test_reading_nothing_is_refused(bench: ParameterBench) -> None:
    opened(bench)
    message = asked(Opcode.READ, size=0)
    assert failure(replies(bench, message)) == Failure.INVALID_DATA_SIZE


@pytest.mark.parametrize("opcode", [Opcode.READ, Opcode.BURST])
def test_refusal_names_the_session(bench: ParameterBench, opcode: int) -> None:
    found = replies(bench, asked(opcode, size=50, session=77, sequence=0xFFFF))
    assert failure(found) == Failure.INVALID_SESSION
    assert (found[0].session, found[0].request, found[0].sequence) == (77, opcode, 0)


@each(
    "path",
    [
        b"/etc/passwd",
        b"../../../../etc/passwd",
        b"recordings/../../../etc/passwd",
        b"recordings//etc/passwd",
        b"@MAV_LOG/../20261123T131200Z-r1.tlog.bin",
        b"recordings/./" + NAME.encode(),
        b"recordings",
        b"/",
        b"",
        b"\xff\xfe",
        b"general.json.xz/",
        b"@PARAM/param.pck/..",
        b"x" * MAX_DATA,
    ],
)
@each("opcode", [Opcode.OPEN, Opcode.CHECKSUM])
def test_paths_do_not_leave_the_tree(folder: Path, path: bytes, opcode: int) -> None:
    bench = ParameterBench(folder)
    assert failure(replies(bench, asked(opcode, path))) == Failure.FILE_NOT_FOUND


@pytest.mark.parametrize("path", [b"..", b"recordings/..", b"/etc", b"@PARAM/x", b"\xff"])
def test_other_folders_do_not_exist(bench: ParameterBench, path: bytes) -> None:
    expected = Failure.FILE_NOT_FOUND
    found = replies(bench, asked(Opcode.LIST, path))
    if path != b"\xff":
        assert failure(found) == expected
    else:
        assert found[0].opcode in (Opcode.ACK, Opcode.NAK)


@pytest.mark.parametrize("opcode", sorted(WRITING))
def test_nothing_is_written(bench: ParameterBench, folder: Path, opcode: int) -> None:
    found = replies(bench, asked(opcode, PATH, session=9))
    assert failure(found) == Failure.FILE_PROTECTED
    assert found[0].session == 9
    assert (folder / NAME).read_bytes() == CONTENT


@pytest.mark.parametrize("opcode", [17, 99, 127, 255])
def test_unknown_operation_is_refused(bench: ParameterBench, opcode: int) -> None:
    assert failure(replies(bench, asked(opcode))) == Failure.UNKNOWN_COMMAND


@pytest.mark.parametrize("opcode", [Opcode.ACK, Opcode.NAK])
def test_replies_are_not_answered(bench: ParameterBench, opcode: int) -> None:
    assert replies(bench, asked(opcode)) == []


def test_size_larger_than_the_payload_is_refused(bench: ParameterBench) -> None:
    found = replies(bench, asked(Opcode.OPEN, b"x", size=240))
    assert failure(found) == Failure.INVALID_DATA_SIZE


def test_ended_session_reads_nothing(bench: ParameterBench) -> None:
    opened(bench)
    for opcode in (Opcode.TERMINATE, Opcode.TERMINATE):
        assert replies(bench, asked(opcode))[0].opcode == Opcode.ACK
    assert failure(replies(bench, asked(Opcode.READ, size=9))) == Failure.INVALID_SESSION


def test_reset_ends_the_sessions_of_its_sender_only(bench: ParameterBench) -> None:
    opened(bench)
    replies(bench, asked(Opcode.OPEN, PATH), OTHER)
    assert replies(bench, asked(Opcode.RESET))[0].opcode == Opcode.ACK
    assert failure(replies(bench, asked(Opcode.READ, size=9))) == Failure.INVALID_SESSION
    assert replies(bench, asked(Opcode.READ, size=9), OTHER)[0].data == CONTENT[:9]


def test_two_clients_use_the_same_session_number(bench: ParameterBench) -> None:
    opened(bench)
    replies(bench, asked(Opcode.OPEN, b"@PARAM/param.pck"), OTHER)
    assert replies(bench, asked(Opcode.READ, size=9))[0].data == CONTENT[:9]
    assert replies(bench, asked(Opcode.READ, size=2), OTHER)[0].data == b"\x1b\x67"


def test_ten_thousand_sessions_are_bounded(bench: ParameterBench) -> None:
    before = open_files()
    for number in range(10_000):
        sender = CLIENT._replace(system=number % 250, component=number // 250)
        bench.receive(asked(Opcode.OPEN, PATH, session=number % 256), sender)
    assert open_files() - before == MAX_OF_CLIENT
    bench.sent()
    for client in range(100, 100 + 2 * MAX_OPEN):
        bench.receive(asked(Opcode.OPEN, PATH), CLIENT._replace(client=client))
    found = [Reply(one) for one in of_type(bench.sent(), "FILE_TRANSFER_PROTOCOL")]
    assert open_files() - before == MAX_OPEN
    assert found[-1].data == bytes([Failure.NO_SESSIONS])
    bench.after(21.0)
    assert open_files() == before


def test_files_of_a_client_that_has_gone_are_closed(bench: ParameterBench) -> None:
    before = open_files()
    opened(bench)
    bench.receive(asked(Opcode.CHECKSUM, PATH, session=1), CLIENT)
    assert open_files() == before + 2
    bench.face.forget(CLIENT.client)
    assert open_files() == before
    assert bench.after(1.0) == []


def test_long_burst_ends_and_is_paced(bench: ParameterBench, folder: Path) -> None:
    large = folder / "20261123T150000Z-r1.tlog"
    with large.open("wb") as file:
        file.truncate(10_000_000)
    opened(bench, b"recordings/" + large.name.encode())
    bench.send(asked(Opcode.BURST))
    per_round = len(bench.after(0.02))
    assert 5 <= per_round <= 40
    rest = [Reply(one) for one in bench.after(5.0)]
    assert rest[-1].is_last
    assert rest[-1].offset == (MAX_BURST - 1) * MAX_DATA


def test_checksum_of_a_large_file_takes_several_rounds(bench: ParameterBench, folder: Path) -> None:
    large = folder / "20261123T150000Z-r1.tlog"
    large.write_bytes(CONTENT * 2000)
    message = asked(Opcode.CHECKSUM, b"recordings/" + large.name.encode())
    assert of_type(bench.send(message), "FILE_TRANSFER_PROTOCOL") == []
    assert bench.after(0.02) == []
    (reply,) = (Reply(one) for one in bench.send(message) + bench.after(0.5))
    assert reply.data == checksum(CONTENT * 2000).to_bytes(4, "little")


def test_checksum_is_that_of_mavlink() -> None:
    assert checksum(b"123456789") == 0x2DFD2D88
    assert checksum(b"6789", checksum(b"12345")) == checksum(b"123456789")


def test_growing_recording_keeps_the_size_of_its_opening(
    bench: ParameterBench, folder: Path
) -> None:
    assert opened(bench) == len(CONTENT)
    with (folder / NAME).open("ab") as file:
        file.write(b"more")
    found = replies(bench, asked(Opcode.BURST, offset=len(CONTENT) - 3))
    assert [one.data for one in found] == [b"end"]


def test_repeated_opening_waits_for_the_robot(bench: ParameterBench) -> None:
    bench.is_answering = False
    pck = b"@PARAM/param.pck"
    for sequence in range(5):
        assert replies(bench, asked(Opcode.OPEN, pck, sequence=sequence)) == []
    bench.is_answering = True
    (reply,) = (Reply(one) for one in of_type(bench.answer_lists(), "FILE_TRANSFER_PROTOCOL"))
    assert (reply.opcode, reply.sequence) == (Opcode.ACK, 5)


def test_another_file_replaces_one_that_is_awaited(bench: ParameterBench) -> None:
    bench.is_answering = False
    assert replies(bench, asked(Opcode.OPEN, b"@PARAM/param.pck")) == []
    assert opened(bench) == len(CONTENT)
    bench.is_answering = True
    assert of_type(bench.answer_lists(), "FILE_TRANSFER_PROTOCOL") == []
    assert replies(bench, asked(Opcode.READ, size=9))[0].data == CONTENT[:9]


def test_silent_robot_fails_the_opening(bench: ParameterBench) -> None:
    bench.is_answering = False
    bench.send(asked(Opcode.OPEN, b"@PARAM/param.pck", session=4))
    bench.port.answer(error="r1 does not answer")
    found = [Reply(one) for one in of_type(bench.sent(), "FILE_TRANSFER_PROTOCOL")]
    assert failure(found) == Failure.FAIL
    assert found[0].session == 4


def test_random_payloads_raise_nothing(bench: ParameterBench) -> None:
    import random

    source = random.Random(7)
    for _ in range(3000):
        payload = bytearray(source.randbytes(251))
        payload[3] = source.choice([*range(17), 128, 129, payload[3]])
        payload[4] %= 241
        if source.random() < 0.5:
            payload[12 : 12 + len(PATH)] = PATH
        bench.receive(message_of(payload), CLIENT)
        if not source.randrange(100):
            bench.after(0.02)
    bench.face.forget(CLIENT.client)


def message_of(payload: bytearray) -> MavMessage:
    return mavlink.MAVLink_file_transfer_protocol_message(0, 0, 0, list(payload))


LONG_CONTENT = bytes(range(251)) * 300
ALL = len(SPECS) + 37


@pytest.fixture
def client_bench(tmp_path: Path) -> ParameterBench:
    (tmp_path / NAME).write_bytes(LONG_CONTENT)
    found = ParameterBench(tmp_path)
    found.values = {"d_obs_m": 0.45, "side": -1.0}
    return found


@pytest.mark.parametrize("block", [80, 110, 239])
def test_packed_parameters_with_defaults(
    client_bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    client = client_on(SimulatedLink(client_bench), monkeypatch, block)
    found = MAVFTP.ftp_param_decode(got(client, "@PARAM/param.pck?withdefaults=1"))
    assert found is not None
    values = {name.decode(): (value, kind) for name, value, kind in found.params}
    defaults = {name.decode(): value for name, value, _ in found.defaults or []}
    assert len(found.params) == len(values) == ALL
    assert values["D_OBS_M"][0] == pytest.approx(0.45)
    assert defaults["D_OBS_M"] == pytest.approx(0.3)
    assert (values["SIDE"], defaults["SIDE"]) == ((-1, 3), 1)
    assert values["RCMAP_YAW"] == (4, 3)


@pytest.mark.parametrize(
    ("query", "count"),
    [
        ("", ALL),
        ("?start=0&count=0", ALL),
        ("?start=5&count=10", 10),
        (f"?start={ALL - 1}", 1),
        ("?count=65534&withdefaults=0", ALL),
        ("?unknown=7", ALL),
    ],
)
def test_part_of_the_packed_parameters(
    client_bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, query: str, count: int
) -> None:
    client = client_on(SimulatedLink(client_bench), monkeypatch)
    found = MAVFTP.ftp_param_decode(got(client, "@PARAM/param.pck" + query))
    assert found is not None
    assert len(found.params) == count


@pytest.mark.parametrize(
    "query", [f"start={ALL}", "start=65535", "count=-1", "start=x", "withdefaults=2", "start="]
)
def test_selection_that_cannot_be_used_is_refused(
    client_bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, query: str
) -> None:
    client = client_on(SimulatedLink(client_bench), monkeypatch)
    client.cmd_get([f"@PARAM/param.pck?{query}"], callback=BytesIO)
    assert client.process_ftp_reply("OpenFileRO").error_code != FtpError.Success


def test_recording_is_downloaded_byte_for_byte(
    client_bench: ParameterBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = client_on(SimulatedLink(client_bench), monkeypatch, 239)
    (entry,) = client.cmd_list(["/recordings"]).directory_listing
    assert (entry.name, entry.size_b) == (NAME, len(LONG_CONTENT))
    assert got(client, f"/recordings/{entry.name}") == LONG_CONTENT
    (entry,) = client.cmd_list(["@MAV_LOG"]).directory_listing
    assert got(client, f"@MAV_LOG/{entry.name}") == LONG_CONTENT


@pytest.mark.parametrize("seed", range(5))
def test_recording_survives_the_loss_of_every_fifth_frame(
    client_bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    client = client_on(SimulatedLink(client_bench, 0.2, seed), monkeypatch, 239)
    assert got(client, f"/recordings/{NAME}") == LONG_CONTENT


@pytest.mark.parametrize("seed", range(20))
def test_parameters_survive_the_loss_of_every_fifth_frame(
    client_bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    link = SimulatedLink(client_bench, 0.2, seed)
    client = client_on(link, monkeypatch)
    ended_s: list[float] = []
    contents: list[bytes] = []

    def keep(file: BytesIO) -> None:
        contents.append(file.read())
        ended_s.append(link.time())

    began_s = link.time()
    client.cmd_get(["@PARAM/param.pck?withdefaults=1"], callback=keep)
    client.process_ftp_reply("OpenFileRO", timeout=60)
    found = MAVFTP.ftp_param_decode(contents[0])
    assert found is not None
    assert len(found.params) == ALL
    assert ended_s[0] - began_s <= 5.0


ROUND_NS = 20_000_000


def sent_in_10_s(line_bytes_s: int | None, size: int, pause_rounds: int = 1) -> int:
    pacing, sent = Pacing({1: line_bytes_s}), 0
    for number in range(0, 500, pause_rounds):
        while pacing.take(1, size, number * ROUND_NS):
            sent += size
    return sent


@each("size", [37, 122, 279])
def test_transfer_and_streams_fit_57600_baud(size: int) -> None:
    streams_bytes_s = 2948
    assert sent_in_10_s(5760, size) / 10 + streams_bytes_s <= 5000
    assert sent_in_10_s(5760, size) / 10 >= 1500


def test_line_without_a_limit_is_fast() -> None:
    assert sent_in_10_s(None, 279) / 10 == pytest.approx(FAST_BYTES_S, rel=0.03)


def test_calm_rounds_of_50_ms_lose_no_budget() -> None:
    assert sent_in_10_s(None, 279, 2) / 10 == pytest.approx(FAST_BYTES_S, rel=0.03)


def test_pause_saves_up_little() -> None:
    pacing = Pacing({})
    while pacing.take(1, 279, 0):
        pass
    sent = 0
    while pacing.take(1, 279, 3600 * 10**9):
        sent += 279
    assert sent <= FAST_BYTES_S * 0.07


def test_replies_are_sent_twice_on_a_lossy_line(bench: ParameterBench) -> None:
    """A copy has the sequence number of its reply, by which a client knows it."""
    bench.vehicle.lossy = {CLIENT.client}
    for message in (
        asked(Opcode.OPEN, PATH),
        asked(Opcode.BURST, size=80),
        asked(Opcode.TERMINATE),
    ):
        found = [vars(one) for one in replies(bench, message)]
        assert found[::2] == found[1::2]
        numbers = [one["sequence"] for one in found[::2]]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
