"""The judge on vehicles of its own: a good one, three broken ones, and a hostile one."""

from functools import cache
from typing import Any

import pytest

from runtime.errors import RemoteError
from tests.support.each import each
from tests.support.vehicle_check.ardupilot import ArduPilotLike, OneConnection
from tests.support.vehicle_check.broken import (
    CarelessVehicle,
    GarbageVehicle,
    MuteVehicle,
    YesVehicle,
)  # fmt: skip
from tests.support.vehicle_check.core import Core, Peer
from tests.support.vehicle_check.good import GoodVehicle, SigningVehicle
from tests.support.vehicle_check.memory_network import MemoryNetwork
from vehicle_check.judge import Judged, judge, rows
from vehicle_check.vehicle_under_test import CheckOptions, RowStatus, RowVerdict

KEY = SigningVehicle.key
NUMBERS = list(range(1, 61))
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

    second_result_is_another = False

    def acknowledge(self, number: int, result: int, peer: Peer) -> None:
        """Send the answer, and the same or another one."""
        super().acknowledge(number, result, peer)
        super().acknowledge(number, 4 if self.second_result_is_another else result, peer)


class DoubtfulVehicle(RepeatingVehicle):
    """Sends two results of each command."""

    second_result_is_another = True


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
def verdicts_of_a_careless_pair() -> dict[int, RowVerdict]:
    return by_number(judged(CarelessVehicle(), SecondVehicle(), numbers=[53, 59]))


def test_every_row_of_the_list_is_judged() -> None:
    assert sorted(rows()) == NUMBERS


@each("number", NUMBERS)
def test_good_vehicle_passes_each_row(number: int) -> None:
    verdict = verdicts_of(SigningVehicle)[number]
    wanted = RowStatus.NOT_APPLICABLE if number == 59 else RowStatus.PASS
    assert verdict.status is wanted, verdict.evidence


@each("number", NUMBERS)
def test_each_row_fails_on_a_broken_vehicle(number: int) -> None:
    found = [verdicts_of(kind)[number] for kind in BROKEN]
    if number == 59:
        found.append(verdicts_of_a_careless_pair()[number])
    assert RowStatus.FAIL in [one.status for one in found], found


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
        *(38, 44, 45, 46, 47),
        *(51, 52, 53, 54),
    }
    assert RowStatus.FAIL not in {one.status for one in found.values()}
    assert (network.now_ns() - started_ns) / 1e9 <= 90


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


@each(
    ("kind", "loss", "status"),
    [
        (RepeatingVehicle, 0.0, RowStatus.FAIL),
        (RepeatingVehicle, 0.2, RowStatus.PASS),
        (DoubtfulVehicle, 0.2, RowStatus.FAIL),
    ],
)
def test_same_answer_may_be_sent_twice_on_a_lossy_line(
    kind: type[GoodVehicle], loss: float, status: RowStatus
) -> None:
    (found,) = judged(kind(), numbers=[43], key=None, loss=loss)
    assert found.verdict.status is status, found.verdict


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


def test_ardupilot_fails_only_what_it_lacks() -> None:
    vehicle = ArduPilotLike()
    found = by_number(judged(vehicle, key=None))
    wrong = {number: one for number, one in found.items() if one.status is RowStatus.FAIL}
    assert list(wrong) == [23], wrong
    reasons = {
        n: one.evidence for n, one in found.items() if one.status is RowStatus.NOT_APPLICABLE
    }
    assert sorted(reasons) == [10, 15, 16, 17, 24, 55, 56, 57, 59], reasons
    assert all(reasons.values())
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
