"""Uploads of missions: whole, in part, refused, and equal to the same mission from a file."""

import json
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from gateways.mavlink.missions.plan_answers import ACCEPTED as PLAN_ANSWERS_ACCEPTED
from gateways.mavlink.missions.plan_answers import PART_RESULTS, refusal_of
from gateways.mavlink.missions.plan_items import item_in
from gateways.mavlink.missions.plan_uploads import LAST_REQUESTS, RETRY_NS, TIMEOUT_NS
from gateways.mavlink.robot_port import Answered
from ground.client.outcomes import Refused
from ground.commands.mission import ClearMission, UploadMission
from ground.missions import qgroundcontrol
from ground.missions.mission import Home, Polygon, Waypoint
from ground.missions.qgroundcontrol import Item, ItemPart, to_local, waypoint_of
from ground.missions.transfer import Verdict, items_of
from protocol.wire.enums import Severity
from protocol.wire.reasons import Reason, reason_text
from tests.support.each import each
from tests.support.gateway.benches import (
    E7,
    FENCE,
    MISSION,
    RALLY,
    MissionBench,
    Uploader,
    as_float,
    item_int,
    line_of,
    messages_of,
    of_type,
    planned,
    single,
    upload,
)
from tests.support.gateway.fake_port import CLIENT, ORIGIN, OTHER, words

ACCEPTED = 0
ERROR = 1
FRAME = 2
UNSUPPORTED = 3
NO_SPACE = 4
INVALID = 5
PARAM1, PARAM2, PARAM3, PARAM5, PARAM6 = 6, 7, 8, 10, 11
SEQUENCE = 13
DENIED = 14
CANCELLED = 15


@pytest.fixture
def bench() -> MissionBench:
    return MissionBench()


def count(number: int, kind: int = 0) -> MavMessage:
    return MissionCount(1, 1, number, kind)


def refused(bench: MissionBench, *items: MavMessage) -> tuple[int, str]:
    """Upload a mission that must not be accepted; return the result and the texts."""
    found = upload(bench, items)
    assert bench.waypoints == ()
    (result,) = found.results
    return result, words(found.all)


def test_items_are_asked_for_by_mission_request(bench: MissionBench) -> None:
    found = upload(bench, line_of(3))
    assert found.requested == [0, 1, 2, 3]
    assert of_type(found.all, "MISSION_REQUEST_INT") == []
    assert found.results == [ACCEPTED]


def test_item_0_is_home_and_no_waypoint(bench: MissionBench) -> None:
    upload(bench, [item_int(0, command=22), item_int(1, 1000)])
    (waypoint,) = bench.waypoints
    assert (waypoint.x_m, waypoint.y_m) == (0.0, 11.1178)


def test_client_learns_that_its_first_item_is_home(bench: MissionBench) -> None:
    hint = "item 0 is home"
    assert hint in words(upload(bench, [item_int(0, 1000), item_int(1, 2000)]).all)
    assert hint not in words(upload(bench, line_of(1)).all)


def test_mission_item_and_item_int_give_the_same_mission(bench: MissionBench) -> None:
    upload(bench, line_of(3))
    exact = bench.waypoints
    found = upload(bench, line_of(3), form=as_float)
    assert found.results == [ACCEPTED]
    for one, other in zip(exact, bench.waypoints, strict=True):
        assert (one.x_m, one.y_m) == pytest.approx((other.x_m, other.y_m), abs=0.3)
    assert "use MISSION_ITEM_INT" in words(found.all)


def test_client_that_forgets_its_upload_is_asked_often_for_the_last_item(
    bench: MissionBench,
) -> None:
    bench.vehicle.lossy = {CLIENT.client}
    first, second, _ = (as_float(one) for one in line_of(2))
    bench.send(count(3))
    assert [one.seq for one in of_type(bench.send(first), "MISSION_REQUEST")] == [1]
    assert [one.seq for one in of_type(bench.send(second), "MISSION_REQUEST")] == [
        2
    ] * LAST_REQUESTS


def test_lost_item_is_asked_for_again(bench: MissionBench) -> None:
    assert of_type(bench.send(count(2)), "MISSION_REQUEST")[0].seq == 0
    again = of_type(bench.after(RETRY_NS / 1e9), "MISSION_REQUEST")
    assert [one.seq for one in again] == [0]
    bench.send(item_int(0))
    again = of_type(bench.after(2 * RETRY_NS / 1e9), "MISSION_REQUEST")
    assert [one.seq for one in again] == [1, 1]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("loss", [0.2, 0.4])
