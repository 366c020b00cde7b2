"""A mission is the same, whether it is read from a `.plan` or uploaded by MAVLink."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.missions.plan_items import item_in, usual
from ground.missions import qgroundcontrol
from ground.missions.mission import Home, Polygon, Waypoint
from ground.missions.qgroundcontrol import Item, to_local, waypoint_of
from ground.missions.transfer import items_of
from tests.support.gateway.fake_port import ORIGIN
from tests.support.gateway.mission_bench import (
    E7,
    FENCE,
    MissionBench,
    as_float,
    item_int,
    messages_of,
    planned,
    single,
    upload,
)

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
    assert waypoint_of(usual(item_in(message)), home) == waypoint_of(in_plan, home)


def test_float_items_are_exact_to_a_metre_only() -> None:
    """MISSION_ITEM has 24 bits for a place: the mission is near, and not the same."""
    bench, plan = MissionBench(), planned(*TOUR, fence=FENCED)
    exact = qgroundcontrol.read_plan(json.dumps(plan), "tour.plan").mission.waypoints
    assert upload(bench, messages_of(plan), form=as_float).results == [0]
    assert bench.waypoints != exact
    for one, other in zip(bench.waypoints, exact, strict=True):
        assert (one.x_m, one.y_m) == pytest.approx((other.x_m, other.y_m), abs=1.0)


def test_places_beyond_7_decimals_are_rounded_by_mavlink() -> None:
    """A plan with more decimals is another mission by MAVLink, by at most 8 mm."""
    sent = item_int(1, x=round(47.377012345678 * E7), y=round(8.541812345678 * E7))
    given_place = to_local(ORIGIN, 47.377012345678, 8.541812345678)
    found = waypoint_of(item_in(sent), ORIGIN)
    assert (found.x_m, found.y_m) == pytest.approx(given_place, abs=0.008)
    assert (found.x_m, found.y_m) != given_place
