"""The origin moves for a disarmed robot; every request is answered with the one in force."""

import pytest

from gateways.mavlink.commands.vehicle_commands import SET_GLOBAL_ORIGIN
from gateways.mavlink.coordinates import GlobalPlace, home_at, local_at
from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.motion.setpoints import place_goal
from gateways.mavlink.services import face_of
from gateways.mavlink.telemetry_messages import global_position
from protocol.wire.enums import Vehicle
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, ORIGIN, OTHER, Bench
from tests.support.gateway.telemetry import everything, status

HERE = (473_769_000, 85_417_000)
THERE = (480_000_000, 90_000_000)


def whole_bench(**telemetry: object) -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry = everything() | telemetry
    bench.after(0.02)
    bench.sent()
    return bench


def move(bench: Bench, place: tuple[int, int], height_mm: int = 5000) -> MavMessage:
    """Return GPS_GLOBAL_ORIGIN, which is sent in any case."""
    found = bench.send(mavlink.MAVLink_set_gps_global_origin_message(1, *place, height_mm))
    (origin,) = [one for one in found if one.get_type() == "GPS_GLOBAL_ORIGIN"]
    texts = [one for one in found if one.get_type() == "STATUSTEXT"]
    is_moved = (origin.latitude, origin.longitude) == place
    assert bool(texts) != is_moved
    return origin


def test_origin_moves() -> None:
    bench = whole_bench()
    origin = move(bench, THERE)
    assert (origin.latitude, origin.longitude, origin.altitude) == (*THERE, 5000)
    assert bench.vehicle.origin.latitude_deg == 48.0


@each(
    "place",
    [THERE, (850_000_000, 1_800_000_000), (-850_000_000, -1_800_000_000), (1, 1_799_999_999)],
)
def test_positions_and_goals_move_with_the_origin(place: tuple[int, int]) -> None:
    bench = whole_bench()
    move(bench, place)
    home = home_at(GlobalPlace(*place))
    assert home is not None
    (here,) = global_position(bench.vehicle, bench.now_ns)
    assert local_at(home, GlobalPlace(here.lat, here.lon)) == pytest.approx((3.0, 4.0), abs=0.01)
    goal = place_goal(bench.vehicle.origin, here.lat / 1e7, here.lon / 1e7, None)
    assert (goal.x_m, goal.y_m) == pytest.approx((3.0, 4.0), abs=0.01)


def test_home_is_told_with_the_new_origin() -> None:
    bench = whole_bench()
    found = bench.send(mavlink.MAVLink_set_gps_global_origin_message(1, *THERE, 5000))
    (home,) = [one for one in found if one.get_type() == "HOME_POSITION"]
    assert (home.latitude, home.longitude, home.altitude) == (*THERE, 5000)


@each("state", [status(vehicle=Vehicle.ACTIVE), None])
def test_origin_stays_unless_the_robot_is_disarmed(state: object) -> None:
    bench = whole_bench(status=state)
    origin = move(bench, THERE)
    assert (origin.latitude, origin.longitude) == HERE
    assert bench.vehicle.origin == ORIGIN


def test_same_origin_is_accepted_while_armed() -> None:
    bench = whole_bench(status=status(vehicle=Vehicle.ACTIVE))
    assert move(bench, HERE, 0).latitude == HERE[0]


@each("place", [(0, 0), (900_000_000, 1), (1, -1_800_000_001), (2**31 - 1, 5)])
def test_place_beyond_the_globe_is_refused(place: tuple[int, int]) -> None:
    bench = whole_bench()
    assert move(bench, place).latitude == HERE[0]


def test_origin_in_space_is_refused() -> None:
    assert move(whole_bench(), THERE, 2**31 - 1).latitude == HERE[0]


def test_other_client_does_not_move_the_origin() -> None:
    bench = whole_bench()
    bench.vehicle.control.ensure(OTHER, lambda _: None)
    assert move(bench, THERE).latitude == HERE[0]


def test_client_that_may_only_watch_does_not_move_the_origin() -> None:
    bench = whole_bench()
    message = mavlink.MAVLink_set_gps_global_origin_message(1, *THERE, 0)
    bench.send(message, CLIENT._replace(barred=WATCHER))
    assert bench.vehicle.origin == ORIGIN


@each(
    ("x", "height_m", "result"),
    [
        (THERE[0], 5.0, mavlink.MAV_RESULT_ACCEPTED),
        (950_000_000, 5.0, mavlink.MAV_RESULT_DENIED),
        (THERE[0], float("nan"), mavlink.MAV_RESULT_DENIED),
    ],
)
def test_command_moves_the_origin_too(x: int, height_m: float, result: int) -> None:
    bench = whole_bench()
    frame = mavlink.MAV_FRAME_GLOBAL
    place = (x, THERE[1], height_m)
    command = mavlink.MAVLink_command_int_message(
        *(1, 1, frame, SET_GLOBAL_ORIGIN, 0, 0, 0.0, 0.0, 0.0, 0.0), *place
    )
    command._header.seq = 1
    found = bench.send(command)
    assert [one.result for one in found if one.get_type() == "COMMAND_ACK"] == [result]
    moved = bench.vehicle.origin != ORIGIN
    assert moved == (result == mavlink.MAV_RESULT_ACCEPTED)