def test_upload_survives_loss_both_ways(bench: MissionBench, seed: int, loss: float) -> None:
    found = Uploader(bench, line_of(20), loss=loss, seed=seed).run(seconds=60)
    assert found.results[0] == ACCEPTED
    assert len(bench.waypoints) == 20
    assert sum(isinstance(one, UploadMission) for one in bench.port.performed) == 1


def test_last_item_is_acknowledged_again(bench: MissionBench) -> None:
    (first,) = upload(bench, line_of(2)).acks
    (again,) = bench.send(line_of(2)[2])
    assert again.to_dict() == first.to_dict()
    assert bench.send(line_of(2)[1]) == []
    assert sum(isinstance(one, UploadMission) for one in bench.port.performed) == 1


def test_refusal_is_not_repeated_on_a_lossy_line(bench: MissionBench) -> None:
    bench.vehicle.lossy = {CLIENT.client}
    bench.send(MissionCount(1, 1, 3, 0))
    found = of_type(bench.after(2 * TIMEOUT_NS / 1e9), "MISSION_ACK")
    assert [one.type for one in found] == [mavlink.MAV_MISSION_OPERATION_CANCELLED]


def test_result_is_sent_once_also_on_a_lossy_line(bench: MissionBench) -> None:
    bench.vehicle.lossy = {CLIENT.client}
    assert upload(bench, line_of(2)).results == [ACCEPTED]
    assert of_type(bench.after(3.0), "MISSION_ACK") == []
    assert [one.type for one in bench.send(line_of(2)[2])] == [ACCEPTED]


def test_repeated_item_is_not_taken_twice(bench: MissionBench) -> None:
    bench.send(count(3))
    for item in (0, 0, 1, 1, 0, 2):
        bench.send(item_int(item, item * 1000))
    assert [waypoint.y_m for waypoint in bench.waypoints] == [11.1178, 22.2356]


def test_item_out_of_turn_is_ignored(bench: MissionBench) -> None:
    bench.send(count(3))
    assert bench.send(item_int(2)) == []
    assert of_type(bench.send(item_int(0)), "MISSION_REQUEST")[0].seq == 1


def test_half_way_upload_is_cancelled(bench: MissionBench) -> None:
    bench.send(count(5))
    bench.send(item_int(0))
    sent = bench.after(TIMEOUT_NS / 1e9 + 0.1)
    (ack,) = of_type(sent, "MISSION_ACK")
    assert ack.type == CANCELLED
    assert "mission upload: item 1 has not arrived" in words(sent)
    assert of_type(bench.after(2), "MISSION_REQUEST") == []
    assert upload(bench, line_of(1), sender=OTHER).results == [ACCEPTED]


def test_client_can_cancel_its_upload(bench: MissionBench) -> None:
    bench.send(count(5))
    bench.send(mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0), OTHER)
    assert of_type(bench.after(0.5), "MISSION_REQUEST") != []
    bench.send(mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0))
    assert of_type(bench.after(1), "MISSION_REQUEST") == []


def test_upload_ends_with_its_client(bench: MissionBench) -> None:
    bench.send(count(5))
    bench.face.forget(CLIENT.client)
    assert of_type(bench.after(1), "MISSION_REQUEST") == []


def test_same_client_can_begin_again(bench: MissionBench) -> None:
    bench.send(count(3))
    bench.send(item_int(0))
    bench.send(item_int(1, 9000))
    assert upload(bench, line_of(2)).results == [ACCEPTED]
    assert [waypoint.y_m for waypoint in bench.waypoints] == [11.1178, 22.2356]


def test_second_client_is_denied_during_an_upload(bench: MissionBench) -> None:
    bench.send(count(3))
    for message in (
        count(2),
        item_int(0),
        mavlink.MAVLink_mission_request_list_message(1, 1, 0),
        mavlink.MAVLink_mission_request_int_message(1, 1, 0, 0),
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 0, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
    ):
        (ack,) = of_type(bench.send(message, OTHER), "MISSION_ACK")
        assert (ack.type, ack.target_system) == (DENIED, OTHER.system)
    assert of_type(bench.send(item_int(0)), "MISSION_REQUEST")[0].seq == 1


