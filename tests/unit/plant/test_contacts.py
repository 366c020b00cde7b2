"""Wheels, contacts and clearance in the physics engine."""

from itertools import accumulate
from math import cos, dist, exp, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.corpus import generate
from plant.model.configuration import LEVELS, Body, Fault, Noise
from plant.model.geometry import clearance_m, inside
from plant.sim.active_faults import NO_TROUBLE, ActiveFaults, FaultSchedule
from plant.sim.drive import DifferentialDrive, Motor
from plant.sim.physics import CLEARANCE_LIMIT_M, Arena
from plant.sim.simulation import Plant
from protocol.wire.messages import RunScore
from protocol.world import Obstacle, Point, Polyline, World, WorldCircle, WorldPolygon
from runtime.units import NS_PER_MS as MS
from tests.support.each import each
from tests.support.plant import FOREVER_NS, NONE, bumper, drive, room

LEFT, RIGHT, REAR = 1, 2, 4
THIN_WALL = Polyline(((2.0, 0.0), (2.0, 4.0)), 0.01)
BAY = WorldPolygon(
    ((2.0, 1.0), (3.0, 1.0), (3.0, 3.0), (2.0, 3.0), (2.0, 2.8), (2.8, 2.8), (2.8, 1.2), (2.0, 1.2))
)


def plant(world: World, robots: int = 1) -> Plant:
    return Plant(world, 1, NONE, robots=robots)


@each(
    ("obstacle", "stopped_at_m"),
    [
        (THIN_WALL, 1.995),
        (WorldCircle(x_m=2.5, y_m=2.0, radius_m=0.4), 2.1),
        (BAY, 2.8),
        (WorldPolygon(((2.5, 1.0), (3.0, 1.0), (3.0, 3.0), (2.5, 3.0))), 2.5),
    ],
)
def test_robot_stops_at_an_obstacle(obstacle: Obstacle, stopped_at_m: float) -> None:
    one = plant(room(obstacle, start=(1.5, 2.0, 0.0)))
    deepest_m = 0.0
    for _ in range(200):
        drive(one, 0.3, 0.3, 1)
        deepest_m = min(deepest_m, one.truth().clearance_m)
    truth = one.truth()
    assert truth.x_m == pytest.approx(stopped_at_m - 0.12, abs=5e-4)
    assert (truth.contact, bumper(one), truth.speed_m_s) == (1, LEFT | RIGHT, 0.0)
    assert -0.001 < deepest_m <= 0.0
    assert one.score(FOREVER_NS).contacts == 1


def test_outer_wall_stops_and_releases_the_robot() -> None:
    one = plant(room(start=(3.7, 2.0, 0.0)))
    drive(one, 0.3, 0.3, 60)
    assert one.truth().x_m == pytest.approx(3.88, abs=5e-4)
    drive(one, -0.3, -0.3, 40)
    assert (one.truth().contact, bumper(one)) == (0, 0)
    assert one.truth().x_m < 3.5
    drive(one, 0.3, 0.3, 80)
    assert one.score(FOREVER_NS).contacts == 2


def test_robot_leaves_the_floor_without_outer_walls() -> None:
    one = plant(room(start=(3.7, 2.0, 0.0), walls=False))
    drive(one, 0.3, 0.3, 60)
    assert one.truth().x_m > 4.3
    assert one.truth().contact == 0


def test_robot_slides_along_a_wall_met_at_an_angle() -> None:
    one = plant(room(start=(3.5, 1.0, radians(35.0))))
    drive(one, 0.3, 0.3, 120)
    assert one.truth().x_m == pytest.approx(3.88, abs=5e-4)
    assert one.truth().y_m == pytest.approx(1.0 + 0.3 * sin(radians(35.0)) * 6.0, abs=0.03)
    assert (bumper(one), one.score(FOREVER_NS).contacts) == (RIGHT, 1)


