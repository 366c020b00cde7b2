"""Missions as clients see them: downloads, and the current item."""

from math import nan
from typing import Any

import pytest

from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.commands.mission import FetchMission, JumpTo
from ground.missions.mission import Home, MavlinkItem, Waypoint
from ground.missions.transfer import items_of, waypoints_of
from protocol.wire.enums import MissionState, Mode
from tests.support.gateway.benches import (
    ALL,
    FENCE,
    HERE,
    MISSION,
    RALLY,
    MissionBench,
    item_int,
    line_of,
    messages_of,
    of_type,
    single,
    upload,
)
from tests.support.gateway.fake_port import CLIENT, ORIGIN, OTHER, acks, command, command_int, words
from tests.support.ground.plans import FLAT, plan_of

ACCEPTED, ERROR, UNSUPPORTED, SEQUENCE = 0, 1, 3, 13
WAYPOINTS = (
    Waypoint(x_m=1.0, y_m=2.0, heading_deg=90.0, hold_s=2.5),
    Waypoint(x_m=-3.5, y_m=4.25, position_tolerance_m=0.1),
)


@pytest.fixture
def bench() -> MissionBench:
    bench = MissionBench()
    bench.waypoints, bench.mission_id = WAYPOINTS, 7
    bench.publish()
    return bench


def listed(kind: int = MISSION) -> MavMessage:
    return mavlink.MAVLink_mission_request_list_message(1, 1, kind)


def asked(seq: int, kind: int = MISSION) -> MavMessage:
    return mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind)


def download(bench: MissionBench) -> list[Any]:
    """Return all items of the mission as MISSION_ITEM_INT."""
    (count,) = of_type(bench.send(listed()), "MISSION_COUNT")
    return [bench.send(asked(seq))[0] for seq in range(count.count)]


def test_count_includes_home(bench: MissionBench) -> None:
    (count,) = bench.send(listed())
    assert (count.count, count.mission_type, count.target_system) == (3, MISSION, 255)


def test_item_0_is_home_of_the_robot(bench: MissionBench) -> None:
    bench.vehicle.origin_altitude_m = 408.0
    home = download(bench)[0]
    assert (home.seq, home.command, home.frame) == (0, 16, 0)
    assert (home.x, home.y, home.z) == (*HERE, 408.0)


def test_mission_request_is_answered_by_mission_item(bench: MissionBench) -> None:
    (item,) = bench.send(mavlink.MAVLink_mission_request_message(1, 1, 1, MISSION))
    assert item.get_type() == "MISSION_ITEM"
    assert (item.x, item.y) == pytest.approx((47.3769180, 8.5417133), abs=1e-6)


def test_mission_request_int_is_answered_by_item_int(bench: MissionBench) -> None:
    (item,) = bench.send(asked(1))
    assert item.get_type() == "MISSION_ITEM_INT"
    assert (item.seq, item.command, item.frame, item.param1) == (1, 16, 3, 2.5)
    assert item.param4 == 360.0


def test_answers_are_sent_twice_on_a_lossy_line(bench: MissionBench) -> None:
    bench.vehicle.lossy = {CLIENT.client}
    assert len(of_type(bench.send(listed()), "MISSION_COUNT")) == 2
    request = mavlink.MAVLink_mission_request_int_message(1, 1, 1, MISSION)
    assert len(of_type(bench.send(request), "MISSION_ITEM_INT")) == 2


def test_downloaded_mission_can_be_uploaded_again(bench: MissionBench) -> None:
    items = download(bench)
    for item in items:
        item.target_system = item.target_component = 1
    assert upload(bench, [*items]).results == [ACCEPTED]
    for one, other in zip(WAYPOINTS, bench.waypoints, strict=True):
        assert (one.x_m, one.y_m) == pytest.approx((other.x_m, other.y_m), abs=0.01)
        assert (one.heading_deg, one.hold_s) == (other.heading_deg, other.hold_s)
    again = [(item.seq, item.x, item.y, item.param4) for item in download(bench)]
    assert again == [(item.seq, item.x, item.y, item.param4) for item in items]