def test_client_without_control_cannot_upload(bench: MissionBench) -> None:
    upload(bench, line_of(1))
    found = upload(bench, line_of(2), sender=OTHER)
    assert (found.results, found.requested) == ([DENIED], [])
    assert "MAVLink 255" in words(found.all)


WATCHING = CLIENT._replace(barred=WATCHER)


@pytest.mark.parametrize(
    "message",
    [
        count(2),
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 0, 0, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
    ],
)
def test_watching_client_changes_nothing(bench: MissionBench, message: MavMessage) -> None:
    sent = bench.send(message, WATCHING)
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [DENIED]
    assert words(sent) == WATCHER
    assert bench.port.performed == []


def test_unsigned_frames_do_not_disturb_an_upload(bench: MissionBench) -> None:
    bench.send(count(2))
    for message in (
        mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0),
        mavlink.MAVLink_mission_request_list_message(1, 1, 0),
        item_int(0),
    ):
        bench.send(message, WATCHING)
    assert [one.seq for one in of_type(bench.after(0.5), "MISSION_REQUEST")] == [0]


def test_10000_items_are_refused_at_once(bench: MissionBench) -> None:
    sent = bench.send(count(10_000))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [NO_SPACE]
    assert words(sent) == "mission: the robot takes at most 200 items"
    assert of_type(bench.after(1), "MISSION_REQUEST") == []


def test_longest_mission_of_the_robot_is_taken(bench: MissionBench) -> None:
    assert upload(bench, line_of(200)).results == [ACCEPTED]
    assert len(bench.waypoints) == 200
    assert upload(bench, line_of(201)).results == [NO_SPACE]


@pytest.mark.parametrize("items", [0, 1])
def test_mission_without_waypoints_clears(bench: MissionBench, items: int) -> None:
    upload(bench, line_of(2))
    sent = bench.send(count(items))
    sent += bench.send(item_int(0)) if items else []
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [ACCEPTED]
    assert bench.waypoints == ()
    assert isinstance(bench.port.performed[-1], ClearMission)


@each(
    ("fields", "result", "reason"),
    [
        ({"command": 22}, UNSUPPORTED, "command 22 (take off)"),
        ({"command": 18, "param1": 3.0}, UNSUPPORTED, "command 18 (loiter in circles)"),
        ({"command": 19, "param1": 5.0, "x": 0, "y": 0}, PARAM5, "no place of its own"),
        ({"command": 93, "param1": -1.0, "frame": 2}, PARAM1, "until a time of day"),
        ({"command": 177, "param1": 1.0, "param2": -1.0, "frame": 2}, PARAM2, "without end"),
        ({"command": 178, "param2": 0.0, "frame": 2}, PARAM2, "is not a speed above 0"),
        ({"command": 0xFFFF}, UNSUPPORTED, "command 65535 (unknown)"),
        ({"frame": 1}, FRAME, "frame 1"),
        ({"frame": 200}, FRAME, "frame 200"),
        ({"param1": -1.0}, PARAM1, "hold_s -1"),
        ({"param1": inf}, PARAM1, "hold_s inf"),
        ({"param1": 1e9}, PARAM1, "hold_s 1e+09"),
        ({"param2": 0.001}, PARAM2, "position_tolerance_m 0.001"),
        ({"param3": 5.0}, PARAM3, "pass beside the waypoint"),
        ({"x": 0, "y": 0}, PARAM5, "latitude and longitude are 0"),
        ({"x": 910_000_000}, PARAM5, "is not a latitude and longitude"),
        ({"y": -0x8000_0000}, PARAM6, "is not a latitude and longitude"),
        ({"x": 873_000_000}, PARAM6, "y_m"),
    ],
)
def test_refusal_names_item_and_reason(fields: dict[str, Any], result: int, reason: str) -> None:
    bench = MissionBench()
    found, text = refused(bench, *line_of(1), item_int(2, **fields), item_int(3))
    assert found == result
    assert text.startswith("mission item 2: ")
    assert reason in text


@pytest.mark.parametrize("place", [{"x": nan}, {"y": inf}])
def test_place_of_a_float_item_must_be_finite(bench: MissionBench, place: dict[str, float]) -> None:
    bench.send(count(2))
    bench.send(item_int(0))
    item = as_float(item_int(1))
    for name, value in place.items():
        setattr(item, name, value)
    sent = bench.send(item)
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] in ([PARAM5], [PARAM6])
    assert "mission item 1: has no place" in words(sent)


