"""Transfers: a mission is accepted as a whole or not at all, in any order of its frames."""

from math import inf, nan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from protocol.wire.enums import Command, MissionType
from protocol.wire.limits import NO_ITEM
from protocol.wire.messages import (
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
)
from protocol.wire.reasons import Reason
from robot.core import reasons
from robot.file_writer import Directory
from robot.mission import MAX_ITEMS, MissionStore, TransferRequest, Transfers
from tests.support.each import each
from tests.support.robots import Desk, armed, circle, corners, item, line, ready, start, upload


def held(desk: Desk, kind: int = MissionType.MISSION) -> list[str]:
    """Return a download as text, in which NaN equals NaN."""
    count = desk.vehicle.receive(MissionRequestList(mission_type=kind), 0)
    assert isinstance(count, MissionCount)
    wanted = [MissionRequestInt(seq=seq, mission_type=kind) for seq in range(count.count)]
    return [repr(desk.vehicle.receive(one, 0)) for one in wanted]


def test_what_was_uploaded_can_be_downloaded() -> None:
    desk = Desk()
    verdict = upload(desk, line(5))
    assert verdict == MissionVerdict(mission_id=1, item=NO_ITEM, reason=0, mission_type=0)
    assert held(desk) == [repr(one) for one in line(5)]
    assert upload(desk, line(2)).mission_id == 2
    assert held(desk) == [repr(one) for one in line(2)]


def test_before_there_is_a_mission_there_is_nothing_to_download() -> None:
    desk = Desk()
    assert held(desk) == []
    answer = desk.vehicle.receive(MissionRequestInt(seq=0), 0)
    assert isinstance(answer, MissionVerdict)
    assert (answer.item, answer.reason) == (0, Reason.MISSION_ITEM_BAD)


BAD = [
    ({"command": 22}, Reason.UNKNOWN_COMMAND),
    ({"frame": 0}, Reason.UNKNOWN_FRAME),
    ({"param1": nan}, Reason.HOLD_OUT_OF_RANGE),
    ({"param1": -0.1}, Reason.HOLD_OUT_OF_RANGE),
    ({"param1": 3601.0}, Reason.HOLD_OUT_OF_RANGE),
    ({"param1": inf}, Reason.HOLD_OUT_OF_RANGE),
    ({"param2": 0.004}, Reason.TOLERANCE_OUT_OF_RANGE),
    ({"param2": nan}, Reason.TOLERANCE_OUT_OF_RANGE),
    ({"param3": 0.0}, Reason.TOLERANCE_OUT_OF_RANGE),
    ({"param3": inf}, Reason.TOLERANCE_OUT_OF_RANGE),
    ({"param4": inf}, Reason.GOAL_OUT_OF_RANGE),
    ({"x": 1_010_000}, Reason.GOAL_OUT_OF_RANGE),
    ({"y": -(2**31)}, Reason.GOAL_OUT_OF_RANGE),
]


@each(("change", "reason"), BAD)
@each("at", [0, 1, 3])
def test_bad_item_is_named_and_the_old_mission_stays(
    change: dict[str, Any], reason: Reason, at: int
) -> None:
    desk = Desk()
    upload(desk, line(2))
    items = line(4)
    items[at] = item(at, **change)
    verdict = upload(desk, items)
    assert (verdict.item, verdict.reason, verdict.mission_id) == (at, reason, 1)
    assert held(desk) == [repr(one) for one in line(2)]


def test_an_item_outside_of_the_fence_is_named() -> None:
    desk = Desk()
    assert upload(desk, circle(0.0, 0.0, 1.0)).reason == Reason.NONE
    verdict = upload(desk, line(4))
    assert (verdict.item, verdict.reason) == (3, Reason.OUTSIDE_FENCE)


def test_a_mission_has_at_least_one_item_and_not_too_many() -> None:
    desk = Desk()
    for count, reason, which in (
        (0, Reason.MISSION_EMPTY, NO_ITEM),
        (MAX_ITEMS + 1, Reason.MISSION_TOO_LONG, MAX_ITEMS),
    ):
        verdict = desk.vehicle.receive(MissionCount(count=count), 0)
        assert isinstance(verdict, MissionVerdict)
        assert (verdict.reason, verdict.item) == (reason, which)


def test_item_out_of_turn_is_refused_and_upload_continues() -> None:
    desk = Desk()
    items = line(3)
    assert bad(desk.vehicle.receive(items[0], 0)) == 0, "the transfer was not announced"
    desk.vehicle.receive(MissionCount(count=3), 0)
    desk.vehicle.receive(items[0], 0)
    assert bad(desk.vehicle.receive(items[2], 0)) == 2
    assert desk.vehicle.receive(items[1], 0) == MissionRequestInt(seq=2)