def fields_of(item: MavMessage) -> list[Any]:
    """Return all fields of an item but the addressee, as the line carries them."""
    found = (value for name, value in item.to_dict().items() if not name.startswith("target"))
    return [single(value) if isinstance(value, float) else value for value in found]


def test_items_come_back_as_they_were_sent(bench: MissionBench) -> None:
    """Through the robot's own items too, which it keeps and sends back."""
    bench.vehicle.origin = Home(latitude_deg=47.4, longitude_deg=8.5)
    plan = plan_of(FLAT)
    plan["mission"]["items"][1]["params"][:4] = [None, None, None, 0]
    sent = messages_of(plan)
    sent[2].autocontinue = 0
    assert upload(bench, sent).results == [ACCEPTED]
    bench.waypoints = waypoints_of(items_of(bench.waypoints))
    bench.publish(mission_id=9)
    _, *back = download(bench)
    assert len(back) == len(sent) - 1
    for one, other in zip(sent[1:], back, strict=True):
        assert repr(fields_of(one)) == repr(fields_of(other))


def test_empty_mission_counts_0_and_still_has_home(bench: MissionBench) -> None:
    bench.waypoints = ()
    bench.publish()
    assert [one.count for one in bench.send(listed())] == [0]
    assert [one.seq for one in bench.send(asked(0))] == [0]


@pytest.mark.parametrize("seq", [3, 0xFFFF])
def test_item_that_does_not_exist_is_refused(bench: MissionBench, seq: int) -> None:
    sent = bench.send(asked(seq))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [SEQUENCE]
    assert words(sent) == f"mission: there is no item {seq}"


def test_mission_of_another_operator_is_noticed(bench: MissionBench) -> None:
    bench.send(listed())
    bench.waypoints, bench.mission_id = WAYPOINTS[:1], 8
    bench.publish()
    assert [one.count for one in bench.send(listed())] == [2]


def test_mission_is_read_once_while_it_does_not_change(bench: MissionBench) -> None:
    for _ in range(5):
        download(bench)
    assert sum(isinstance(one, FetchMission) for one in bench.port.performed) == 1


def test_flood_of_requests_waits_in_bounded_memory(bench: MissionBench) -> None:
    bench.is_answering = False
    for seq in range(1000):
        bench.send(asked(seq))
        bench.send(listed())
    assert len(bench.port.waiting) == 1
    bench.is_answering = True
    assert len(bench.answer_all()) <= 64


def test_silent_robot_is_an_error(bench: MissionBench) -> None:
    bench.is_answering = False
    bench.send(listed())
    bench.port.answer(error="no answer")
    sent = bench.sent()
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [ERROR]
    assert words(sent) == "mission: no answer"


def test_late_request_does_not_end_the_clients_upload(bench: MissionBench) -> None:
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 3, MISSION))
    bench.send(item_int(0))
    assert bench.send(listed()) == []
    assert bench.send(asked(2)) == []
    assert of_type(bench.send(item_int(1, 1000)), "MISSION_REQUEST")[0].seq == 2


def test_client_that_reads_has_given_up_its_upload(bench: MissionBench) -> None:
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 3, MISSION))
    assert [one.count for one in bench.send(listed())] == [3]
    assert of_type(bench.after(1), "MISSION_REQUEST") == []


# Row 35: opaque ids.


def ids(bench: MissionBench) -> tuple[int, int]:
    """Return the ids of mission and fence that are streamed."""
    bench.face.join(1)
    (current, *_) = of_type(bench.after(1.1), "MISSION_CURRENT")[::-1]
    return current.mission_id, current.fence_id


def test_id_of_a_plan_is_the_same_in_count_ack_and_current(bench: MissionBench) -> None:
    (ack,) = upload(bench, line_of(3)).acks
    (count,) = bench.send(listed())
    assert ack.opaque_id == count.opaque_id == ids(bench)[0] != 0


def test_id_changes_with_the_plan(bench: MissionBench) -> None:
    found = [upload(bench, line_of(number)).acks[0].opaque_id for number in (1, 2, 3, 2)]
    assert found[1] == found[3]
    assert len(set(found)) == 3


