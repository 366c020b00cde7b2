"""The judge of MAVLink vehicles: good, broken and hostile ones, and `mavlink check`."""

import json
import os
import selectors
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from threading import Event, Thread
from typing import Any
from xml.etree import ElementTree

import pytest

from ground.cli.main import main
from ground.cli.observe import mavlink
from runtime.errors import RemoteError, UserError
from tests.support.each import each
from tests.support.vehicle_check.broken import (
    ArduPilotLike,
    CarelessVehicle,
    GarbageVehicle,
    HastyVehicle,
    MuteVehicle,
    OneConnection,
    StaleVehicle,
    YesVehicle,
)
from tests.support.vehicle_check.core import Core, MemoryNetwork, Peer
from tests.support.vehicle_check.good import GoodVehicle, SigningVehicle
from tests.support.vehicle_check.reports import FOLDER, VEHICLES, report, statuses
from vehicle_check import judge as vehicle_check_judge
from vehicle_check import networks
from vehicle_check.judge import CheckOutcome, Judged, judge, rows
from vehicle_check.mavlink_frames import CURRENT_MODE, ExtraMessage
from vehicle_check.mavlink_frames import mavlink as mav
from vehicle_check.vehicle_under_test import (
    AcceptanceRow,
    CheckOptions,
    Findings,
    RowStatus,
    RowVerdict,
    VehicleCheck,
    VehicleProfile,
    failed,
    not_applicable,
    not_tried,
    passed,
)

KEY = SigningVehicle.key
NUMBERS = list(range(1, 73))
SIGNED = [51, 52, 53, 54]
BROKEN = (MuteVehicle, CarelessVehicle, YesVehicle)


class DyingVehicle(GoodVehicle):
    """Ends as soon as a mission is announced."""

    is_dead = False

    def on_mission_count(self, message: Any, peer: Peer) -> None:
        """Die."""
        self.is_dead = True

    def send(self, message: Any, peer: Peer | None = None) -> None:
        """Send nothing any more."""
        if not self.is_dead:
            super().send(message, peer)


class RepeatingVehicle(GoodVehicle):
    """Sends each answer to a command twice."""

    def acknowledge(self, number: int, result: int, peer: Peer) -> None:
        """Send the answer twice."""
        super().acknowledge(number, result, peer)
        super().acknowledge(number, result, peer)


class LateVehicle(GoodVehicle):
    """Sends the blocks of the log that were requested before once more."""

    asked: Any = None

    def on_log_request_data(self, message: Any, peer: Peer) -> None:
        """Send the blocks of the request before, if it was about another part."""
        before, self.asked = self.asked, message
        if before is not None and before.ofs != message.ofs:
            super().on_log_request_data(before, peer)
            return
        super().on_log_request_data(message, peer)


class CopyingVehicle(GoodVehicle):
    """Repeats the acceptance of an upload for a while, as long as the client sends no other."""

    copies: tuple[tuple[int, Peer, int], ...] = ()

    def ack(self, peer: Peer, kind: int, result: int) -> None:
        """Send the answer, and note the times of its copies."""
        super().ack(peer, kind, result)
        if result == 0:
            self.copies += tuple((self.now_ns + ms * 1_000_000, peer, kind) for ms in (500, 1400))

    def on_mission_count(self, message: Any, peer: Peer) -> None:
        """Send no more copies to this client."""
        self.copies = tuple(one for one in self.copies if one[1] is not peer)
        super().on_mission_count(message, peer)

    def due(self, now_ns: int) -> None:
        """Send the copies that are due."""
        super().due(now_ns)
        for at_ns, peer, kind in self.copies:
            if at_ns <= now_ns and self.upload is None:
                super().ack(peer, kind, 0)
        self.copies = tuple(one for one in self.copies if one[0] > now_ns)


class SecondVehicle(CarelessVehicle):
    """A careless vehicle with another number at the same port."""

    system = 2


def judged(*vehicles: Core, numbers: list[int] | None = None, **options: object) -> list[Judged]:
    """Judge vehicles with all options by default."""
    choices = CheckOptions(allow_motion=True, key=KEY)._replace(**options)  # type: ignore[arg-type]
    chosen = [row for number, row in rows().items() if numbers is None or number in numbers]
    return judge(MemoryNetwork(*vehicles), choices, chosen).rows