def bad(answer: object) -> int:
    assert isinstance(answer, MissionVerdict)
    assert answer.reason == Reason.MISSION_ITEM_BAD
    return answer.item


def test_every_frame_may_be_repeated() -> None:
    desk = Desk()
    for request in (MissionCount(count=2), *line(2)):
        first = desk.vehicle.receive(request, 0)
        assert desk.vehicle.receive(request, 0) == first
    assert desk.vehicle.mission.number == 1


def test_concurrent_uploads_do_not_mix_items() -> None:
    desk = Desk()
    ours, theirs = line(3), [item(seq, -1.0, 2.0) for seq in range(3)]
    desk.vehicle.receive(MissionCount(count=3), 0, "ada")
    desk.vehicle.receive(ours[0], 0, "ada")
    desk.vehicle.receive(MissionCount(count=3), 0, "bob")
    desk.vehicle.receive(theirs[0], 0, "bob")
    assert bad(desk.vehicle.receive(ours[1], 0, "ada")) == 1
    for one in theirs[1:]:
        desk.vehicle.receive(one, 0, "bob")
    assert held(desk) == [repr(one) for one in theirs]


def test_what_is_cleared_is_gone() -> None:
    desk = Desk()
    upload(desk, line(3))
    upload(desk, circle(0.0, 0.0, 9.0))
    for kind in (MissionType.MISSION, MissionType.FENCE):
        verdict = desk.vehicle.receive(MissionClearAll(mission_type=kind), 0)
        expected = MissionVerdict(mission_id=0, item=NO_ITEM, reason=0, mission_type=kind)
        assert verdict == expected
        assert held(desk, kind) == []
    assert start(desk) == Reason.NO_MISSION
    assert desk.vehicle.state.machine.fence is None


def test_a_mission_under_way_is_neither_replaced_nor_cleared() -> None:
    desk = ready(3)
    start(desk)
    desk.step()
    assert upload(desk, line(2)).reason == Reason.DRIVING
    cleared = desk.vehicle.receive(MissionClearAll(), 0)
    assert isinstance(cleared, MissionVerdict)
    assert cleared.reason == Reason.DRIVING
    assert len(held(desk)) == 3


def test_other_kinds_of_missions_are_unknown() -> None:
    verdict = Desk().vehicle.receive(MissionCount(count=1, mission_type=2), 0)
    assert isinstance(verdict, MissionVerdict)
    assert (verdict.reason, verdict.mission_type) == (Reason.UNKNOWN_COMMAND, 2)


# Fences are uploaded the same way.


@each(
    "items",
    [
        circle(0.0, 0.0, 2.0),
        corners((-1.0, -1.0), (3.0, -1.0), (3.0, 1.0), (-1.0, 1.0)),
        corners((-1.0, -1.0), (3.0, 0.0), (-1.0, 1.0)),
    ],
)
def test_uploaded_fence_refuses_goals(items: list[MissionItemInt]) -> None:
    desk = armed()
    assert upload(desk, items).reason == Reason.NONE
    assert held(desk, MissionType.FENCE) == [repr(one) for one in items]
    assert desk.goto(1.5, 4.0) == Reason.OUTSIDE_FENCE
    assert desk.goto(1.5, 0.0) == Reason.NONE


def keep_out(items: list[MissionItemInt]) -> list[MissionItemInt]:
    """Return the outline as one that the robot must not enter."""
    return [structs.replace(one, command=one.command + 1) for one in items]


def renumbered(first: int, items: list[MissionItemInt]) -> list[MissionItemInt]:
    return [structs.replace(one, seq=seq) for seq, one in enumerate(items, start=first)]


ZONE = corners((1.0, -0.5), (1.5, -0.5), (1.5, 0.5), (1.0, 0.5))


def test_robot_stays_out_of_an_exclusion() -> None:
    """Drawn before the fence to stay in, as people do; the robot stops at its edge."""
    desk = armed()
    items = [*keep_out(ZONE), *renumbered(4, circle(0.0, 0.0, 9.0))]
    assert upload(desk, items).reason == Reason.NONE
    assert held(desk, MissionType.FENCE) == [repr(one) for one in items]
    assert desk.goto(1.25, 0.0) == Reason.OUTSIDE_FENCE
    assert upload(desk, [item(0, 1.25)]).reason == Reason.OUTSIDE_FENCE
    assert desk.goto(2.0, 0.0) == Reason.NONE
    for _ in range(400):
        desk.step()
    machine = desk.vehicle.state.machine
    assert machine.vehicle_reason == Reason.FENCE_BREACHED
    assert desk.vehicle.state.odometry.pose.x_m == pytest.approx(1.0, abs=0.05)
    assert desk.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.FENCE_BREACHED
    assert upload(desk, circle(0.0, 0.0, 9.0)).reason == Reason.NONE
    desk.step()
    assert desk.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE


