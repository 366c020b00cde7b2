from math import inf, nan
from typing import Any

import pytest

from checks.harness.messages import make
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from ground.commands.fence import ClearFence, SetFence
from ground.missions.mission import Circle, Polygon, Zones
from ground.missions.transfer import Verdict, fence_items_of, fence_of
from protocol.wire.enums import LeaseAction
from protocol.wire.messages import LeaseStatus
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.benches import (
    ALL,
    FENCE,
    HERE,
    MissionBench,
    item_int,
    of_type,
    upload,
)
from tests.support.gateway.fake_port import CLIENT, OTHER, acks, command, status, words

ACCEPTED, ERROR, FRAME, UNSUPPORTED, NO_SPACE, INVALID, PARAM1 = 0, 1, 2, 3, 4, 5, 6
DENIED = 14
CORNER, STAY_OUT, CIRCLE, CIRCLE_OUT, RETURN_POINT = 5001, 5002, 5003, 5004, 5000
ENABLE = mavlink.MAV_CMD_DO_FENCE_ENABLE
SQUARE = ((-1000, -1000), (-1000, 1000), (1000, 1000), (1000, -1000))


@pytest.fixture
def bench() -> MissionBench:
    return MissionBench()


def polygon(*places: tuple[int, int], command: int = CORNER, **fields: Any) -> list[MavMessage]:
    values = {"mission_type": FENCE, "param1": float(len(places)), "frame": 0} | fields
    return [item_int(seq, *place, command=command, **values) for seq, place in enumerate(places)]


def circle(
    radius_m: float = 20.0, command: int = CIRCLE, north: int = 0, **fields: Any
) -> MavMessage:
    return item_int(0, north, command=command, param1=radius_m, mission_type=FENCE, **fields)


def download(bench: MissionBench) -> list[Any]:
    """Return all items of the fence."""
    listed = mavlink.MAVLink_mission_request_list_message(1, 1, FENCE)
    (count,) = bench.send(listed)
    asked = [mavlink.MAVLink_mission_request_int_message(1, 1, at, FENCE) for at in range(99)]
    return [bench.send(asked[seq])[0] for seq in range(count.count)]


def test_polygon_is_uploaded(bench: MissionBench) -> None:
    assert upload(bench, polygon(*SQUARE)).results == [ACCEPTED]
    assert isinstance(bench.fence, Polygon)
    assert bench.fence.corners[0] == (-7.552, -11.1178)
    assert len(bench.fence.corners) == 4


def test_circle_is_uploaded(bench: MissionBench) -> None:
    assert upload(bench, [circle(12.5)]).results == [ACCEPTED]
    assert bench.fence == Circle(x_m=0.0, y_m=0.0, radius_m=12.5)


def test_polygon_is_downloaded(bench: MissionBench) -> None:
    items = polygon(*SQUARE)
    upload(bench, items)
    found = download(bench)
    assert [(one.x, one.y, one.command, one.param1) for one in found] == [
        (one.x, one.y, CORNER, 4.0) for one in items
    ]
    assert {(one.frame, one.mission_type) for one in found} == {(0, FENCE)}


def test_circle_is_downloaded(bench: MissionBench) -> None:
    bench.fence = Circle(x_m=0.0, y_m=0.0, radius_m=7.5)
    (found,) = download(bench)
    assert (found.x, found.y, found.command, found.param1) == (*HERE, CIRCLE, 7.5)


def test_float_items_are_answered_with_float_items(bench: MissionBench) -> None:
    bench.fence = Circle(x_m=0.0, y_m=0.0, radius_m=7.5)
    (found,) = bench.send(mavlink.MAVLink_mission_request_message(1, 1, 0, FENCE))
    assert (found.get_type(), found.mission_type) == ("MISSION_ITEM", FENCE)


def test_no_fence_counts_0(bench: MissionBench) -> None:
    assert download(bench) == []


def test_fence_without_items_clears(bench: MissionBench) -> None:
    bench.publish(is_armed=False)
    upload(bench, [circle()])
    (ack,) = bench.send(mavlink.MAVLink_mission_count_message(1, 1, 0, FENCE))
    assert (ack.type, ack.mission_type, bench.fence) == (ACCEPTED, FENCE, None)


@each("items", [0, 10_000])
def test_a_refused_fence_gives_the_lease_back(bench: MissionBench, items: int) -> None:
    """So does one without items, which takes control when it is stored, and not before."""
    bench.publish(is_armed=False, refusal=Verdict(Reason.DRIVING, None))
    bench.port.telemetry["lease"] = make(LeaseStatus)
    bench.after(0.1)
    before = len(bench.port.leases)
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, items, FENCE))
    actions = [action for action, _ in bench.port.leases[before:]]
    assert actions == [LeaseAction.TAKE, LeaseAction.RELEASE]
    assert bench.vehicle.control.owner is None