def by_number(found: list[Judged]) -> dict[int, RowVerdict]:
    return {one.row.number: one.verdict for one in found}


@cache
def verdicts_of(kind: type[Core]) -> dict[int, RowVerdict]:
    return by_number(judged(kind()))


@cache
def verdicts_of_signed_rows(kind: type[Core]) -> dict[int, RowVerdict]:
    return by_number(judged(kind(), numbers=SIGNED))


@cache
def verdicts_of_a_careless_pair() -> dict[int, RowVerdict]:
    return by_number(judged(CarelessVehicle(), SecondVehicle(), numbers=[53, 59]))


def test_every_row_of_the_list_is_judged() -> None:
    assert sorted(rows()) == NUMBERS


@each("number", NUMBERS)
def test_good_vehicle_passes_each_row(number: int) -> None:
    verdict = verdicts_of(SigningVehicle)[number]
    wanted = RowStatus.NOT_APPLICABLE if number == 59 else RowStatus.PASS
    assert verdict.status is wanted, verdict.evidence


@each("number", NUMBERS[:60])
def test_each_row_fails_on_a_broken_vehicle(number: int) -> None:
    found = [statuses(report(name))[number] for name in ("mute", "careless")]
    if number == 59:
        found.append(verdicts_of_a_careless_pair()[number].status)
    if number in SIGNED:
        found = [verdicts_of_signed_rows(kind)[number].status for kind in BROKEN]
    if RowStatus.FAIL not in found:
        found.append(verdicts_of(YesVehicle)[number].status)
    assert RowStatus.FAIL in found, found


@each(
    ("number", "words"),
    [
        (61, "acknowledgements of"),
        (62, "not in the dialect of pymavlink: ['CONTROL_STATUS']"),
        (63, "mask 2040 moved 0.00 m 'set the bits of type_mask"),
        (64, "NOT_IN_CONTROL after 3.00 s; text 'another operator"),
        (65, "SPEED_X 0.4 -> 0.137"),
        (66, "armed again ACCEPTED: armed False"),
        (67, "RADIUS_X read by client 1: 0.5, in force 0.505"),
        (68, "altitude 10 -> 0"),
        (69, "samples at rest"),
        (70, "mode 0: base_mode 0x01; mode 15: base_mode 0x01"),
        (71, "NAV_CONTROLLER_OUTPUT: not sent"),
        (72, "upload: UNSUPPORTED"),
    ],
)
def test_row_finds_the_defect_of_a_hasty_vehicle(number: int, words: str) -> None:
    vehicle = StaleVehicle() if number == 66 else HastyVehicle()
    (found,) = judged(vehicle, numbers=[number], key=None)
    assert found.verdict.status is RowStatus.FAIL
    assert words in found.verdict.evidence


def test_two_good_robots_pass_row_59() -> None:
    class Second(SigningVehicle):
        system = 2

    found = by_number(judged(SigningVehicle(), Second(), numbers=[59]))
    assert found[59].status is RowStatus.PASS


def test_without_motion_the_vehicle_is_never_armed() -> None:
    class Watched(GoodVehicle):
        was_armed = False

        def command_400(self, params: list[float], peer: object) -> int:
            self.was_armed = True
            return super().command_400(params, peer)  # type: ignore[arg-type]

    vehicle = Watched()
    network = MemoryNetwork(vehicle)
    started_ns = network.now_ns()
    found = by_number(judge(network, CheckOptions(), list(rows().values())).rows)
    assert not vehicle.was_armed
    assert (vehicle.x, vehicle.y) == (0.0, 0.0)
    assert {number for number, one in found.items() if one.status is RowStatus.NOT_TRIED} == {
        *(38, 44, 45, 46, 47, 63, 69, 71),
        *(51, 52, 53, 54),
    }
    assert RowStatus.FAIL not in {one.status for one in found.values()}
    assert (network.now_ns() - started_ns) / 1e9 <= 120