@each(
    ("items", "which", "reason"),
    [
        (corners((1.0, 1.0), (3.0, 1.0), (3.0, 3.0)), NO_ITEM, Reason.FENCE_LEAVES_ROBOT_OUT),
        (corners((-1.0, -1.0), (3.0, 1.0)), NO_ITEM, Reason.FENCE_NOT_SIMPLE),
        (
            corners((-1.0, -1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)),
            NO_ITEM,
            Reason.FENCE_NOT_SIMPLE,
        ),
        (circle(0.0, 0.0, -1.0), NO_ITEM, Reason.FENCE_NOT_SIMPLE),
        (circle(0.0, 0.0, nan), NO_ITEM, Reason.FENCE_NOT_SIMPLE),
        ([item(0, mission_type=1)], 0, Reason.UNKNOWN_COMMAND),
        ([*corners((-1.0, -1.0), (3.0, 1.0)), item(2, mission_type=1)], 2, Reason.UNKNOWN_COMMAND),
        (corners((-1.0, -1.0), (3.0, 1.0), (1.0, 3.0))[:2], 1, Reason.FENCE_NOT_SIMPLE),
        (
            [*circle(0.0, 0.0, 2.0), *renumbered(1, circle(0.0, 0.0, 1.0))],
            1,
            Reason.FENCE_NOT_SIMPLE,
        ),
        (keep_out(circle(1.0, 0.0, 0.5)), 0, Reason.FENCE_NOT_SIMPLE),
        (
            [*circle(0.0, 0.0, 2.0), *renumbered(1, keep_out(circle(0.2, 0.0, 0.5)))],
            NO_ITEM,
            Reason.FENCE_LEAVES_ROBOT_OUT,
        ),
        (
            [*circle(0.0, 0.0, 9.0), *renumbered(1, keep_out(corners((1, 0), (2, 0))))],
            NO_ITEM,
            Reason.FENCE_NOT_SIMPLE,
        ),
    ],
)
def test_a_bad_fence_is_refused_and_the_old_one_stays(
    items: list[MissionItemInt], which: int, reason: Reason
) -> None:
    desk = Desk()
    desk.step()
    upload(desk, circle(0.0, 0.0, 5.0))
    verdict = upload(desk, items)
    assert (verdict.item, verdict.reason) == (which, reason)
    assert len(held(desk, MissionType.FENCE)) == 1
    assert desk.vehicle.state.machine.fence is not None


class FakeItemStore:
    """Stores the accepted items, and every accepted set so far."""

    max_items = 9

    def __init__(self) -> None:
        self.items: tuple[MissionItemInt, ...] = ()
        self.ever: list[tuple[MissionItemInt, ...]] = [()]

    def put(self, items: tuple[MissionItemInt, ...]) -> tuple[int | None, int]:
        self.items = items
        self.ever.append(items)
        return None, reasons.OK

    def clear(self) -> int:
        self.items = ()
        return reasons.OK


frames: st.SearchStrategy[TransferRequest] = st.one_of(
    st.builds(MissionCount, count=st.integers(0, 4), mission_type=st.just(1)),
    st.builds(item, st.integers(0, 4), st.sampled_from([0.0, 1.0]), mission_type=st.just(1)),
    st.builds(MissionRequestInt, seq=st.integers(0, 5), mission_type=st.just(1)),
    st.builds(MissionRequestList, mission_type=st.integers(1, 3)),
    st.builds(MissionClearAll, mission_type=st.integers(1, 3)),
)


@given(st.lists(st.tuples(frames, st.sampled_from(["ada", "bob"])), max_size=60))
def test_any_order_of_frames_stores_complete_uploads_only(
    asked: list[tuple[TransferRequest, str]],
) -> None:
    store = FakeItemStore()
    desk = Desk()
    transfers = Transfers(desk.vehicle.mission, store, MissionStore(Directory(None)))
    for request, operator in asked:
        answer = transfers.receive(request, operator)
        assert getattr(answer, "mission_type", 0) == request.mission_type
        assert store.items in store.ever
        for whole in store.ever:
            assert [one.seq for one in whole] == list(range(len(whole)))
