"""Missions on the wire: lost frames are asked for again, and places come back as typed."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.client.requests import PATIENCE_NS, GaveUp
from ground.missions.mission import Circle, Fence, Mission, Polygon, Waypoint
from ground.missions.transfer import (
    ATTEMPTS,
    MAX_ITEMS,
    MAX_SAVING,
    Clear,
    Download,
    Downloaded,
    Transfer,
    Upload,
    Verdict,
    fence_items_of,
    fence_of,
    items_of,
    waypoints_of,
)
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import AckResult, Command, MissionType
from protocol.wire.limits import NO_ITEM
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
)
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError
from tests.support.each import each
from tests.support.ground.missions import fences, missions, thousandths

MISSION = MissionType.MISSION
ITEMS = items_of([Waypoint(x_m=float(at), y_m=0.0) for at in range(3)])


def verdict(reason: int = 0, item: int = NO_ITEM, kind: int = MISSION) -> MissionVerdict:
    return MissionVerdict(mission_id=4, item=item, reason=reason, mission_type=kind)


def asked(transfer: Transfer, now_ns: int) -> Message:
    """Return the only request of this step."""
    (send,) = transfer.due(now_ns)
    assert transfer.due(now_ns) == []
    assert send.request is not None
    return send.request


def test_upload_sends_requested_items_until_the_verdict() -> None:
    upload = Upload(ITEMS, MISSION, 0)
    assert asked(upload, 0) == MissionCount(count=3, mission_type=MISSION)
    for seq, item in enumerate(ITEMS):
        upload.receive(MissionRequestInt(seq=seq, mission_type=MISSION), seq)
        assert asked(upload, seq) == item
    upload.receive(verdict(), 9)
    assert upload.outcome == Verdict(0, None, 4)
    assert upload.due(10**12) == []


SAVING = CommandAck(command=0, result=AckResult.IN_PROGRESS)


def test_robot_that_is_saving_is_asked_until_it_has_saved() -> None:
    """Wait for a slow disk longer than for a robot that does not answer."""
    clear, now_ns = Clear(MISSION, 0), 0
    for _ in range(4 * ATTEMPTS):
        assert asked(clear, now_ns) == MissionClearAll(mission_type=MISSION)
        now_ns += PATIENCE_NS
        clear.receive(SAVING, now_ns)
        assert not clear.over
    asked(clear, now_ns)
    clear.receive(verdict(Reason.NOT_SAVED), now_ns)
    assert clear.outcome == Verdict(Reason.NOT_SAVED, None, 4)


def test_robot_that_never_ends_saving_is_given_up() -> None:
    clear, now_ns = Clear(MISSION, 0), 0
    for _ in range(MAX_SAVING + ATTEMPTS):
        clear.due(now_ns)
        now_ns += PATIENCE_NS
        clear.receive(SAVING, now_ns)
    assert clear.due(now_ns) == []
    assert isinstance(clear.outcome, GaveUp)


def test_a_refusal_may_come_at_any_step_and_names_the_item() -> None:
    upload = Upload(ITEMS, MISSION, 0)
    asked(upload, 0)
    upload.receive(verdict(Reason.OUTSIDE_FENCE, 1), 1)
    assert isinstance(upload.outcome, Verdict)
    assert not upload.outcome.ok
    assert upload.outcome.text == "item 2: goal is outside of the fence"


def test_unanswered_request_repeats_at_a_fixed_interval() -> None:
    upload = Upload(ITEMS, MISSION, 0)
    first = asked(upload, 0)
    upload.unanswered("no process serves it")
    assert upload.due(PATIENCE_NS - 1) == []
    assert asked(upload, PATIENCE_NS) == first


def test_unanswered_transfer_ends_with_the_last_reason() -> None:
    download = Download(MISSION, 0)
    for attempt in range(ATTEMPTS):
        asked(download, attempt * PATIENCE_NS)
        download.unanswered(f"lost {attempt}")
    assert download.due(ATTEMPTS * PATIENCE_NS) == []
    assert download.outcome == GaveUp(f"lost {ATTEMPTS - 1}")


@each(
    "answer",
    [
        MissionRequestInt(seq=3, mission_type=MISSION),
        MissionRequestInt(seq=0, mission_type=MissionType.FENCE),
        verdict(kind=MissionType.FENCE),
        MissionCount(count=3),
        CommandAck(command=0, result=0),
        b"not a message at all",
    ],
)
def test_an_answer_that_is_out_of_turn_changes_nothing(answer: object) -> None:
    upload = Upload(ITEMS, MISSION, 0)
    first = asked(upload, 0)
    upload.receive(answer, 1)
    assert not upload.over
    assert asked(upload, PATIENCE_NS) == first


def test_a_robot_that_asks_for_ever_is_given_up() -> None:
    upload = Upload(ITEMS, MISSION, 0)
    for _ in range(10_000):
        if upload.due(0):
            upload.receive(MissionRequestInt(seq=0, mission_type=MISSION), 0)
    assert isinstance(upload.outcome, GaveUp)


def test_a_download_takes_every_item_in_order() -> None:
    download = Download(MISSION, 0)
    assert asked(download, 0) == MissionRequestList(mission_type=MISSION)
    download.receive(MissionCount(count=3, mission_type=MISSION), 1)
    for seq, item in enumerate(ITEMS):
        assert asked(download, 1) == MissionRequestInt(seq=seq, mission_type=MISSION)
        download.receive(item, 1)
    assert download.outcome == Downloaded(tuple(ITEMS))


def test_a_robot_without_a_mission_has_no_items() -> None:
    download = Download(MISSION, 0)
    asked(download, 0)
    download.receive(MissionCount(count=0, mission_type=MISSION), 1)
    assert download.outcome == Downloaded(())


def test_clearing_ends_with_a_verdict() -> None:
    clear = Clear(MissionType.FENCE, 0)
    assert asked(clear, 0) == MissionClearAll(mission_type=MissionType.FENCE)
    clear.receive(MissionCount(count=0), 1)
    assert not clear.over
    clear.receive(verdict(kind=MissionType.FENCE), 2)
    assert clear.outcome == Verdict(0, None, 4)


class Robot:
    """The other side, plainly: remembers what it was given."""

    def __init__(self) -> None:
        self.taken: list[MissionItemInt] = []
        self.count = 0

    def answer(self, frame: Message) -> Message:
        if isinstance(frame, MissionCount):
            self.count, self.taken = frame.count, []
        elif isinstance(frame, MissionItemInt) and frame.seq == len(self.taken):
            self.taken.append(frame)
        if isinstance(frame, MissionRequestList):
            return MissionCount(count=len(self.taken), mission_type=MISSION)
        if isinstance(frame, MissionRequestInt):
            return self.taken[frame.seq]
        if len(self.taken) < self.count:
            return MissionRequestInt(seq=len(self.taken), mission_type=MISSION)
        return verdict()


@given(
    st.integers(1, 30).map(lambda count: [Waypoint(x_m=float(at), y_m=1.0) for at in range(count)]),
    st.lists(st.sampled_from(["whole", "question lost", "answer lost"]), max_size=40),
)
def test_mission_arrives_complete_despite_losses(
    waypoints: list[Waypoint], fates: list[str]
) -> None:
    robot, items, waiting = Robot(), items_of(waypoints), iter(fates)
    there = carried(Upload(items, MISSION, 0), robot, waiting)
    if isinstance(there, Verdict):
        assert there.ok
        assert robot.taken == items
        back = carried(Download(MISSION, 0), robot, iter(fates))
        assert isinstance(back, GaveUp) or back == Downloaded(tuple(items))
    else:
        assert sum(fate != "whole" for fate in fates) >= ATTEMPTS


def carried(transfer: Transfer, robot: Robot, fates: Iterator[str]) -> object:
    """Over a link with such luck; afterwards nothing is lost any more."""
    now_ns = 0
    while not transfer.over:
        for send in transfer.due(now_ns):
            fate = next(fates, "whole")
            assert send.request is not None
            answer = None if fate == "question lost" else robot.answer(send.request)
            if answer is None or fate == "answer lost":
                transfer.unanswered(fate)
            else:
                transfer.receive(answer, now_ns)
        now_ns = max(now_ns, transfer.next_ns)
    return transfer.outcome


def test_a_robot_that_announces_too_many_items_is_left_alone() -> None:
    download = Download(MISSION, 0)
    download.due(0)
    download.receive(MissionCount(count=MAX_ITEMS + 1, mission_type=MISSION), 0)
    assert download.outcome == GaveUp("4097 items are announced, at most 4096")


def sent(items: list[MissionItemInt]) -> list[MissionItemInt]:
    """Return the items as they arrive, rounded to single precision."""
    encoder = Encoder(255, 190)
    arrived = [decode(encoder.encode(item)).message for item in items]
    assert all(isinstance(item, MissionItemInt) for item in arrived)
    return [item for item in arrived if isinstance(item, MissionItemInt)]


def rounded(waypoint: Waypoint) -> tuple[object, ...]:
    """Holds of a day have fewer digits in single precision."""
    heading = None if waypoint.heading_deg is None else round(waypoint.heading_deg, 3)
    tolerances = (waypoint.position_tolerance_m, waypoint.heading_tolerance_deg)
    return (waypoint.x_m, waypoint.y_m, heading, *(round(value, 3) for value in tolerances))


@given(missions(st.none(), thousandths(200, 180_000)))
def test_waypoints_arrive_as_they_were_typed(mission: Mission) -> None:
    arrived = Mission(waypoints=waypoints_of(sent(items_of(mission.waypoints))))
    for (_, one), (_, other) in zip(arrived.places, mission.places, strict=True):
        assert rounded(one) == rounded(other)
        assert one.hold_s == pytest.approx(other.hold_s, rel=1e-6)


@given(fences)
def test_a_fence_arrives_as_it_was_drawn(fence: Fence) -> None:
    arrived = fence_of(sent(fence_items_of(fence)))
    if isinstance(fence, Polygon):
        assert arrived == fence
    else:
        assert isinstance(arrived, Circle)
        assert isinstance(fence, Circle)
        assert (arrived.x_m, arrived.y_m) == (fence.x_m, fence.y_m)
        assert arrived.radius_m == pytest.approx(fence.radius_m, rel=1e-6)


def test_what_is_no_pose_and_no_fence_of_ours_is_the_robot_s_fault() -> None:
    (corner,) = fence_items_of(Circle(x_m=0.0, y_m=0.0, radius_m=1.0))
    with pytest.raises(RemoteError, match="item 1 of the robot is no step: command 5003"):
        waypoints_of([corner])
    with pytest.raises(RemoteError, match="of an unknown kind"):
        fence_of(items_of([Waypoint(x_m=0.0, y_m=0.0)]))
    assert fence_of([]) is None
    assert corner.command == Command.NAV_FENCE_CIRCLE_INCLUSION
