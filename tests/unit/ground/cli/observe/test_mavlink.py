"""`mavlink check`: its arguments, its exit codes, and its three forms of output."""

import json
import socket
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest

from ground.cli.main import main
from ground.cli.observe import mavlink
from runtime.errors import UserError
from tests.support.each import each
from tests.support.vehicle_check.broken import MuteVehicle
from tests.support.vehicle_check.core import Core
from tests.support.vehicle_check.good import GoodVehicle
from tests.support.vehicle_check.memory_network import MemoryNetwork
from vehicle_check import ground_stations as networks
from vehicle_check import judge
from vehicle_check.judge import CheckOutcome, Judged, rows
from vehicle_check.vehicle_under_test import (
    AcceptanceRow,
    Findings,
    RowVerdict,
    failed,
    not_applicable,
    not_tried,
    passed,
)

ENDPOINT = "udpout:127.0.0.1:14550"


def run(monkeypatch: pytest.MonkeyPatch, vehicle: Core | None, *words: str) -> int:
    network = MemoryNetwork() if vehicle is None else MemoryNetwork(vehicle)
    monkeypatch.setattr(networks, "SocketNetwork", lambda endpoint: network)
    code = main(["mavlink", "check", ENDPOINT, *words])
    assert network.is_closed
    return code


def test_exit_code_and_text_tell_whether_a_row_failed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, GoodVehicle(), "--rows", "9-10,41") == 0
    assert "3 rows: 3 pass" in capsys.readouterr().out
    assert run(monkeypatch, MuteVehicle(), "--rows", "9") == 1
    shown = capsys.readouterr().out
    assert "  9  fail " in shown
    assert "suffers: Mission Planner" in shown


def test_json_and_junit_hold_each_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "rows.xml"
    words = ["--rows", "10,38,59", "--json", "--junit", str(file)]
    assert run(monkeypatch, GoodVehicle(), *words) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["ok"], found["endpoint"]) == (True, ENDPOINT)
    states = [(one["row"], one["status"]) for one in found["rows"]]
    assert states == [(10, "pass"), (38, "not tried"), (59, "not applicable")]
    suite = ElementTree.parse(file).getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("3", "0", "2")


def test_no_vehicle_ends_with_1_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, None, "--rows", "1") == 1
    assert "no heartbeat of a MAVLink vehicle within 5 s" in capsys.readouterr().err


@each("text", ["0", "61", "1-", "a", "", "5-3", "1,,2"])
def test_rows_that_do_not_exist_are_refused(text: str) -> None:
    with pytest.raises(UserError, match="--rows"):
        mavlink.chosen_rows(rows(), text)


def test_rows_are_chosen_by_numbers_and_ranges() -> None:
    chosen = mavlink.chosen_rows(rows(), "1-3,19")
    assert sorted(row.number for row in chosen) == [1, 2, 3, 19]
    assert len(mavlink.chosen_rows(rows(), None)) == 60


@each(
    "words",
    [
        ["udpout:127.0.0.1"],
        ["serial:x:1"],
        ["udpout:h:70000"],
        [ENDPOINT, "--loss", "2"],
        [ENDPOINT, "--signing-key", "/no/such/file"],
        [ENDPOINT, "--junit", "/no/such/folder/x.xml"],
    ],
)
def test_wrong_usage_ends_with_2(words: list[str]) -> None:
    assert main(["mavlink", "check", *words]) == 2


def test_junit_file_that_is_a_folder_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mavlink", "check", ENDPOINT, "--junit", str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_result_is_shown_even_if_the_junit_file_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(mavlink, "expect_writable", lambda path: None)
    assert run(monkeypatch, GoodVehicle(), "--rows", "9", "--junit", str(tmp_path)) == 2
    shown = capsys.readouterr()
    assert "1 rows: 1 pass" in shown.out
    assert "--junit" in shown.err


def test_interrupted_check_says_what_it_has_put_back(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupting(GoodVehicle):
        def on_mission_count(self, message: object, peer: object) -> None:
            raise KeyboardInterrupt

    assert run(monkeypatch, Interrupting(), "--rows", "28") == 130
    shown = capsys.readouterr().err
    assert "put back: mission, mode 4" in shown
    assert "interrupted" in shown


def test_refused_connection_ends_with_1(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert main(["mavlink", "check", f"tcp:127.0.0.1:{port}"]) == 1
    assert "refused" in capsys.readouterr().err


def judged(*verdicts: RowVerdict) -> Sequence[Judged]:
    return [
        Judged(
            AcceptanceRow(number, f"title {number}", "everyone", lambda check: passed("")), verdict
        )
        for number, verdict in enumerate(verdicts, start=1)
    ]


def test_control_characters_of_the_vehicle_are_not_printed() -> None:
    found = judged(failed("a\x1b[2Jb\x00"))
    assert "\x1b" not in judge.as_text(CheckOutcome(list(found), [], []))
    case = ElementTree.fromstring(judge.as_junit("x", found)).find("testcase/failure")
    assert case is not None
    assert case.get("message") == "a?[2Jb?"


def test_summary_counts_each_kind() -> None:
    found = judged(passed(""), failed(""), not_tried(""), not_applicable(""), passed(""))
    assert judge.summary(found) == "5 rows: 2 pass, 1 fail, 1 not applicable, 1 not tried"
    assert not judge.is_good(found)


def test_one_fault_makes_findings_fail() -> None:
    found = Findings()
    found.expect(True, "right")
    assert found.verdict() == passed("right")
    found.expect(False, "wrong")
    assert found.verdict() == failed("wrong")


def test_udp_and_tcp_carry_bytes_both_ways() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        network = networks.SocketNetwork(f"tcp:127.0.0.1:{server.getsockname()[1]}")
        peer = network.open()
        accepted, _ = server.accept()
        with accepted:
            network.send(peer, b"ping")
            assert accepted.recv(10) == b"ping"
            accepted.sendall(b"pong")
            (heard,) = network.receive(network.now_ns() + 2_000_000_000)
        assert (heard.peer, heard.data) == (peer, b"pong")
        network.close()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        network = networks.SocketNetwork(f"udpout:127.0.0.1:{vehicle.getsockname()[1]}")
        network.send(network.open(), b"ping")
        data, address = vehicle.recvfrom(10)
        vehicle.sendto(b"pong", address)
        (heard,) = network.receive(network.now_ns() + 2_000_000_000)
        assert (data, heard.data) == (b"ping", b"pong")
        network.close()
