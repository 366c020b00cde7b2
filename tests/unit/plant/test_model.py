"""The model of a run: body, faults, movers, noise and scene."""

from dataclasses import astuple, fields
from math import dist, inf, nan, pi, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Body, Fault, Noise
from plant.model.geometry import movers, still
from plant.sim.physics import MovingDisc
from protocol.world import Polyline, WorldCircle, WorldPolygon
from tests.support.each import each
from tests.support.plant import room


def test_track_too_narrow_for_the_speed_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^track_m: 1e-06 is too narrow for max_speed_m_s"):
        Body(track_m=1e-6)


def test_default_robot_matches_the_figures() -> None:
    body = Body()
    assert (body.radius_m, body.track_m, body.max_speed_m_s) == (0.12, 0.20, 0.30)
    assert (body.max_acceleration_m_s2, 1.0 / body.ticks_per_m) == (1.5, 0.0002)


@each("name", [field.name for field in fields(Body)])
@each("value", [nan, inf, -inf, -1e12])
def test_impossible_dimension_is_rejected_by_name(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        Body(**{name: value})  # type: ignore[arg-type]


def test_only_motor_lag_and_minimum_range_may_be_zero() -> None:
    assert Body(motor_lag_s=0.0, sonar_min_m=0.0).motor_lag_s == 0.0
    with pytest.raises(ValueError, match=r"^track_m: 0.0 must be above zero"):
        Body(track_m=0.0)


def test_wheels_outside_the_robot_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"^track_m: .* wider than the robot"):
        Body(track_m=0.25)


def test_sonar_without_a_range_span_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^sonar_max_m: "):
        Body(sonar_max_m=0.02)


@each("start", [2**31, -(2**31) - 1])
def test_encoder_counter_starts_within_32_bits(start: int) -> None:
    with pytest.raises(ValueError, match=r"^left_start_ticks: .* does not fit 32 bits"):
        Body(left_start_ticks=start)


def test_unknown_fault_is_rejected_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"^kind: no fault 'sonar_ded'; there are sonar_dead, "):
        Fault("sonar_ded", "0")


@each(("kind", "target"), [("sonar_dead", "8"), ("wheel_stuck", "0")])
def test_wrong_fault_target_is_rejected(kind: str, target: str) -> None:
    with pytest.raises(ValueError, match=f"^target: '{target}' is none of "):
        Fault(kind, target)


@each("start_s", [-1.0, nan, inf])
def test_fault_needs_a_start_time(start_s: float) -> None:
    with pytest.raises(ValueError, match=r"^start_s: "):
        Fault("scan_stopped", "", start_s)


@each("end_s", [1.0, 0.0, nan])
def test_fault_must_end_after_its_start(end_s: float) -> None:
    with pytest.raises(ValueError, match=r"^end_s: "):
        Fault("scan_stopped", "", 1.0, end_s)


@each("value", [nan, inf, -0.1, 1.1])
def test_fault_share_is_between_0_and_1(value: float) -> None:
    with pytest.raises(ValueError, match=r"^value: .* is not within 0 to 1 for wheel_slip"):
        Fault("wheel_slip", "left", value=value)


def test_negative_robot_of_a_fault_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^robot: "):
        Fault("scan_stopped", robot=-1)


CORNER = WorldCircle(
    x_m=0.0, y_m=0.0, radius_m=0.1, path_m=((0.0, 0.0), (1.0, 0.0), (1.0, 2.0)), speed_m_s=0.5
)


@each(
    ("time_s", "place"),
    [
        (0.0, (0.0, 0.0)),
        (1.0, (0.5, 0.0)),
        (2.0, (1.0, 0.0)),
        (4.0, (1.0, 1.0)),
        (6.0, (1.0, 2.0)),
        (8.0, (1.0, 1.0)),
        (12.0, (0.0, 0.0)),
        (13.0, (0.5, 0.0)),
    ],
)
def test_obstacle_moves_back_and_forth_along_its_waypoints(
    time_s: float, place: tuple[float, float]
) -> None:
    assert MovingDisc(CORNER).position_m(time_s) == pytest.approx(place)