def test_id_changes_with_the_origin(bench: MissionBench) -> None:
    (before,) = bench.send(listed())
    bench.vehicle.origin = Home(latitude_deg=47.0, longitude_deg=8.0)
    (after,) = bench.send(listed())
    assert before.opaque_id != after.opaque_id != 0
    assert bench.vehicle.origin != ORIGIN


def test_id_of_the_plan_of_another_operator_is_streamed(bench: MissionBench) -> None:
    first, fence = ids(bench)
    bench.waypoints, bench.mission_id = WAYPOINTS[:1], 8
    bench.publish()
    bench.after(1)
    assert ids(bench)[0] not in (0, first)
    assert fence == 0


def test_no_plan_has_id_0(bench: MissionBench) -> None:
    bench.waypoints = ()
    bench.publish()
    assert bench.send(listed())[0].opaque_id == 0
    assert ids(bench) == (0, 0)


# Rally points, and kinds that do not exist.


def test_rally_points_count_0(bench: MissionBench) -> None:
    (count,) = bench.send(listed(RALLY))
    assert (count.count, count.mission_type) == (0, RALLY)
    assert [one.type for one in bench.send(asked(0, RALLY))] == [SEQUENCE]


def test_rally_points_are_refused_and_none_are_accepted(bench: MissionBench) -> None:
    sent = bench.send(mavlink.MAVLink_mission_count_message(1, 1, 2, RALLY))
    assert [ack.type for ack in of_type(sent, "MISSION_ACK")] == [UNSUPPORTED]
    assert words(sent) == "rally points are not supported"
    (ack,) = bench.send(mavlink.MAVLink_mission_count_message(1, 1, 0, RALLY))
    assert ack.type == ACCEPTED


@pytest.mark.parametrize("kind", [3, ALL])
def test_unknown_kind_is_unsupported(bench: MissionBench, kind: int) -> None:
    sent = bench.send(listed(kind))
    (ack,) = of_type(sent, "MISSION_ACK")
    assert (ack.type, ack.mission_type) == (UNSUPPORTED, kind)
    assert words(sent) == f"there is no mission type {kind}"


# Deletion.


def clear(kind: int) -> MavMessage:
    return mavlink.MAVLink_mission_clear_all_message(1, 1, kind)


@pytest.mark.parametrize(("kind", "left"), [(MISSION, 0), (FENCE, 2), (RALLY, 2), (ALL, 0)])
def test_clear_all_deletes_its_kind(bench: MissionBench, kind: int, left: int) -> None:
    bench.publish(is_armed=False)
    (ack,) = of_type(bench.send(clear(kind)), "MISSION_ACK")
    assert (ack.type, ack.mission_type) == (ACCEPTED, kind)
    assert len(bench.waypoints) == left


def test_clear_all_of_an_unknown_kind_is_unsupported(bench: MissionBench) -> None:
    (ack,) = of_type(bench.send(clear(9)), "MISSION_ACK")
    assert ack.type == UNSUPPORTED


def test_repeated_deletion_does_not_end_the_next_upload(bench: MissionBench) -> None:
    bench.send(clear(MISSION))
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 2, MISSION))
    bench.send(item_int(0))
    assert bench.send(clear(MISSION)) == []
    assert of_type(bench.send(item_int(1, 1000)), "MISSION_ACK")[0].type == ACCEPTED


def test_dronekit_announces_right_after_its_deletion(bench: MissionBench) -> None:
    bench.is_answering = False
    bench.send(clear(MISSION))
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 2, MISSION))
    bench.is_answering = True
    bench.answer_all()
    bench.send(item_int(0))
    assert of_type(bench.send(item_int(1, 1000)), "MISSION_ACK")[0].type == ACCEPTED


def test_flood_of_deletions_waits_in_bounded_memory(bench: MissionBench) -> None:
    bench.is_answering = False
    for _ in range(200):
        bench.send(clear(MISSION))
    assert len(bench.port.waiting) == 1


SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
RUNNING, HOLDING, DONE = MissionState.RUNNING, MissionState.HOLDING, MissionState.DONE


@pytest.fixture
def followed_bench() -> MissionBench:
    bench = MissionBench()
    bench.face.join(CLIENT.client)
    upload(bench, line_of(4))
    bench.after(0.5)
    return bench


def choose(seq: int) -> MavMessage:
    return mavlink.MAVLink_mission_set_current_message(1, 1, seq)


def current(messages: list[MavMessage]) -> list[int]:
    return [one.seq for one in of_type(messages, "MISSION_CURRENT")]


def reached(messages: list[MavMessage]) -> list[int]:
    """Return the items that are reached, without repetitions."""
    return list(dict.fromkeys(one.seq for one in of_type(messages, "MISSION_ITEM_REACHED")))


def streamed(bench: MissionBench) -> Any:
    """Return the newest MISSION_CURRENT of the stream."""
    return of_type(bench.after(1.1), "MISSION_CURRENT")[-1]


def test_set_current_is_answered_at_once(followed_bench: MissionBench) -> None:
    assert current(followed_bench.send(choose(3))) == [3]
    assert followed_bench.port.performed[-1] == JumpTo(item=3)


def test_answer_waits_for_the_robot(followed_bench: MissionBench) -> None:
    followed_bench.is_answering = False
    assert current(followed_bench.send(choose(3))) == []
    followed_bench.port.answer()
    assert current(followed_bench.sent()) == [3]


def test_chosen_item_is_shown_until_the_robot_shows_it(followed_bench: MissionBench) -> None:
    followed_bench.send(choose(3))
    assert set(current(followed_bench.after(0.2))) <= {3}
    assert set(current(followed_bench.publish())) <= {3}
    assert streamed(followed_bench).seq == 3


def test_item_0_is_taken_and_shown(followed_bench: MissionBench) -> None:
    followed_bench.send(choose(2))
    followed_bench.publish()
    assert current(followed_bench.send(choose(0))) == [0]
    assert followed_bench.port.performed[-1] == JumpTo(item=1)
    followed_bench.publish()
    assert streamed(followed_bench).seq == 0
    followed_bench.publish(state=RUNNING)
    assert streamed(followed_bench).seq == 1


def test_new_mission_forgets_the_chosen_item(followed_bench: MissionBench) -> None:
    followed_bench.send(choose(0))
    upload(followed_bench, line_of(2))
    assert streamed(followed_bench).seq == 1


def test_command_224_is_acknowledged_and_answered(followed_bench: MissionBench) -> None:
    sent = followed_bench.send(command(SET_CURRENT, 2))
    assert (acks(sent), current(sent)) == ([(SET_CURRENT, 0)], [2])
    sent = followed_bench.send(command_int(SET_CURRENT, 3, 1))
    assert (acks(sent), current(sent)) == ([(SET_CURRENT, 0)], [3])


@pytest.mark.parametrize("item", [nan, -1.0, 2.5, 1e9])
def test_command_224_denies_what_is_no_item(followed_bench: MissionBench, item: float) -> None:
    sent = followed_bench.send(command(SET_CURRENT, item))
    assert (acks(sent), current(sent)) == ([(SET_CURRENT, 2)], [])
    assert "parameter 1" in words(sent)


@pytest.mark.parametrize("seq", [5, 0xFFFF])
def test_current_item_that_does_not_exist_is_refused(
    followed_bench: MissionBench, seq: int
) -> None:
    sent = followed_bench.send(choose(seq))
    assert current(sent) == []
    assert words(sent).startswith(f"mission item {seq}: no such item")
    assert acks(followed_bench.send(command(SET_CURRENT, seq))) == [(SET_CURRENT, 2)]


def test_client_without_control_cannot_choose(followed_bench: MissionBench) -> None:
    sent = followed_bench.send(choose(2), OTHER)
    assert current(sent) == []
    assert "another operator commands the robot: MAVLink 255" in words(sent)


def test_flood_of_choices_waits_in_bounded_memory(followed_bench: MissionBench) -> None:
    followed_bench.is_answering = False
    for seq in range(1, 500):
        followed_bench.send(choose(seq))
    assert len(followed_bench.port.waiting) == 1