@each(
    ("bearing_deg", "sectors"),
    [
        (0, LEFT | RIGHT),
        (30, LEFT),
        (-30, RIGHT),
        (100, LEFT),
        (-100, RIGHT),
        (150, REAR),
        (180, REAR),
    ],
)
def test_bumper_reports_the_touched_sector(bearing_deg: float, sectors: int) -> None:
    towards_rad = 1.0 + radians(bearing_deg)  # straight away from the pillar, which comes near
    far, near = 0.35, 0.2
    path = tuple((2.0 + d * cos(towards_rad), 2.0 + d * sin(towards_rad)) for d in (far, near))
    pillar = WorldCircle(x_m=path[0][0], y_m=path[0][1], radius_m=0.1, path_m=path, speed_m_s=0.1)
    one = plant(room(pillar, start=(2.0, 2.0, 1.0)))
    while not one.truth().contact:
        one.advance()
    assert bumper(one) == sectors


@each("angle_deg", range(0, 90, 7))
def test_robot_never_pushes_through_a_thin_wall(angle_deg: int) -> None:
    one = plant(room(THIN_WALL, start=(1.7, 2.0, radians(angle_deg)), robot={"max_speed_m_s": 1.5}))
    for _ in range(60):
        drive(one, 1.5, 1.5, 1)
        assert one.truth().x_m <= 2.0 - 0.12
    drive(one, -1.5, 1.5, 2)
    drive(one, 1.5, 1.2, 60)
    assert one.truth().x_m <= 2.0 - 0.12


def test_clearance_is_from_rim_to_nearest_surface() -> None:
    obstacles = (BAY, THIN_WALL, WorldCircle(x_m=0.5, y_m=0.5, radius_m=0.2))
    one = plant(room(*obstacles, start=(0.9, 2.0, -1.2)))
    for _ in range(100):
        drive(one, 0.3, 0.2, 1)
        truth = one.truth()
        gaps_m = [clearance_m((truth.x_m, truth.y_m), obstacle) for obstacle in obstacles]
        rim_m = min(truth.x_m, truth.y_m, 4.0 - truth.x_m, 4.0 - truth.y_m)
        assert truth.clearance_m == pytest.approx(min(*gaps_m, rim_m) - 0.12, abs=1e-9)


def test_clearance_far_from_obstacles_is_the_limit() -> None:
    assert plant(room(size_m=(40.0, 40.0), start=(20.0, 20.0, 0.0))).truth().clearance_m == 3.0


def test_two_robots_do_not_pass_through_each_other() -> None:
    pair = plant(room(start=(1.0, 1.8, pi / 2)), robots=2)
    assert pair.truth(1).x_m == pytest.approx(0.4)
    for _ in range(48):  # the one on the right turns left, towards the other
        pair.command(0, -2000, 2000, 150)
        pair.advance()
    nearest_m, touched = 1.0, 0
    for _ in range(60):
        drive(pair, 0.3, 0.3, 1)
        truths = [pair.truth(robot) for robot in (0, 1)]
        nearest_m = min(nearest_m, dist(*((truth.x_m, truth.y_m) for truth in truths)))
        touched += truths[0].contact and truths[1].contact
    assert nearest_m > 0.24 - 0.001
    assert touched > 10


def walker(bearing_rad: float, speed_m_s: float = 0.2) -> WorldCircle:
    """Return a pedestrian that walks straight at the middle of the room."""
    ways = ((2.0 + d * cos(bearing_rad), 2.0 + d * sin(bearing_rad)) for d in (0.6, -0.6))
    path = tuple(ways)
    return WorldCircle(
        x_m=path[0][0], y_m=path[0][1], radius_m=0.2, path_m=path, speed_m_s=speed_m_s
    )


def until_touched(one: Plant, left_m_s: float, right_m_s: float) -> tuple[int, int]:
    """Return all contacts and own contacts after the first touch."""
    for _ in range(200):
        drive(one, left_m_s, right_m_s, 1)
        if one.truth().contact:
            break
    score = one.score(FOREVER_NS)
    return score.contacts, score.own_contacts


@each("bearing_deg", range(0, 360, 45))
@each("spin_m_s", [0.0, 0.2])
def test_contact_of_a_still_or_turning_robot_is_not_its_own(
    bearing_deg: int, spin_m_s: float
) -> None:
    one = plant(room(walker(radians(bearing_deg)), start=(2.0, 2.0, 0.3)))
    assert until_touched(one, -spin_m_s, spin_m_s) == (1, 0)