def test_own_plans_and_mode_are_restored() -> None:
    vehicle = GoodVehicle()
    item = ((3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0), (-353_632_600, 1_491_652_300), 0.0)
    vehicle.plans[0] = [item, item]
    judge(MemoryNetwork(vehicle), CheckOptions(), [rows()[number] for number in (1, 28, 34)])
    assert [one[1] for one in vehicle.plans[0]][1:] == [item[1]]
    assert vehicle.plans[1] == []
    assert vehicle.mode == 4


@pytest.mark.sweep(3)
@pytest.mark.parametrize("first", range(3))
def test_garbage_among_the_frames_never_ends_the_judge(first: int) -> None:
    found = judged(GarbageVehicle(), numbers=NUMBERS[first::3], key=None)
    assert [one.row.number for one in found] == NUMBERS[first::3]


def test_no_vehicle_is_an_error_within_seconds() -> None:
    network = MemoryNetwork()
    with pytest.raises(RemoteError, match="no heartbeat"):
        judge(network, CheckOptions(), list(rows().values()))
    assert network.now_ns() <= 7e9


@pytest.mark.sweep(3)
@pytest.mark.parametrize("numbers", [NUMBERS[1::3], NUMBERS[0::3], NUMBERS[2::3]], ids=str)
def test_rows_pass_while_the_judge_drops_a_fifth_of_the_frames(numbers: list[int]) -> None:
    found = by_number(judged(SigningVehicle(), numbers=numbers, loss=0.2))
    wrong = {number: one for number, one in found.items() if one.status is not RowStatus.PASS}
    assert list(wrong) == [number for number in numbers if number == 59], wrong


@each("loss", [0.0, 0.2])
def test_vehicle_that_answers_twice_fails(loss: float) -> None:
    (found,) = judged(RepeatingVehicle(), numbers=[43], key=None, loss=loss)
    assert found.verdict.status is RowStatus.FAIL, found.verdict


@pytest.mark.sweep(4)
@pytest.mark.parametrize("seed", range(1, 9))
def test_copies_of_an_acceptance_do_not_count(seed: int) -> None:
    numbers = [27, 28, 29, 30]
    found = by_number(judged(CopyingVehicle(), numbers=numbers, key=None, loss=0.2, seed=seed))
    wrong = {number: one for number, one in found.items() if one.status is not RowStatus.PASS}
    assert not wrong


def test_late_blocks_of_another_part_of_a_log_do_not_count() -> None:
    (found,) = judged(LateVehicle(), numbers=[49], key=None, allow_motion=False, loss=0.2)
    assert found.verdict.status is RowStatus.PASS, found.verdict


@each("name", VEHICLES)
def test_reports_in_the_tree_are_those_of_the_vehicles(name: str) -> None:
    kept = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert statuses(kept) == statuses(report(name)), "python -m tests.support.vehicle_check.reports"


def test_ardupilot_fails_no_row() -> None:
    found = report("ardupilot-like")["rows"]
    wrong = [one for one in found if one["status"] == "fail"]
    assert not wrong
    reasons = {one["row"]: one["evidence"] for one in found if one["status"] == "not applicable"}
    assert sorted(reasons) == [10, 13, 15, 16, 17, 23, 24, 55, 56, 57, 59], reasons
    assert all(reasons.values())


def test_parameters_of_ardupilot_are_not_changed() -> None:
    vehicle = ArduPilotLike()
    judged(vehicle, numbers=[22], key=None)
    assert vehicle.values["RC1_MIN"] == 1000.0


def test_endpoint_for_one_client_fails_only_the_row_about_it() -> None:
    found = by_number(judged(OneConnection(), key=None))
    wrong = {number: one for number, one in found.items() if one.status is RowStatus.FAIL}
    assert list(wrong) == [6], wrong
    assert found[32].evidence == "this endpoint serves one ground station"