def test_current_is_streamed_with_total_and_state(followed_bench: MissionBench) -> None:
    found = of_type(followed_bench.after(3), "MISSION_CURRENT")
    assert len(found) == 3
    facts = (found[0].seq, found[0].total, found[0].mission_state, found[0].mission_mode)
    assert facts == (1, 4, mavlink.MISSION_STATE_NOT_STARTED, 2)


def test_no_mission_has_no_total(followed_bench: MissionBench) -> None:
    followed_bench.publish(waypoints=(), state=MissionState.NONE)
    found = streamed(followed_bench)
    facts = (found.seq, found.total, found.mission_state)
    assert facts == (0, 0xFFFF, mavlink.MISSION_STATE_NO_MISSION)


@pytest.mark.parametrize(
    ("state", "shown"), [(RUNNING, 3), (HOLDING, 3), (DONE, 5), (MissionState.PAUSED, 4), (99, 1)]
)
def test_state_of_the_mission_is_shown(
    followed_bench: MissionBench, state: int, shown: int
) -> None:
    followed_bench.publish(state=state, mode=Mode.AUTO)
    found = streamed(followed_bench)
    assert (found.mission_state, found.mission_mode) == (shown, 1)


def test_next_item_is_announced_at_once(followed_bench: MissionBench) -> None:
    followed_bench.publish(state=RUNNING)
    assert 2 in current(followed_bench.publish(current=1))


def test_stale_status_is_not_sent(followed_bench: MissionBench) -> None:
    followed_bench.port.telemetry["mission"] = None
    assert current(followed_bench.after(2)) == []


def states(bench: MissionBench, *steps: tuple[MissionState, int]) -> list[int]:
    """Let the robot go through states, each with an item; return the items that are reached."""
    return reached(
        [one for state, item in steps for one in bench.publish(state=state, current=item)]
    )


def test_each_item_is_reached_once(followed_bench: MissionBench) -> None:
    steps = ((RUNNING, 0), (RUNNING, 1), (HOLDING, 1), (RUNNING, 2), (RUNNING, 3), (DONE, 3))
    assert states(followed_bench, *steps) == [1, 2, 3, 4]


def test_jump_of_the_mission_itself_reaches_its_items(followed_bench: MissionBench) -> None:
    bench = followed_bench
    jump = MavlinkItem(command=177, frame=2, params=(1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.waypoints = (*bench.waypoints[:2], jump, *bench.waypoints[3:])
    bench.publish(mission_id=7, state=RUNNING, current=0)
    download(bench)
    steps = ((RUNNING, 0), (RUNNING, 1), (RUNNING, 2), (RUNNING, 0), (RUNNING, 2), (RUNNING, 3))
    assert states(bench, *steps[:4]) == [1, 2]
    assert states(bench, *steps[4:]) == [1]


def test_pause_reaches_nothing(followed_bench: MissionBench) -> None:
    paused = MissionState.PAUSED
    assert (
        states(followed_bench, (RUNNING, 0), (paused, 0), (RUNNING, 0), (paused, 1), (RUNNING, 1))
        == []
    )


def test_jump_reaches_nothing(followed_bench: MissionBench) -> None:
    states(followed_bench, (RUNNING, 0))
    followed_bench.send(choose(2))
    assert states(followed_bench, (RUNNING, 1)) == []
    assert states(followed_bench, (RUNNING, 3)) == []


def test_reached_item_is_repeated_for_clients_that_miss_it(followed_bench: MissionBench) -> None:
    assert states(followed_bench, (RUNNING, 3), (DONE, 3)) == [4]
    found = of_type(followed_bench.after(10), "MISSION_ITEM_REACHED")
    assert [one.seq for one in found] == [4] * 3


def test_item_can_be_reached_again(followed_bench: MissionBench) -> None:
    assert states(followed_bench, (RUNNING, 3), (DONE, 3)) == [4]
    assert states(followed_bench, (RUNNING, 3), (DONE, 3)) == [4]