@each(
    ("bearing_deg", "speed_m_s", "own"),
    [
        (0, 0.1, 1),  # towards each other
        (180, -0.1, 1),  # towards each other, backwards
        (180, 0.05, 0),  # overtaken from behind
        (0, -0.05, 0),  # backing away, too slowly
        (135, 0.05, 0),  # overtaken from behind, aslant
        (45, 0.05, 1),
    ],
)
def test_contact_is_caused_by_the_body_that_approaches(
    bearing_deg: int, speed_m_s: float, own: int
) -> None:
    one = plant(room(walker(radians(bearing_deg)), start=(2.0, 2.0, 0.0)))
    assert until_touched(one, speed_m_s, speed_m_s) == (1, own)


def test_contact_with_a_wall_is_always_the_robots() -> None:
    assert until_touched(plant(room(THIN_WALL, start=(1.5, 2.0, 0.0))), 0.02, 0.02) == (0, 0)
    assert until_touched(plant(room(THIN_WALL, start=(1.8, 2.0, 0.0))), 0.02, 0.02) == (1, 1)


def test_moving_obstacle_pushes_the_robot_away() -> None:
    roller = WorldCircle(
        x_m=1.0, y_m=2.0, radius_m=0.3, path_m=((1.0, 2.0), (3.0, 2.0)), speed_m_s=0.5
    )
    one = plant(room(roller, start=(2.0, 2.0, 0.0)))
    for _ in range(60):
        one.advance()
        assert one.truth().clearance_m > -0.002
    assert one.truth().x_m == pytest.approx(1.0 + 0.5 * 3.0 + 0.42, abs=2e-3)
    assert bumper(one) == REAR


def test_robot_between_mover_and_wall_stays_in_the_room() -> None:
    press = WorldCircle(
        x_m=1.0, y_m=2.0, radius_m=0.3, path_m=((1.0, 2.0), (3.9, 2.0)), speed_m_s=0.5
    )
    one = plant(room(press, start=(3.5, 2.0, 0.0)))
    for _ in range(200):
        one.advance()
        assert one.truth().x_m < 3.89


def test_grazing_a_static_obstacle_is_the_robots_contact() -> None:
    """Half a degree off along a wall, the robot approaches it by 3 mm/s."""
    one = plant(room(start=(1.0, 0.125, -0.009)))
    assert until_touched(one, 0.3, 0.3) == (1, 1)


SUBSTEP_S = 0.025
QUICK = Body(max_acceleration_m_s2=1e6, motor_lag_s=0.0)
speeds = st.floats(-0.3, 0.3)


def mrad_s(rim_m_s: float) -> int:
    return round(rim_m_s / 0.033 * 1000.0)


def run(
    drive: DifferentialDrive,
    left_m_s: float,
    right_m_s: float,
    steps: int,
    trouble: ActiveFaults = NO_TROUBLE,
) -> tuple[float, float]:
    """Return the poses of a drive with a new command in each step."""
    left_m = right_m = 0.0
    for _ in range(steps):
        drive.command(mrad_s(left_m_s), mrad_s(right_m_s), 150, 0)
        left, right = drive.roll(0, SUBSTEP_S, trouble)
        left_m, right_m = left_m + left, right_m + right
    return left_m, right_m


def test_small_speed_change_lags_exponentially() -> None:
    motor = Motor(Body(motor_lag_s=0.05))
    motor.turn(0.05, 0.03)
    assert motor.speed_m_s == pytest.approx(0.05 * (1.0 - exp(-0.6)), abs=1e-12)


def test_large_speed_change_is_limited_by_acceleration() -> None:
    motor = Motor(Body())
    way_m = motor.turn(0.3, 0.1)
    assert motor.speed_m_s == pytest.approx(0.15, abs=1e-12)
    assert way_m == pytest.approx(0.5 * 1.5 * 0.1**2, abs=1e-12)