def test_vehicle_that_falls_silent_ends_the_check() -> None:
    vehicle = DyingVehicle()
    network = MemoryNetwork(vehicle)
    chosen = [rows()[number] for number in (1, 9, 28, 34, 41)]
    outcome = judge(network, CheckOptions(), chosen)
    found = by_number(outcome.rows)
    assert found[1].status is RowStatus.PASS
    assert found[28].status is RowStatus.FAIL
    assert found[28].evidence.startswith("the vehicle fell silent; ")
    for number in (34, 41):
        assert found[number] == (RowStatus.NOT_TRIED, "the vehicle is silent since row 28")
    assert outcome.restored == []
    assert outcome.not_restored == ["mission", "mode 4"]
    assert network.now_ns() < 60e9


def test_interrupted_check_puts_back_the_plans() -> None:
    vehicle = GoodVehicle()
    item = ((3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0), (-353_632_600, 1_491_652_300), 0.0)
    vehicle.plans[0] = [item, item]

    def interrupt(text: str) -> None:
        if text.startswith("row 34"):
            raise KeyboardInterrupt

    chosen = [rows()[number] for number in (28, 34)]
    with pytest.raises(KeyboardInterrupt) as caught:
        judge(MemoryNetwork(vehicle), CheckOptions(), chosen, interrupt)
    assert [one[1] for one in vehicle.plans[0]][1:] == [item[1]]
    assert caught.value.__notes__ == ["put back: mission, mode 4"]


def test_plan_that_cannot_be_downloaded_is_not_replaced() -> None:
    class Unreadable(GoodVehicle):
        def on_mission_request_list(self, message: Any, peer: Peer) -> None:
            """Answer nothing."""

    vehicle = Unreadable()
    item = ((3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0), (-353_632_600, 1_491_652_300), 0.0)
    vehicle.plans[0] = [item, item]
    outcome = judge(MemoryNetwork(vehicle), CheckOptions(), [rows()[number] for number in (28, 34)])
    assert {one.verdict.status for one in outcome.rows} == {RowStatus.FAIL}
    assert vehicle.plans[0] == [item, item]
    assert outcome.restored == ["mode 4"]


@each("closed", [176, 193, 400, 185])
def test_vehicle_that_only_its_owner_may_stop_fails(closed: int) -> None:
    class Closed(GoodVehicle):
        def only_stops(self, number: int, params: list[float]) -> bool:
            """Do not let others use one of the commands."""
            return number != closed and super().only_stops(number, params)

    outcome = judge(MemoryNetwork(Closed()), CheckOptions(allow_motion=True), [rows()[57]])
    (found,) = outcome.rows
    assert found.verdict.status is RowStatus.FAIL
    assert "of another: NOT_IN_CONTROL" in found.verdict.evidence


def test_interrupted_row_leaves_the_vehicle_disarmed_and_not_stopped() -> None:
    class Interrupting(GoodVehicle):
        def command_185(self, params: list[float], peer: Peer) -> int:
            result = super().command_185(params, peer)
            if params[0] == 1:
                self.is_armed = True
                raise KeyboardInterrupt
            return result

    vehicle = Interrupting()
    with pytest.raises(KeyboardInterrupt):
        judge(MemoryNetwork(vehicle), CheckOptions(allow_motion=True), [rows()[2]])
    assert not vehicle.is_armed
    assert not vehicle.is_stopped


ENDPOINT = "udpout:127.0.0.1:14550"


def run(monkeypatch: pytest.MonkeyPatch, vehicle: Core | None, *words: str) -> int:
    network = MemoryNetwork() if vehicle is None else MemoryNetwork(vehicle)
    monkeypatch.setattr(networks, "network_of", lambda endpoint: network)
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


@each("text", ["0", "73", "1-", "a", "", "5-3", "1,,2"])
def test_rows_that_do_not_exist_are_refused(text: str) -> None:
    with pytest.raises(UserError, match="--rows"):
        mavlink.chosen_rows(rows(), text)


def test_rows_are_chosen_by_numbers_and_ranges() -> None:
    chosen = mavlink.chosen_rows(rows(), "1-3,19")
    assert sorted(row.number for row in chosen) == [1, 2, 3, 19]
    assert len(mavlink.chosen_rows(rows(), None)) == 72


