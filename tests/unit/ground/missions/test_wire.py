"""A mission on the wire and back: places to the last tenth of a millimetre, all else as typed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.missions.mission import Circle, Fence, Mission, Polygon, Waypoint
from ground.missions.transfer import fence_items_of, fence_of, items_of, waypoints_of
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import Command
from protocol.wire.messages import MissionItemInt
from runtime.errors import RemoteError
from tests.support.ground.missions.made_up import fences, missions, thousandths


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
    arrived = waypoints_of(sent(items_of(mission.waypoints)))
    assert [rounded(one) for one in arrived] == [rounded(one) for one in mission.waypoints]
    for one, other in zip(arrived, mission.waypoints, strict=True):
        assert one.hold_s == pytest.approx(other.hold_s, rel=1e-6)


@given(fences)
def test_a_fence_arrives_as_it_was_drawn(fence: Fence) -> None:
    arrived = fence_of(sent(fence_items_of(fence)))
    if isinstance(fence, Polygon):
        assert arrived == fence
    else:
        assert isinstance(arrived, Circle)
        assert (arrived.x_m, arrived.y_m) == (fence.x_m, fence.y_m)
        assert arrived.radius_m == pytest.approx(fence.radius_m, rel=1e-6)


def test_what_is_no_pose_and_no_fence_of_ours_is_the_robot_s_fault() -> None:
    (corner,) = fence_items_of(Circle(x_m=0.0, y_m=0.0, radius_m=1.0))
    with pytest.raises(RemoteError, match="item 1 of the robot is not a pose: command 5003"):
        waypoints_of([corner])
    with pytest.raises(RemoteError, match="of an unknown kind"):
        fence_of(items_of([Waypoint(x_m=0.0, y_m=0.0)]))
    assert fence_of([]) is None
    assert corner.command == Command.NAV_FENCE_CIRCLE_INCLUSION