@pytest.mark.parametrize("place", [{"x": inf}, {"y": 3e9}])
def test_place_of_an_item_without_one_must_fit(
    bench: MissionBench, place: dict[str, float]
) -> None:
    bench.send(count(2))
    bench.send(item_int(0))
    item = as_float(item_int(1, command=20, frame=2))
    for name, value in place.items():
        setattr(item, name, value)
    sent = bench.send(item)
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] in ([PARAM5], [PARAM6])
    assert "is out of range" in words(sent)


def test_refused_item_is_refused_again(bench: MissionBench) -> None:
    items = [*line_of(1), item_int(2, command=22), item_int(3)]
    upload(bench, items)
    (again,) = of_type(bench.send(items[2]), "MISSION_ACK")
    assert again.type == UNSUPPORTED


@pytest.mark.parametrize(
    ("reason", "item", "result", "text"),
    [
        (Reason.OUTSIDE_FENCE, 2, INVALID, "mission item 2: goal is outside of the fence"),
        (Reason.GOAL_OUT_OF_RANGE, 1, INVALID, "mission item 1: goal is not finite or farther"),
        (Reason.HOLD_OUT_OF_RANGE, 1, PARAM1, "mission item 1: hold time is not a number"),
        (Reason.DRIVING, None, ERROR, "mission: not possible while a goal or mission is active"),
        (Reason.LEASE_HELD, None, DENIED, "mission: another operator commands the robot"),
        (250, None, ERROR, "mission: "),
    ],
)
def test_refusal_of_the_robot_is_passed_on(
    bench: MissionBench, reason: int, item: int | None, result: int, text: str
) -> None:
    bench.refusal = Verdict(reason, item)
    found, words_found = refused(bench, *line_of(2))
    assert found == result
    assert words_found.startswith(text)


def test_mission_that_is_not_saved_is_accepted_with_a_text(bench: MissionBench) -> None:
    bench.refusal = Verdict(Reason.NOT_SAVED, None, 1)
    found = upload(bench, line_of(1))
    assert found.results == [ACCEPTED]
    assert "could not be saved" in words(found.all)


def test_silent_robot_is_an_error(bench: MissionBench) -> None:
    bench.is_answering = False
    bench.send(count(2))
    bench.port.answer(error="no answer")
    sent = bench.sent()
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [ERROR]
    assert words(sent) == "mission: no answer"


def test_waypoint_of_mavsdk_is_taken(bench: MissionBench) -> None:
    fields: dict[str, Any] = {"param1": 0.5, "param2": 3.0, "param4": nan, "frame": 6}
    assert upload(bench, [item_int(0), item_int(1, 1000, **fields)]).results == [ACCEPTED]
    (waypoint,) = bench.waypoints
    found = (waypoint.hold_s, waypoint.position_tolerance_m, waypoint.heading_deg)
    assert found == (0.5, 1.0, None)


def test_hold_of_nan_is_none(bench: MissionBench) -> None:
    upload(bench, [item_int(0), item_int(1, 1000, param1=nan)])
    assert bench.waypoints[0].hold_s == 0.0


def test_item_without_an_upload_is_refused(bench: MissionBench) -> None:
    sent = bench.send(item_int(1))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [SEQUENCE]
    assert "MISSION_COUNT first" in words(sent)


def test_flood_of_announcements_waits_in_bounded_memory(bench: MissionBench) -> None:
    bench.is_answering = False
    for number in range(2, 500):
        bench.send(count(number))
        bench.send(mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0))
    assert len(bench.port.waiting) <= 4
    bench.is_answering = True
    bench.answer_all()
    assert upload(bench, line_of(1)).results == [ACCEPTED]


def test_changed_announcement_is_asked_about_again(bench: MissionBench) -> None:
    bench.is_answering = False
    bench.send(count(3))
    bench.send(count(1000))
    bench.is_answering = True
    assert [ack.type for ack in of_type(bench.answer_all(), "MISSION_ACK")] == [NO_SPACE]


def test_hints_are_information_only(bench: MissionBench) -> None:
    found = upload(bench, line_of(1), form=as_float)
    assert {text.severity for text in of_type(found.all, "STATUSTEXT")} == {Severity.INFO}


STEP_M = 11.1178