@given(speeds, speeds, st.integers(1, 40), st.floats(0.0, 0.2))
def test_motor_result_does_not_depend_on_the_step_size(
    start_m_s: float, wanted_m_s: float, parts: int, lag_s: float
) -> None:
    whole, cut = Motor(Body(motor_lag_s=lag_s)), Motor(Body(motor_lag_s=lag_s))
    whole.speed_m_s = cut.speed_m_s = start_m_s
    whole_m = whole.turn(wanted_m_s, 0.4)
    cut_m = sum(cut.turn(wanted_m_s, 0.4 / parts) for _ in range(parts))
    assert cut.speed_m_s == pytest.approx(whole.speed_m_s, abs=1e-9)
    assert cut_m == pytest.approx(whole_m, abs=1e-9)


@given(speeds, speeds, st.floats(1e-3, 1.0), st.floats(0.0, 0.5))
def test_motor_limits_acceleration_and_never_overshoots(
    start_m_s: float, wanted_m_s: float, span_s: float, lag_s: float
) -> None:
    motor = Motor(Body(motor_lag_s=lag_s))
    motor.speed_m_s = start_m_s
    way_m = motor.turn(wanted_m_s, span_s)
    slowest, fastest = sorted((start_m_s, wanted_m_s))
    assert abs(motor.speed_m_s - start_m_s) <= 1.5 * span_s + 1e-9
    assert slowest - 1e-9 <= motor.speed_m_s <= fastest + 1e-9
    assert slowest * span_s - 1e-9 <= way_m <= fastest * span_s + 1e-9


@given(speeds, st.floats(1e-4, 1.0))
def test_braked_motor_stops_and_does_not_reverse(start_m_s: float, span_s: float) -> None:
    motor = Motor(Body())
    motor.speed_m_s = start_m_s
    way_m = motor.brake(8.0, span_s)
    assert abs(motor.speed_m_s) == pytest.approx(max(0.0, abs(start_m_s) - 8.0 * span_s), abs=1e-9)
    assert motor.speed_m_s * start_m_s >= 0.0
    assert abs(way_m) <= abs(start_m_s) ** 2 / 16.0 + 1e-9


@given(st.integers(), st.integers())
def test_no_command_exceeds_the_maximum_wheel_speed(left_mrad_s: int, right_mrad_s: int) -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    drive.command(left_mrad_s, right_mrad_s, 150, 0)
    ways_m = drive.roll(0, SUBSTEP_S, NO_TROUBLE)
    assert max(abs(way_m) for way_m in ways_m) <= 0.3 * SUBSTEP_S + 1e-12


def test_wheels_brake_when_the_command_expires() -> None:
    drive = DifferentialDrive(Body(), LEVELS["none"], 1, 0)
    run(drive, 0.3, 0.3, 40)
    drive.command(mrad_s(0.3), mrad_s(0.3), 150, 0)
    for now_ms in range(0, 150, 25):
        assert drive.roll(now_ms * MS, SUBSTEP_S, NO_TROUBLE)[0] > 0.0074
        assert not drive.expired
    drive.roll(150 * MS, SUBSTEP_S, NO_TROUBLE)
    assert drive.expired
    drive.roll(175 * MS, SUBSTEP_S, NO_TROUBLE)
    assert drive.roll(200 * MS, SUBSTEP_S, NO_TROUBLE) == (0.0, 0.0)


def test_new_command_ends_the_expiry() -> None:
    drive = DifferentialDrive(Body(), LEVELS["none"], 1, 0)
    drive.command(1000, 1000, 25, 0)
    drive.roll(25 * MS, SUBSTEP_S, NO_TROUBLE)
    assert drive.expired
    drive.command(1000, 1000, 150, 50 * MS)
    drive.roll(50 * MS, SUBSTEP_S, NO_TROUBLE)
    assert not drive.expired


def test_no_command_has_expired_before_the_first() -> None:
    drive = DifferentialDrive(Body(), LEVELS["none"], 1, 0)
    assert drive.roll(10**12, SUBSTEP_S, NO_TROUBLE) == (0.0, 0.0)
    assert not drive.expired


