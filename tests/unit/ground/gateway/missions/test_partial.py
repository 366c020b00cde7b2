import pytest

from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from tests.support.gateway.messages import words
from tests.support.gateway.mission_bench import (
    MISSION,
    RALLY,
    MissionBench,
    item_int,
    line_of,
    of_type,
    upload,
)

ACCEPTED, ERROR, UNSUPPORTED, DENIED = 0, 1, 3, 14
STEP_M = 11.1178


@pytest.fixture
def bench() -> MissionBench:
    bench = MissionBench()
    upload(bench, line_of(4))
    return bench


def write(first: int, last: int, kind: int = MISSION) -> MavMessage:
    return mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, kind)


def requested(messages: list[MavMessage]) -> list[int]:
    return [one.seq for one in of_type(messages, "MISSION_REQUEST")]


def norths(bench: MissionBench) -> list[float]:
    return [round(waypoint.y_m / STEP_M, 1) for waypoint in bench.waypoints]


def test_partial_write_replaces_items(bench: MissionBench) -> None:
    assert requested(bench.send(write(2, 3))) == [2]
    assert requested(bench.send(item_int(2, 7000))) == [3]
    (ack,) = of_type(bench.send(item_int(3, 8000)), "MISSION_ACK")
    assert ack.type == ACCEPTED
    assert norths(bench) == [1.0, 7.0, 8.0, 4.0]


def test_partial_write_of_home_changes_nothing(bench: MissionBench) -> None:
    bench.send(write(0, 0))
    bench.send(item_int(0, 5000))
    assert norths(bench) == [1.0, 2.0, 3.0, 4.0]


def test_range_behind_the_last_item_is_cut(bench: MissionBench) -> None:
    bench.send(write(4, 5))
    assert of_type(bench.send(item_int(4, 9000)), "MISSION_ACK")[0].type == ACCEPTED
    assert norths(bench) == [1.0, 2.0, 3.0, 9.0]


@pytest.mark.parametrize("span", [(5, 5), (3, 2), (-1, 2), (0, 6), (-5, -1), (0, 32_767)])
def test_range_that_does_not_exist_is_refused(bench: MissionBench, span: tuple[int, int]) -> None:
    sent = bench.send(write(*span))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [ERROR]
    assert words(sent) == f"mission: there are no items {span[0]} to {span[1]}"
    assert norths(bench) == [1.0, 2.0, 3.0, 4.0]


def test_partial_write_without_a_mission_has_only_home(bench: MissionBench) -> None:
    bench.send(mavlink.MAVLink_mission_clear_all_message(1, 1, MISSION))
    assert of_type(bench.send(write(1, 1)), "MISSION_ACK")[0].type == ERROR


def test_refused_item_leaves_the_mission_unchanged(bench: MissionBench) -> None:
    bench.send(write(2, 3))
    sent = bench.send(item_int(2, command=22))
    assert of_type(sent, "MISSION_ACK")[0].type == UNSUPPORTED
    assert norths(bench) == [1.0, 2.0, 3.0, 4.0]


def test_repeated_partial_write_begins_again(bench: MissionBench) -> None:
    bench.send(write(2, 3))
    assert requested(bench.send(write(2, 3))) == [2]


def test_partial_write_is_based_on_what_the_robot_has(bench: MissionBench) -> None:
    bench.waypoints, bench.mission_id = bench.waypoints[:2], 9
    bench.publish()
    bench.send(write(1, 1))
    bench.send(item_int(1, 6000))
    assert norths(bench) == [6.0, 2.0]


@pytest.mark.parametrize("message", [mavlink.MAVLink_mission_request_partial_list_message])
def test_partial_read_is_refused(bench: MissionBench, message: type) -> None:
    sent = bench.send(message(1, 1, 0, 1, MISSION))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [UNSUPPORTED]
    assert words(sent) == "mission: ask for the whole list"


def test_partial_write_of_rally_points_is_unsupported(bench: MissionBench) -> None:
    sent = bench.send(write(0, 0, RALLY))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [UNSUPPORTED]