@pytest.fixture
def uploaded_bench() -> MissionBench:
    bench = MissionBench()
    upload(bench, line_of(4))
    return bench


def write(first: int, last: int, kind: int = MISSION) -> MavMessage:
    return mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, kind)


def requested(messages: list[MavMessage]) -> list[int]:
    return [one.seq for one in of_type(messages, "MISSION_REQUEST")]


def norths(bench: MissionBench) -> list[float]:
    return [round(waypoint.y_m / STEP_M, 1) for waypoint in bench.waypoints]


def test_partial_write_replaces_items(uploaded_bench: MissionBench) -> None:
    assert requested(uploaded_bench.send(write(2, 3))) == [2]
    assert requested(uploaded_bench.send(item_int(2, 7000))) == [3]
    (ack,) = of_type(uploaded_bench.send(item_int(3, 8000)), "MISSION_ACK")
    assert ack.type == ACCEPTED
    assert norths(uploaded_bench) == [1.0, 7.0, 8.0, 4.0]


def test_partial_write_of_home_changes_nothing(uploaded_bench: MissionBench) -> None:
    uploaded_bench.send(write(0, 0))
    uploaded_bench.send(item_int(0, 5000))
    assert norths(uploaded_bench) == [1.0, 2.0, 3.0, 4.0]


def test_range_behind_the_last_item_is_cut(uploaded_bench: MissionBench) -> None:
    uploaded_bench.send(write(4, 5))
    assert of_type(uploaded_bench.send(item_int(4, 9000)), "MISSION_ACK")[0].type == ACCEPTED
    assert norths(uploaded_bench) == [1.0, 2.0, 3.0, 9.0]


@pytest.mark.parametrize("span", [(5, 5), (3, 2), (-1, 2), (0, 6), (-5, -1), (0, 32_767)])
def test_range_that_does_not_exist_is_refused(
    uploaded_bench: MissionBench, span: tuple[int, int]
) -> None:
    sent = uploaded_bench.send(write(*span))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [ERROR]
    assert words(sent) == f"mission: there are no items {span[0]} to {span[1]}"
    assert norths(uploaded_bench) == [1.0, 2.0, 3.0, 4.0]


def test_partial_write_without_a_mission_has_only_home(uploaded_bench: MissionBench) -> None:
    uploaded_bench.send(mavlink.MAVLink_mission_clear_all_message(1, 1, MISSION))
    assert of_type(uploaded_bench.send(write(1, 1)), "MISSION_ACK")[0].type == ERROR


def test_refused_item_leaves_the_mission_unchanged(uploaded_bench: MissionBench) -> None:
    uploaded_bench.send(write(2, 3))
    sent = uploaded_bench.send(item_int(2, command=22))
    assert of_type(sent, "MISSION_ACK")[0].type == UNSUPPORTED
    assert norths(uploaded_bench) == [1.0, 2.0, 3.0, 4.0]


def test_repeated_partial_write_begins_again(uploaded_bench: MissionBench) -> None:
    uploaded_bench.send(write(2, 3))
    assert requested(uploaded_bench.send(write(2, 3))) == [2]


def test_partial_write_is_based_on_what_the_robot_has(uploaded_bench: MissionBench) -> None:
    uploaded_bench.waypoints, uploaded_bench.mission_id = uploaded_bench.waypoints[:2], 9
    uploaded_bench.publish()
    uploaded_bench.send(write(1, 1))
    uploaded_bench.send(item_int(1, 6000))
    assert norths(uploaded_bench) == [6.0, 2.0]


@pytest.mark.parametrize("message", [mavlink.MAVLink_mission_request_partial_list_message])
def test_partial_read_is_refused(uploaded_bench: MissionBench, message: type) -> None:
    sent = uploaded_bench.send(message(1, 1, 0, 1, MISSION))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [UNSUPPORTED]
    assert words(sent) == "mission: ask for the whole list"


def test_partial_write_of_rally_points_is_unsupported(uploaded_bench: MissionBench) -> None:
    sent = uploaded_bench.send(write(0, 0, RALLY))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [UNSUPPORTED]


@each("reason", [reason for reason in Reason if reason])
def test_each_reason_is_refused_in_words(reason: Reason) -> None:
    refusal = refusal_of(Answered(Refused(reason, 1)), "mission", 1)
    assert refusal.result != PLAN_ANSWERS_ACCEPTED
    assert refusal.words == f"mission: {reason_text(reason)}"