def test_encoder_counts_whole_ticks_of_0_2_mm() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    left_m, right_m = run(drive, 0.1, -0.1, 40)
    assert left_m == pytest.approx(0.1, rel=2e-4)
    assert drive.ticks() == (int(left_m * 5000.0), -int(-right_m * 5000.0) - 1)


@each(("start", "rim_m_s"), [(2**31 - 100, 0.1), (-(2**31) + 100, -0.1)])
def test_encoder_counter_wraps_at_32_bits(start: int, rim_m_s: float) -> None:
    drive = DifferentialDrive(
        Body(max_acceleration_m_s2=1e6, motor_lag_s=0.0, left_start_ticks=start),
        LEVELS["none"],
        1,
        0,
    )
    run(drive, rim_m_s, rim_m_s, 40)
    left, right = drive.ticks()
    assert left * start < 0
    assert (left - start + 2**31) % 2**32 - 2**31 == pytest.approx(right, abs=1)


def test_unequal_wheels_roll_different_distances_per_turn() -> None:
    drive = DifferentialDrive(QUICK, Noise(diameter_difference_ratio=0.005), 1, 0)
    left_m, right_m = run(drive, 0.2, 0.2, 40)
    assert drive.ticks()[0] == drive.ticks()[1]
    assert right_m / left_m - 1.0 == pytest.approx(0.005, rel=0.01)


def test_slip_variance_grows_with_wheel_distance() -> None:
    drive = DifferentialDrive(QUICK, Noise(slip_variance_m=2e-6), 7, 0)
    rows = 20_000
    errors = np.empty((rows, 2))
    for row in range(rows):
        left_m, right_m = run(drive, 0.2, -0.1, 1)
        errors[row] = left_m - 0.2 * SUBSTEP_S, right_m + 0.1 * SUBSTEP_S
    per_metre = errors.var(axis=0) / (0.2 * SUBSTEP_S, 0.1 * SUBSTEP_S)
    assert per_metre == pytest.approx(2e-6, rel=0.05)
    assert abs((errors[:, 0] * errors[:, 1]).mean()) < 0.03 * errors.std() ** 2
    assert abs(errors.mean()) < 5e-6


def test_wheel_at_rest_does_not_slip() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["harsh"], 1, 0)
    assert run(drive, 0.0, 0.0, 10) == (0.0, 0.0)


def test_slipping_wheel_counts_more_than_it_rolls() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    trouble = FaultSchedule([Fault("wheel_slip", "right", value=0.3)]).at(0)
    left_m, right_m = run(drive, 0.2, 0.2, 40, trouble)
    assert right_m == pytest.approx(0.7 * left_m)
    assert drive.ticks()[0] == drive.ticks()[1]


def test_stuck_wheel_neither_rolls_nor_counts() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    left_m, right_m = run(drive, 0.2, 0.2, 4, FaultSchedule([Fault("wheel_stuck", "left")]).at(0))
    assert (left_m, drive.ticks()[0]) == (0.0, 0)
    assert (right_m > 0.0, drive.ticks()[1] > 0) == (True, True)


def test_stuck_encoder_misses_the_distance_rolled_meanwhile() -> None:
    drive = DifferentialDrive(QUICK, LEVELS["none"], 1, 0)
    run(drive, 0.2, 0.2, 4)
    before = drive.ticks()
    left_m, _ = run(drive, 0.2, 0.2, 4, FaultSchedule([Fault("encoder_stuck", "left")]).at(0))
    assert left_m == pytest.approx(0.02, rel=2e-4)
    assert drive.ticks() == (before[0], 2 * before[1])
    run(drive, 0.2, 0.2, 4)
    assert drive.ticks() == (2 * before[0], 3 * before[1])


FASTEST_MRAD_S = 9000
COMMANDS = st.lists(
    st.tuples(
        st.integers(-FASTEST_MRAD_S, FASTEST_MRAD_S), st.integers(-FASTEST_MRAD_S, FASTEST_MRAD_S)
    ),
    min_size=1,
    max_size=6,
)