def refused(bench: MissionBench, *items: MavMessage) -> tuple[int, str]:
    found = upload(bench, items)
    assert bench.fence is None
    (result,) = found.results
    return result, words(found.all)


def numbered(*items: MavMessage) -> list[MavMessage]:
    for seq, one in enumerate(items):
        one.seq = seq
    return [*items]


@each(
    "items",
    [
        [circle(3.0, CIRCLE_OUT, north=2000), *polygon(*SQUARE)],
        [*polygon(*SQUARE), *polygon((0, 500), (300, 500), (300, 800), command=STAY_OUT)],
        [circle(3.0, CIRCLE_OUT, north=1000)],
    ],
)
def test_exclusions_come_back_as_they_were_sent(items: list[MavMessage]) -> None:
    """Through the robot's own items too, in the order in which they were drawn."""
    bench = MissionBench()
    sent = numbered(*items)
    assert upload(bench, sent).results == [ACCEPTED]
    assert isinstance(bench.fence, Zones)
    bench.fence = fence_of(fence_items_of(bench.fence))
    bench.after(60.0)
    back = download(bench)
    assert [(one.seq, one.command, one.param1, one.x, one.y) for one in back] == [
        (one.seq, one.command, one.param1, one.x, one.y) for one in sent
    ]


@each(
    ("items", "result", "reason"),
    [
        ([circle(command=RETURN_POINT)], UNSUPPORTED, "return point"),
        ([circle(command=16)], UNSUPPORTED, "not an item of a fence"),
        ([*polygon(*SQUARE), circle()], UNSUPPORTED, "item 4: only one"),
        ([*polygon(*SQUARE[:3], param1=4.0), circle()], PARAM1, "item 0: is not one of 4 corners"),
        (polygon(*SQUARE, param1=5.0), PARAM1, "item 0: is not one of 5 corners in a row"),
        (polygon(*SQUARE, param1=nan), PARAM1, "item 0: is not one of nan corners"),
        ([circle(), *polygon(*SQUARE[:2], command=STAY_OUT)], INVALID, "from item 1 on: has 2"),
        ([circle(), circle(-1.0, CIRCLE_OUT)], PARAM1, "item 1: "),
        (polygon(*SQUARE[:2]), INVALID, "has 2 corners"),
        (polygon(SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]), INVALID, "cross"),
        (polygon(*[SQUARE[0]] * 4), INVALID, "the same place"),
        (polygon(*SQUARE, frame=1), FRAME, "frame 1"),
        ([circle(0.0)], PARAM1, "radius_m"),
        ([circle(-5.0)], PARAM1, "radius_m"),
        ([circle(nan)], PARAM1, "radius_m"),
        ([circle(inf)], PARAM1, "radius_m"),
        ([circle(x=0, y=0)], 10, "latitude and longitude are 0"),
        ([circle(x=0x7FFF_FFFF)], 10, "is not a latitude and longitude"),
        (polygon(*SQUARE * 5), NO_SPACE, "fence: the robot takes at most 16 items"),
    ],
)
def test_fence_is_refused_with_its_reason(
    items: list[MavMessage], result: int, reason: str
) -> None:
    bench = MissionBench()
    found, text = refused(bench, *numbered(*items))
    assert found == result
    assert reason in text


def test_fence_that_leaves_the_robot_out_is_refused(bench: MissionBench) -> None:
    bench.refusal = Verdict(Reason.FENCE_LEAVES_ROBOT_OUT, None)
    result, text = refused(bench, circle())
    assert (result, text) == (INVALID, "fence: the robot itself is outside of that fence")


def test_refused_corner_is_named_as_on_mavlink(bench: MissionBench) -> None:
    bench.refusal = Verdict(Reason.FENCE_NOT_SIMPLE, 3)
    assert refused(bench, *polygon(*SQUARE))[1].startswith("fence item 2: ")


def test_mission_and_fence_can_be_uploaded_at_the_same_time(bench: MissionBench) -> None:
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    assert upload(bench, [circle()]).results == [ACCEPTED]
    bench.send(item_int(0))
    assert of_type(bench.send(item_int(1, 1000)), "MISSION_ACK")[0].type == ACCEPTED


def fence_status(messages: list[MavMessage]) -> list[tuple[int, int, int]]:
    found = of_type(messages, "FENCE_STATUS")
    return [(one.breach_status, one.breach_count, one.breach_type) for one in found]


def test_fence_status_is_streamed(bench: MissionBench) -> None:
    bench.face.join(CLIENT.client)
    assert fence_status(bench.after(3.1)) == [(0, 0, 0)] * 3