@each(
    "words",
    [
        ["udpout:127.0.0.1"],
        ["serial:x:1"],
        [ENDPOINT, "--limit", "0"],
        [ENDPOINT, "--as", "px4", "--allow-motion"],
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


def judged_by_verb(*verdicts: RowVerdict) -> Sequence[Judged]:
    return [
        Judged(
            AcceptanceRow(number, f"title {number}", "all", lambda check: passed(""), "a book"),
            verdict,
        )
        for number, verdict in enumerate(verdicts, start=1)
    ]


def test_control_characters_of_the_vehicle_are_not_printed() -> None:
    found = judged_by_verb(failed("a\x1b[2Jb\x00"))
    assert "\x1b" not in vehicle_check_judge.as_text(CheckOutcome(list(found), [], []))
    case = ElementTree.fromstring(vehicle_check_judge.as_junit("x", found)).find("testcase/failure")
    assert case is not None
    assert case.get("message") == "a?[2Jb?"


def test_summary_counts_each_kind() -> None:
    found = judged_by_verb(passed(""), failed(""), not_tried(""), not_applicable(""), passed(""))
    assert (
        vehicle_check_judge.summary(found)
        == "5 rows: 2 pass, 1 fail, 1 not applicable, 1 not tried"
    )
    assert not vehicle_check_judge.is_good(found)


def test_one_fault_makes_findings_fail() -> None:
    found = Findings()
    found.expect(True, "right")
    assert found.verdict() == passed("right")
    found.expect(False, "wrong")
    assert found.verdict() == failed("wrong")


def test_udp_and_tcp_carry_bytes_both_ways() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        network = networks.network_of(f"tcp:127.0.0.1:{server.getsockname()[1]}")
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
        network = networks.network_of(f"udpout:127.0.0.1:{vehicle.getsockname()[1]}")
        network.send(network.open(), b"ping")
        data, address = vehicle.recvfrom(10)
        vehicle.sendto(b"pong", address)
        (heard,) = network.receive(network.now_ns() + 2_000_000_000)
        assert (data, heard.data) == (b"ping", b"pong")
        network.close()


def test_every_row_is_judged_on_a_vehicle_that_answers_nothing() -> None:
    found = statuses(report("mute"))
    needs_key = [number for number, status in found.items() if status == "not tried"]
    assert needs_key == [51, 52, 53, 54]
    passes = [number for number, status in found.items() if status == "pass"]
    assert passes == [3, 5, 62], "it has no other components, and no gaps"


def test_row_that_never_ends_costs_its_own_time_only() -> None:
    def endless(check: VehicleCheck) -> RowVerdict:
        while True:
            check.station.wait(1.0)

    network = MemoryNetwork(GoodVehicle())
    one = AcceptanceRow(90, "never ends", "all", endless, "a book")
    found = by_number(judge(network, CheckOptions(), [one, rows()[9]]).rows)
    assert found[90] == failed("not finished in 120 s")
    assert found[9].status is RowStatus.PASS
    assert network.now_ns() < 140e9


def test_rows_behind_the_limit_are_not_tried() -> None:
    chosen = [rows()[number] for number in (5, 27, 28)]
    network = MemoryNetwork(GoodVehicle())
    found = by_number(judge(network, CheckOptions(limit_s=16), chosen).rows)
    assert found[5].status is RowStatus.PASS
    assert found[27] == found[28] == not_tried("the time of the check was over: --limit 16")
    assert network.now_ns() < 25e9


class BusyMachine(MemoryNetwork):
    """A network on a machine that is always busy with other things."""

    is_loopback = True
    is_busy = True

    @property
    def held_up_ns(self) -> int:  # type: ignore[override]
        """All of the time."""
        return self.now_ns() if self.is_busy else 0


class SlowVehicle(GoodVehicle):
    """Takes long for plans and files, and stops its streams while it is flooded."""

    until_ns = 0
    waiting: tuple[tuple[int, Callable[[], None]], ...] = ()

    def on_mission_request_list(self, message: Any, peer: Peer) -> None:
        """Answer late."""
        answer = partial(super().on_mission_request_list, message, peer)
        self.waiting += ((self.now_ns + 900_000_000, answer),)

    def on_file_transfer_protocol(self, message: Any, peer: Peer) -> None:
        """Answer late."""
        answer = partial(super().on_file_transfer_protocol, message, peer)
        self.waiting += ((self.now_ns + 200_000_000, answer),)

    def receive(self, peer: int, data: bytes, now_ns: int) -> None:
        """Notice a flood."""
        if data[7:10] == b"\xf0\xff\x7f":
            self.until_ns = now_ns + 500_000_000
        super().receive(peer, data, now_ns)

    def due(self, now_ns: int) -> None:
        """Send what is due."""
        for at_ns, answer in self.waiting:
            if at_ns <= now_ns:
                answer()
        self.waiting = tuple(one for one in self.waiting if one[0] > now_ns)
        super().due(now_ns)

    def stream(self, name: str, peer: Peer | None) -> bool:
        """Stop in a flood."""
        return self.now_ns >= self.until_ns and super().stream(name, peer)


@each("number", [58, 60])
def test_load_of_the_own_machine_is_not_charged(number: int) -> None:
    def verdict(network: MemoryNetwork) -> RowVerdict:
        return judge(network, CheckOptions(), [rows()[number]]).rows[0].verdict

    idle = BusyMachine(SlowVehicle())
    idle.is_busy = False
    assert verdict(idle).status is RowStatus.FAIL
    found = verdict(BusyMachine(SlowVehicle()))
    assert found.status is RowStatus.UNCERTAIN
    assert "this machine was busy for" in found.evidence
    assert verdict(BusyMachine(GoodVehicle())).status is RowStatus.PASS


class Approaching(GoodVehicle):
    """Drives at a wall; its DISTANCE_SENSOR shows the wall as it was some seconds ago."""

    late_s = 0.0

    def distance_cm(self, late_s: float) -> int:
        """The distance to the wall."""
        return 299 - round(10 * (self.now_ns / 1e9 - late_s) % 200)

    def build_obstacle_distance(self) -> Any:
        """Show the wall everywhere."""
        message = super().build_obstacle_distance()
        message.distances[:8] = [self.distance_cm(0.0)] * 8
        return message

    def build_distance_sensor(self) -> Any:
        """Show the wall in each direction."""
        messages = super().build_distance_sensor()
        for one in messages:
            one.current_distance = self.distance_cm(self.late_s)
        return messages


class ApproachingLate(Approaching):
    """Shows the wall five seconds late."""

    late_s = 5.0


@each(("kind", "status"), [(Approaching, RowStatus.PASS), (ApproachingLate, RowStatus.FAIL)])
def test_row_16_compares_readings_of_one_time(kind: type[GoodVehicle], status: RowStatus) -> None:
    (found,) = judged(kind(), numbers=[16], key=None)
    assert found.verdict.status is status, found.verdict


class Px4Like(GoodVehicle):
    """Sends the heartbeat and the modes of PX4, and knows nothing of ArduPilot's own protocols."""

    def build_heartbeat(self) -> Any:
        """Be a copter of PX4 in the mode HOLD."""
        return mav.MAVLink_heartbeat_message(2, 12, 1 | 80, 50_593_792, 3, 3)

    def file(self, path: str) -> bytes | None:
        """Have no file of parameters."""
        return None if path.startswith("@PARAM") else super().file(path)

    def build_current_mode(self) -> Any:
        """Be in the mode of the heartbeat."""
        return ExtraMessage(CURRENT_MODE, custom_mode=50_593_792)

    def ask(self) -> None:
        """Ask for items by MISSION_REQUEST_INT only."""
        before = len(self.sends)
        super().ask()
        peer, upload = self.upload.peer, self.upload  # type: ignore[union-attr]
        del self.sends[before:]
        self.send(mav.MAVLink_mission_request_int_message(255, 190, upload.next, upload.kind), peer)  # type: ignore[union-attr]

    def command_401(self, params: list[float], peer: Peer) -> int:
        """Run no checks on request."""
        return 3

    command_410 = command_520 = command_42428 = command_193 = command_176 = command_401


def test_px4_is_not_judged_by_the_rules_of_ardupilot() -> None:
    vehicle = Px4Like()
    found = by_number(judged(vehicle, key=None, allow_motion=False, profile=VehicleProfile.PX4))
    wrong = {number: one for number, one in found.items() if one.status is RowStatus.FAIL}
    assert not wrong
    assert found[8].evidence.startswith("not for px4: it follows DroneKit")
    assert sum(one.status is RowStatus.PASS for one in found.values()) >= 25
    row_1 = judged(Px4Like(), numbers=[1], key=None, allow_motion=False)[0].verdict
    assert row_1.status is RowStatus.FAIL
    assert "judge it with --as px4" in row_1.evidence


def test_each_row_names_its_source_and_a_rover_follows_all() -> None:
    assert all(row.source and VehicleProfile.ROVER in row.profiles for row in rows().values())
    assert list(mavlink.PROFILES) == list(VehicleProfile)
    counts = [sum(one in row.profiles for row in rows().values()) for one in VehicleProfile]
    assert counts == sorted(counts, reverse=True)


def test_reports_are_compared_row_by_row(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def report(name: str, vehicle: Core) -> str:
        run(monkeypatch, vehicle, "--rows", "5,9,28", "--json")
        path = tmp_path / name
        path.write_text(capsys.readouterr().out, encoding="utf-8")
        return str(path)

    good, careless = report("good", GoodVehicle()), report("careless", CarelessVehicle())
    assert main(["mavlink", "compare", careless, good]) == 0
    assert "  5  fail -> pass" in (shown := capsys.readouterr().out)
    assert "0 worse, 1 better, 0 other, 2 the same" in shown
    assert main(["mavlink", "compare", good, careless, "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert [(one["row"], one["after"]) for one in found["changes"]] == [(5, "fail")]
    assert main(["mavlink", "compare", good, __file__]) == 2
    assert "is no report of the judge" in capsys.readouterr().err


def test_vehicle_on_a_serial_line_is_judged() -> None:
    vehicle, (host, line) = GoodVehicle(), os.openpty()
    os.set_blocking(host, False)
    network = networks.network_of(f"serial:{os.ttyname(line)}:57600")
    is_over = Event()

    def serve() -> None:
        selector = selectors.DefaultSelector()
        selector.register(host, selectors.EVENT_READ)
        while not is_over.is_set():
            if selector.select(0.01):
                vehicle.receive(0, os.read(host, 4096), network.now_ns())
            vehicle.due(network.now_ns())
            sends, vehicle.sends = vehicle.sends, []
            with suppress(BlockingIOError):
                os.write(host, b"".join(data for _, data in sends))

    thread = Thread(target=serve)
    thread.start()
    try:
        chosen = [rows()[number] for number in (4, 9, 41, 43)]
        found = by_number(judge(network, CheckOptions(), [rows()[6], *chosen]).rows)
    finally:
        is_over.set()
        thread.join()
        network.close()
        os.close(host)
        os.close(line)
    assert found.pop(6).status is RowStatus.NOT_APPLICABLE
    assert {one.status for one in found.values()} == {RowStatus.PASS}, found


@each(
    ("endpoint", "words"),
    [
        ("serial:/dev/no_such_line:57600", "no such device"),
        ("serial:/dev/null:57600", "not a serial line"),
        ("serial:/dev/null:12345", "baud is not possible"),
    ],
)
def test_line_that_cannot_be_opened_is_named(endpoint: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        networks.network_of(endpoint)


def test_load_is_read_from_the_system_or_is_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pressure, delay = tmp_path / "pressure", tmp_path / "schedstat"
    monkeypatch.setattr(networks, "PRESSURE", pressure)
    monkeypatch.setattr(networks, "RUN_DELAY", delay)
    assert [networks.waited_ns(anywhere=one) for one in (True, False)] == [0, 0]
    pressure.write_text(
        "some avg10=70.34 avg60=5.00 avg300=4.00 total=1234\nfull avg10=0 total=9\n"
    )
    delay.write_text("10 5678 3\n")
    assert [networks.waited_ns(anywhere=one) for one in (True, False)] == [1_234_000, 5678]