def test_each_part_of_an_item_has_a_result() -> None:
    assert set(PART_RESULTS) == set(ItemPart)
    assert PLAN_ANSWERS_ACCEPTED not in PART_RESULTS.values()


def test_holder_of_the_lease_is_named() -> None:
    answered = Answered(Refused(Reason.LEASE_HELD, 1, "anna"))
    assert refusal_of(answered, "fence", 0).words.endswith(": anna")


FENCED = Polygon(corners=((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)))
TOUR = (
    Waypoint(x_m=1.25, y_m=-2.5),
    Waypoint(x_m=10.0, y_m=3.3333, heading_deg=33.3, hold_s=0.1, position_tolerance_m=0.07),
    Waypoint(x_m=-7.7, y_m=41.2, heading_deg=-123.45, hold_s=12.3),
    Waypoint(x_m=0.0, y_m=0.0, heading_deg=90.0, position_tolerance_m=0.005),
)


def test_uploaded_mission_equals_that_of_the_plan_file() -> None:
    plan = planned(*TOUR, fence=FENCED)
    read = qgroundcontrol.read_plan(json.dumps(plan), "tour.plan").mission
    bench = MissionBench()
    assert upload(bench, messages_of(plan)).results == [0]
    assert bench.waypoints == read.waypoints
    assert repr(items_of(bench.waypoints)) == repr(items_of(read.waypoints))


def test_uploaded_fence_equals_that_of_the_plan_file() -> None:
    plan = planned(*TOUR, fence=FENCED)
    read = qgroundcontrol.read_plan(json.dumps(plan), "tour.plan").mission
    (corners,) = [shape["polygon"] for shape in plan["geoFence"]["polygons"]]
    places = [(round(latitude * E7), round(longitude * E7)) for latitude, longitude in corners]
    facts: dict[str, Any] = {"command": 5001, "param1": float(len(places)), "mission_type": FENCE}
    bench = MissionBench()
    items = [item_int(at, x=x, y=y, **facts) for at, (x, y) in enumerate(places)]
    assert upload(bench, items).results == [0]
    assert bench.fence == read.fence


@given(
    st.integers(-80 * E7, 80 * E7),
    st.integers(-180 * E7, 180 * E7),
    st.integers(0, 36_000),
    st.integers(0, 36_000),
)
def test_item_of_a_plan_and_of_mavlink_is_the_same_waypoint(
    x: int, y: int, yaw_cdeg: int, hold_ds: int
) -> None:
    home = Home(latitude_deg=round(x / E7, 4), longitude_deg=round(y / E7, 4))
    params = (hold_ds / 10, 0.05, 0.0, yaw_cdeg / 100)
    in_plan = Item(1, 16, 3, (*params, round(x / E7, 7), round(y / E7, 7), 0.0))
    carried = [single(value) for value in params]
    message = mavlink.MAVLink_mission_item_int_message(1, 1, 1, 3, 16, 0, 1, *carried, x, y, 0.0, 0)
    if not (x or y):
        return
    assert waypoint_of(item_in(message), home) == waypoint_of(in_plan, home)


def test_float_items_are_exact_to_a_metre_only() -> None:
    """MISSION_ITEM has 24 bits for a place: the mission is near, and not the same."""
    bench, plan = MissionBench(), planned(*TOUR, fence=FENCED)
    exact = qgroundcontrol.read_plan(json.dumps(plan), "tour.plan").mission
    assert upload(bench, messages_of(plan), form=as_float).results == [0]
    assert bench.waypoints != exact.waypoints
    for one, (_, other) in zip(bench.waypoints, exact.places, strict=True):
        assert (one.x_m, one.y_m) == pytest.approx((other.x_m, other.y_m), abs=1.0)


def test_places_beyond_7_decimals_are_rounded_by_mavlink() -> None:
    """A plan with more decimals is another mission by MAVLink, by at most 8 mm."""
    sent = item_int(1, x=round(47.377012345678 * E7), y=round(8.541812345678 * E7))
    given_place = to_local(ORIGIN, 47.377012345678, 8.541812345678)
    found = waypoint_of(item_in(sent), ORIGIN)
    assert (found.x_m, found.y_m) == pytest.approx(given_place, abs=0.008)
    assert (found.x_m, found.y_m) != given_place