def test_breach_is_counted_and_sent_at_once(bench: MissionBench) -> None:
    bench.port.telemetry["status"] = status(vehicle_reason=Reason.FENCE_BREACHED)
    assert fence_status(bench.after(0.02)) == [(1, 1, mavlink.FENCE_BREACH_BOUNDARY)]
    bench.port.telemetry["status"] = status()
    assert fence_status(bench.after(0.02)) == [(0, 1, mavlink.FENCE_BREACH_NONE)]
    bench.port.telemetry["status"] = status(vehicle_reason=Reason.FENCE_BREACHED)
    assert fence_status(bench.after(0.02)) == [(1, 2, mavlink.FENCE_BREACH_BOUNDARY)]


def test_breach_has_the_time_of_its_begin(bench: MissionBench) -> None:
    bench.after(1)
    bench.port.telemetry["status"] = status(vehicle_reason=Reason.FENCE_BREACHED)
    (found,) = of_type(bench.after(0.02), "FENCE_STATUS")
    assert found.breach_time == bench.now_ns // 1_000_000


def test_stale_robot_has_no_fence_status(bench: MissionBench) -> None:
    bench.face.join(CLIENT.client)
    bench.port.telemetry["status"] = None
    assert fence_status(bench.after(3)) == []


def test_disabled_fence_can_be_enabled_again(bench: MissionBench) -> None:
    bench.publish(is_armed=False)
    upload(bench, [circle(12.5)])
    fence = bench.fence
    assert acks(bench.send(command(ENABLE, 0))) == [(ENABLE, 0)]
    assert (bench.fence, bench.port.performed[-1]) == (None, ClearFence())
    assert acks(bench.send(command(ENABLE, 1))) == [(ENABLE, 0)]
    assert bench.fence == fence
    assert isinstance(bench.port.performed[-1], SetFence)


@pytest.mark.parametrize(
    ("removal", "refusal"),
    [
        (command(ENABLE, 0), ("COMMAND_ACK", 1)),
        (mavlink.MAVLink_mission_clear_all_message(1, 1, FENCE), ("MISSION_ACK", ERROR)),
        (mavlink.MAVLink_mission_clear_all_message(1, 1, ALL), ("MISSION_ACK", ERROR)),
        (MissionCount(1, 1, 0, FENCE), ("MISSION_ACK", ERROR)),
    ],
)
def test_armed_robot_keeps_its_fence(
    bench: MissionBench, removal: MavMessage, refusal: tuple[str, int]
) -> None:
    """One message, lost or forged, must not let it drive on without; but it may be replaced."""
    upload(bench, [circle(12.5)])
    fence = bench.fence
    assert bench.is_armed
    bench.after(0.02)
    sent = bench.send(removal)
    kind, result = refusal
    assert [getattr(one, "result", None) or one.type for one in of_type(sent, kind)] == [result]
    assert "only while the robot is disarmed" in words(sent)
    assert bench.fence == fence is not None
    upload(bench, [circle(3.0)])
    assert bench.fence not in (fence, None)
    bench.port.telemetry["status"] = None  # silent, and perhaps still driving
    bench.after(4.0)
    assert "only while the robot is disarmed" in words(bench.send(removal))


def test_refused_removal_takes_no_lease(bench: MissionBench) -> None:
    upload(bench, [circle(12.5)])
    control, leases = bench.vehicle.control, len(bench.port.leases)
    control.forget(CLIENT.client)
    assert "only while the robot is disarmed" in words(bench.send(command(ENABLE, 0)))
    assert control.owner is None
    assert len(bench.port.leases) == leases


def test_fence_in_force_stays_enabled(bench: MissionBench) -> None:
    upload(bench, [circle(12.5)])
    assert acks(bench.send(command(ENABLE, 1))) == [(ENABLE, 0)]
    assert sum(isinstance(one, SetFence) for one in bench.port.performed) == 1


def test_fence_that_is_not_there_cannot_be_enabled(bench: MissionBench) -> None:
    sent = bench.send(command(ENABLE, 1))
    assert acks(sent) == [(ENABLE, 4)]
    assert words(sent) == "there is no fence: upload one"


@pytest.mark.parametrize("value", [2.0, nan, -1.0])
def test_fence_has_no_floor_to_disable(bench: MissionBench, value: float) -> None:
    assert acks(bench.send(command(ENABLE, value))) == [(ENABLE, 2)]


def test_client_without_control_cannot_disable_the_fence(bench: MissionBench) -> None:
    upload(bench, [circle()])
    sent = bench.send(command(ENABLE, 0), OTHER)
    assert acks(sent) == [(ENABLE, 10)]
    assert bench.fence is not None


def test_fence_of_another_operator_is_noticed(bench: MissionBench) -> None:
    bench.face.join(CLIENT.client)
    upload(bench, [circle()])
    bench.fence = Circle(x_m=1.0, y_m=0.0, radius_m=3.0)
    before, *_, after = of_type(bench.after(12), "MISSION_CURRENT")
    assert before.fence_id != after.fence_id != 0