def test_obstacle_passes_a_repeated_waypoint() -> None:
    path = ((0.0, 0.0), (0.0, 0.0), (1.0, 0.0))
    mover = MovingDisc(WorldCircle(x_m=0.0, y_m=0.0, radius_m=0.1, path_m=path, speed_m_s=1.0))
    assert mover.position_m(0.0) == (0.0, 0.0)
    assert mover.position_m(0.25) == pytest.approx((0.25, 0.0))


@given(st.floats(0.0, 1e5), st.floats(0.0, 10.0))
def test_obstacle_never_exceeds_its_speed(time_s: float, span_s: float) -> None:
    mover = MovingDisc(CORNER)
    way_m = dist(mover.position_m(time_s), mover.position_m(time_s + span_s))
    assert way_m <= 0.5 * span_s + 1e-9


def test_noise_has_four_levels() -> None:
    assert list(LEVELS) == ["none", "default", "lossy", "harsh"]


def test_level_none_has_no_noise() -> None:
    assert astuple(LEVELS["none"]) == (0.0, 0.0, 0.0, 0.0, pi / 2, 0.0, 0.0)


def test_level_lossy_is_default_without_grazing_echoes() -> None:
    default, lossy = astuple(LEVELS["default"]), astuple(LEVELS["lossy"])
    assert default == (0.003, 0.01, 0.005, 0.001, pi / 2, 2e-6, 0.0)
    assert lossy == (*default[:4], radians(40.0), *default[5:])


def test_level_harsh_has_fixed_values() -> None:
    assert astuple(LEVELS["harsh"]) == (0.01, 0.02, 0.03, 0.01, radians(40.0), 2e-5, 0.005)


@each("name", [field.name for field in fields(Noise)])
@each("value", [nan, inf, -inf, -0.3, 2.0])
def test_value_out_of_range_is_rejected_by_name(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        Noise(**{name: value})


SQUARE = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0))


def test_room_has_four_walls_visible_from_inside() -> None:
    edges = still(room()).edges
    assert len(edges) == 4
    for ax, ay, bx, by in edges:  # the middle of the room lies to the right of each
        assert (bx - ax) * (2.0 - ay) - (by - ay) * (2.0 - ax) < 0.0


def test_open_floor_has_no_shapes() -> None:
    assert still(room(walls=False)) == ((), ())


def test_polygon_is_visible_from_outside_in_either_orientation() -> None:
    forth = still(room(WorldPolygon(SQUARE), walls=False)).edges
    back = still(room(WorldPolygon(SQUARE[::-1]), walls=False)).edges
    assert set(forth) == set(back)
    assert (1.0, 1.0, 2.0, 1.0) in forth


def test_wall_has_two_flanks_per_segment_and_a_disc_per_point() -> None:
    scene = still(room(Polyline(((1.0, 1.0), (2.0, 1.0), (2.0, 3.0)), 0.1), walls=False))
    assert [disc[2] for disc in scene.discs] == [0.05] * 3
    assert len(scene.edges) == 4
    assert (1.0, 0.95, 2.0, 0.95) in scene.edges


def test_moving_circle_is_not_part_of_the_static_scene() -> None:
    still_one = WorldCircle(x_m=3.0, y_m=3.0, radius_m=0.2)
    path = ((1.0, 1.0), (2.0, 1.0))
    waiting = WorldCircle(x_m=1.0, y_m=1.0, radius_m=0.3, path_m=path, speed_m_s=0.0)
    moving = WorldCircle(x_m=1.0, y_m=1.0, radius_m=0.1, path_m=path, speed_m_s=0.1)
    world = room(still_one, waiting, moving, walls=False)
    assert still(world).discs == ((3.0, 3.0, 0.2), (1.0, 1.0, 0.3))
    assert movers(world) == (moving,)