def driven(
    family: str, commands: list[tuple[int, int]], noise: str, *, always_ask: bool
) -> RunScore:
    """Return the score after two seconds of each command."""
    plant = Plant(generate(family, 1, 9), 3, LEVELS[noise])
    if always_ask:
        plant._alone = False
    for left_mrad_s, right_mrad_s in commands:
        for _ in range(40):
            plant.command(0, left_mrad_s, right_mrad_s, 300)
            plant.advance()
    return plant.score(plant.now_ns)


@settings(max_examples=15, deadline=None)
@given(
    st.sampled_from(["forest_dense", "u_trap", "maze", "open", "door"]),
    COMMANDS,
    st.sampled_from(list(LEVELS)),
)
def test_trajectory_is_identical_with_and_without_the_arena(
    family: str, commands: list[tuple[int, int]], noise: str
) -> None:
    one = driven(family, commands, noise, always_ask=False)
    assert one == driven(family, commands, noise, always_ask=True)


@each("family", ["forest_dense", "maze"])
def test_trajectory_is_identical_through_contacts_too(family: str) -> None:
    commands = [(9000, 9000), (-9000, -8500), (9000, 8000), (-9000, -9000), (9000, 9000)] * 2
    one = driven(family, commands, "harsh", always_ask=False)
    assert one.contacts > 1
    assert one == driven(family, commands, "harsh", always_ask=True)


RADIUS_M = 0.12
TRIANGLE = WorldPolygon(points_m=((1.0, 3.0), (2.5, 3.2), (1.3, 4.0)))
STILL: tuple[Obstacle, ...] = (
    *(
        WorldCircle(x_m=1.0 + 0.9 * i, y_m=1.0 + 0.7 * j, radius_m=0.1)
        for i in range(5)
        for j in (0, 1)
    ),
    TRIANGLE,
    Polyline(points_m=((3.0, 3.0), (4.5, 3.1), (4.6, 3.1), (4.6, 4.4)), thickness_m=0.07),
)


def arena() -> Arena:
    made = Arena(room(*STILL, size_m=(50.0, 12.0)), RADIUS_M)
    made.add_robot(0.5, 0.5)
    return made


def step_m() -> st.SearchStrategy[float]:
    return st.floats(-0.2, 0.2) | st.floats(-0.02, 0.02)


@settings(max_examples=50, deadline=None)
@given(
    st.tuples(st.floats(0.2, 9.0), st.floats(0.2, 9.0)),
    st.lists(st.tuples(step_m(), step_m()), max_size=60),
)
def test_cached_clearance_is_bit_identical(start: Point, steps: list[Point]) -> None:
    remembering = arena()
    for at in accumulate(steps, lambda a, b: (a[0] + b[0], a[1] + b[1]), initial=start):
        assert remembering.clearance_m(0, at) == arena().clearance_m(0, at)


@settings(max_examples=50, deadline=None)
@given(st.tuples(st.floats(0.2, 9.0), st.floats(0.2, 9.0)))
def test_clearance_is_that_of_the_geometry(at: Point) -> None:
    gaps_m = [clearance_m(at, obstacle) for obstacle in STILL]
    nearest_m = min(*gaps_m, at[0], at[1], 50.0 - at[0], 12.0 - at[1])
    if not inside(at, TRIANGLE.points_m):
        wanted_m = min(nearest_m - RADIUS_M, CLEARANCE_LIMIT_M)
        assert arena().clearance_m(0, at) == pytest.approx(wanted_m, abs=1e-12)


def test_clearance_to_a_one_point_wall_is_to_its_rim() -> None:
    point = Polyline(points_m=((5.0, 6.0), (5.0, 6.0)), thickness_m=0.2)
    lonely = Arena(room(point, walls=False), RADIUS_M)
    lonely.add_robot(1.0, 1.0)
    assert lonely.clearance_m(0, (5.0, 5.0)) == pytest.approx(1.0 - 0.1 - RADIUS_M)


def test_clearance_without_obstacles_is_the_limit() -> None:
    empty = Arena(room(walls=False), RADIUS_M)
    empty.add_robot(1.0, 1.0)
    assert empty.clearance_m(0, (pi, pi)) == CLEARANCE_LIMIT_M
