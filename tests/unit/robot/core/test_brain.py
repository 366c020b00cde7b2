"""A tick of the core: the parts together, MANUAL, and arrival."""

from math import inf, nan, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.core import brain, modes, reasons, states
from robot.core import brain as budget
from robot.core.parameters import DEFAULTS
from robot.core.state import State
from robot.core.values import Goal, Inputs, Pose, Scan, Twist, Wheels
from tests.support.cores import AHEAD, Driven, armed, driving
from tests.support.each import each

AGES = (25, 0) * 4
VGM = DEFAULTS._replace(navigator=states.VGM)


def until_ended(driven: Driven, limit_s: float = 60.0) -> Driven:
    for _ in range(round(limit_s * 20)):
        driven.tick()
        if driven.machine.goal_state >= states.REACHED:
            break
    return driven


def test_stages_are_marked_in_the_order_of_the_budget() -> None:
    marks: list[int] = []
    state = brain.State(DEFAULTS)
    brain.step(state, Inputs(0, None, None, None), DEFAULTS, marks.append)
    assert marks == [budget.ODOMETRY, budget.NAVIGATE, budget.GUARD]
    assert len(budget.STAGES) == 5
    assert sum(stage.host_us for stage in budget.STAGES) == budget.TICK_US
    assert sum(stage.mcu_percent for stage in budget.STAGES) <= 50


def test_disarmed_core_does_not_move() -> None:
    assert Driven().forward(1.0).stands


def test_goal_states_are_accepted_driving_reached() -> None:
    driven = armed()
    driven.goto(AHEAD._replace(heading_rad=pi / 2, x_m=1.0))
    assert driven.machine.goal_state == states.ACCEPTED
    seen = []
    for _ in range(1200):
        driven.tick()
        if driven.machine.goal_state not in seen:
            seen.append(driven.machine.goal_state)
    assert seen == [states.DRIVING, states.ALIGNING, states.REACHED]
    assert driven.stands
    assert driven.machine.vehicle == states.ACTIVE
    assert driven.machine.goal_ended_ms > driven.machine.goal_started_ms


def test_a_free_heading_needs_no_aligning() -> None:
    driven = armed()
    driven.goto(Goal(0.5, 0.2, None, 0.05, 0.05))
    seen = set()
    for _ in range(200):
        driven.tick()
        seen.add(driven.machine.goal_state)
    assert states.ALIGNING not in seen
    assert driven.machine.goal_state == states.REACHED


def test_goal_at_the_robots_place_is_reached_without_moving() -> None:
    driven = armed()
    driven.goto(Goal(0.0, 0.0, 0.0, 0.05, 0.05))
    driven.tick()
    assert driven.machine.goal_state == states.REACHED
    assert driven.left == driven.right == 0.0


def test_goal_is_reached_only_when_the_robot_has_stopped() -> None:
    driven = until_ended(driving())
    assert driven.machine.goal_state == states.REACHED
    assert driven.stands
    assert driven.state.odometry.speed_m_s == pytest.approx(0.0, abs=0.02)


def test_small_offset_aligns_and_large_offset_drives_again() -> None:
    driven = armed()
    driven.goto(Goal(1.0, 0.0, 0.5 * pi, 0.05, 0.02))
    while driven.machine.goal_state != states.ALIGNING:
        driven.tick()
    odometry = driven.state.odometry
    odometry.pose = odometry.pose._replace(x_m=1.12)
    driven.tick()
    assert driven.machine.goal_state == states.ALIGNING
    odometry.pose = odometry.pose._replace(x_m=1.2)
    driven.tick()
    assert driven.machine.goal_state == states.DRIVING
    assert until_ended(driven).machine.goal_state == states.REACHED


@each("tolerance_deg", [0.2, 1.0, 5.0, 180.0])
def test_even_the_finest_tolerance_is_reached(tolerance_deg: float) -> None:
    driven = armed()
    driven.goto(Goal(0.4, -0.3, 2.0, 0.005, tolerance_deg * pi / 180))
    until_ended(driven)
    assert driven.machine.goal_state == states.REACHED
    assert driven.state.goal_distance_m <= 0.015


def test_obstacle_ahead_sets_the_state_to_avoiding() -> None:
    driven = driving(params=VGM)
    driven.scan = Scan((0, 0, 0, 290, 0, 0, 0, 0), AGES, 0xFF, 1 << 3)
    outputs = driven.tick()
    assert driven.machine.goal_state == states.AVOIDING
    assert outputs.decision is not None
    assert outputs.decision.branch == states.PASS_LEFT


def test_with_hardly_any_room_ahead_it_turns_on_the_spot() -> None:
    driven = armed(VGM)
    driven.scan = Scan((0, 0, 0, 60, 70, 0, 0, 0), AGES, 0xFF, 0b11000)
    driven.goto()
    driven.forward(0.4)
    assert driven.outputs.twist.speed_m_s == 0.0
    assert driven.outputs.right_mrad_s == -driven.outputs.left_mrad_s != 0


def test_armed_again_in_contact_it_turns_away_on_the_spot() -> None:
    driven = driving()
    driven.bumper = 1
    driven.tick()
    assert driven.machine.vehicle_reason == reasons.BUMPER
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK
    driven.goto(Goal(0.0, 2.0, None, 0.05, 0.05))
    driven.forward(0.4)
    assert driven.machine.vehicle == states.ACTIVE
    assert driven.outputs.right_mrad_s == -driven.outputs.left_mrad_s != 0


def test_robot_without_motion_is_blocked_after_ten_seconds() -> None:
    params = VGM._replace(guard_stop_m=0.9, spin_room_m=0.0, d_obs_m=0.1)
    driven = armed(params)
    driven.scan = Scan((0, 0, 0, 800, 0, 0, 0, 0), AGES, 0xFF, 1 << 3)
    driven.goto()
    driven.forward(9.9)
    assert driven.outputs.guard == reasons.OBSTACLE_AHEAD
    assert driven.machine.goal_state == states.DRIVING
    driven.forward(0.3)
    assert (driven.machine.goal_state, driven.machine.goal_reason) == (
        states.STUCK,
        reasons.BLOCKED,
    )
    assert driven.machine.vehicle == states.ACTIVE
    assert driven.stands


def test_no_progress_for_two_minutes_ends_the_goal() -> None:
    driven = driving(params=VGM)
    driven.scan = Scan((0, 0, 250, 0, 0, 0, 0, 0), AGES, 0xFF, 1 << 2)  # obstacle always just ahead
    driven.params = VGM._replace(freeze_m=1e9)
    driven.forward(100.0)
    assert driven.machine.goal_state == states.AVOIDING
    driven.forward(25.0)
    assert driven.machine.goal_reason == reasons.NO_PROGRESS


def test_a_hold_is_not_counted_as_being_stuck() -> None:
    driven = driving()
    modes.hold(driven.machine)
    driven.forward(300.0)
    modes.resume(driven.machine)
    driven.forward(2.0)
    assert driven.machine.goal_state == states.DRIVING


def test_the_way_back_follows_the_trail_to_the_start() -> None:
    driven = until_ended(driving())
    assert driven.state.trail.count > 10
    assert modes.rtl(driven.machine, driven.state.trail, driven.now_ms) == reasons.OK
    until_ended(driven)
    assert driven.machine.mode == states.SMART_RTL
    assert driven.machine.goal_state == states.REACHED
    assert abs(driven.state.odometry.pose.x_m) < 0.06
    assert driven.state.trail.count <= 2


def test_only_a_stop_by_command_uses_the_ramp() -> None:
    held, failed = driving(), driving()
    modes.hold(held.machine)
    held.tick()
    assert not held.stands
    assert held.forward(0.3).stands
    failed.scan = None
    failed.tick()
    assert failed.stands


senses = st.tuples(
    st.one_of(st.none(), st.tuples(st.integers(-400, 400), st.integers(-400, 400))),
    st.one_of(st.none(), st.lists(st.integers(0, 65535), min_size=8, max_size=8)),
    st.integers(0, 255),
    st.integers(0, 255),
    st.integers(0, 7),
)


@settings(max_examples=60)
@given(st.lists(senses, max_size=60), st.sampled_from([states.BUG, states.VGM]))
def test_limits_hold_for_any_inputs(
    story: list[tuple[tuple[int, int] | None, list[int] | None, int, int, int]], navigator: int
) -> None:
    driven = armed(DEFAULTS._replace(navigator=navigator))
    limit_mrad_s = DEFAULTS.wheel_max_m_s / DEFAULTS.wheel_radius_m * 1000
    left = right = 0
    for k, (moved, ranges, valid, echo, bumper) in enumerate(story):
        modes.arm(driven.machine)
        driven.goto()
        if moved is not None:
            left, right = left + moved[0], right + moved[1]
        wheels = None if moved is None else Wheels(left, right, bumper, 50 * k + 50)
        scan = None if ranges is None else Scan(tuple(ranges), AGES, valid, echo)
        _, outputs = brain.step(driven.state, Inputs(50 * k + 50, wheels, scan, 0), DEFAULTS)
        assert isinstance(outputs.left_mrad_s, int)
        assert max(abs(outputs.left_mrad_s), abs(outputs.right_mrad_s)) <= limit_mrad_s
        if wheels is None or scan is None:
            assert outputs.left_mrad_s == outputs.right_mrad_s == 0


def test_unequal_wheels_get_speeds_for_a_straight_line() -> None:
    driven = armed(DEFAULTS._replace(wheel_ratio=1.02, navigator=states.BUG))
    driven.goto(Goal(5.0, 0.0, None, 0.05, 0.05))
    driven.forward(2.0)
    outputs = driven.outputs
    assert outputs.left_mrad_s / outputs.right_mrad_s == pytest.approx(1.02, rel=2e-3)
    assert outputs.left_mrad_s * 0.033e-3 <= DEFAULTS.wheel_max_m_s
    assert abs(driven.state.odometry.pose.heading_rad) < 0.01


WALL_AHEAD = Scan((100,) * 8, (25, 0) * 4, 0xFF, 0xFF)


def manual() -> Driven:
    driven = armed()
    assert modes.set_mode(driven.machine, driven.state.trail, states.MANUAL, 0) == reasons.OK
    return driven


def test_robot_follows_the_operator_within_its_acceleration() -> None:
    driven = manual()
    driven.state.manual = Twist(0.2, 0.0)
    first = driven.tick().twist.speed_m_s
    assert 0.0 < first <= DEFAULTS.accel_m_s2 * DEFAULTS.period_s + 1e-12
    driven.forward(0.5)
    assert driven.outputs.twist == Twist(0.2, 0.0)
    driven.state.manual = Twist(-0.1, 0.0)
    driven.forward(0.5)
    assert driven.outputs.twist == Twist(-0.1, 0.0)
    driven.state.manual = Twist(0.0, 1.0)
    driven.forward(0.5)
    assert driven.outputs.twist == Twist(0.0, 1.0)


def test_without_teleop_the_wheels_stop_in_that_tick() -> None:
    driven = manual()
    driven.state.manual = Twist(0.3, 0.5)
    driven.forward(1.0)
    driven.state.manual = None
    driven.tick()
    assert driven.stands


def test_teleop_needs_manual_mode_and_arming() -> None:
    driven = armed()
    driven.state.manual = Twist(0.2, 0.0)
    assert driven.forward(0.5).stands, "in HOLD"
    driven = manual()
    driven.state.manual = Twist(0.2, 0.0)
    modes.disarm(driven.machine, 0)
    assert driven.forward(0.5).stands


def test_guard_stops_teleop_before_a_wall() -> None:
    driven = manual()
    driven.scan = WALL_AHEAD
    driven.state.manual = Twist(0.3, 0.0)
    driven.forward(0.2)
    assert driven.outputs.guard == reasons.SLOWED
    driven.scan = WALL_AHEAD._replace(range_mm=(40,) * 8)
    driven.forward(0.1)
    assert driven.outputs.guard == reasons.OBSTACLE_AHEAD
    assert driven.stands


@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_whatever_is_wanted_wheels_and_robot_keep_their_limits(
    speed_m_s: float, yaw_rate_rad_s: float
) -> None:
    driven = manual()
    driven.state.manual = Twist(speed_m_s, yaw_rate_rad_s)
    for _ in range(20):
        twist = driven.tick().twist
        assert abs(twist.speed_m_s) <= DEFAULTS.v_max_m_s + 1e-9
        assert abs(twist.yaw_rate_rad_s) <= DEFAULTS.yaw_max_rad_s + 1e-9


@each("twist", [Twist(nan, 0.0), Twist(0.0, nan), Twist(0.0, inf)])
def test_teleop_with_nan_turns_no_wheel(twist: Twist) -> None:
    driven = manual()
    driven.state.manual = twist
    driven.tick()
    assert driven.stands


TOLERANCE_M = 0.05
AWAY_M = 0.16
"""Distance to the goal: beyond the tolerance, but nearer than an echo at NEAR_M."""
NEAR_M = 0.07
SIGMA_M = 0.10


def standing(
    *,
    nearest_m: float = NEAR_M,
    sigma_m: float = SIGMA_M,
    heading_rad: float = 0.6 * pi,
    arrived: bool = False,
) -> State:
    """Return a robot at the origin with an echo at its side and a doubt about its position."""
    state = State(DEFAULTS)
    state.odometry.pose = Pose(0.0, 0.0, heading_rad)
    state.odometry.pxx = state.odometry.pyy = sigma_m * sigma_m
    state.ring.nearest_m = nearest_m
    state.arrived = arrived
    return state


def arrives(state: State, away_m: float = AWAY_M) -> bool:
    goal = Goal(away_m, 0.0, None, TOLERANCE_M, pi)
    return brain.has_arrived(state, goal, away_m, DEFAULTS)


def test_robot_arrives_beside_an_obstacle_if_it_may_stand_on_the_goal() -> None:
    assert arrives(standing())


def test_robot_that_knows_its_position_does_not_arrive_beside_the_goal() -> None:
    assert not arrives(standing(sigma_m=0.0))
    assert not arrives(standing(sigma_m=0.06))
    assert arrives(standing(sigma_m=0.07))


def test_robot_with_a_large_doubt_does_not_arrive_beside_the_goal() -> None:
    assert not arrives(standing(sigma_m=0.13))


def test_robot_drives_on_while_the_goal_lies_ahead() -> None:
    assert not arrives(standing(heading_rad=0.25 * pi))
    assert arrives(standing(heading_rad=0.75 * pi))


def test_no_wall_may_lie_between_robot_and_goal() -> None:
    assert not arrives(standing(nearest_m=0.03))
    assert not arrives(standing(), DEFAULTS.radius_m + NEAR_M + 0.001)


@each("nearest_m", [0.13, 1.0, inf])
def test_robot_in_the_open_drives_to_the_goal(nearest_m: float) -> None:
    assert not arrives(standing(nearest_m=nearest_m))


def test_arrival_beside_an_obstacle_lasts_while_the_robot_turns() -> None:
    turned = standing(nearest_m=inf, heading_rad=0.0, arrived=True)
    assert arrives(turned)
    assert not arrives(turned, 0.25)


def test_arrival_without_doubt_is_revoked_beyond_three_tolerances() -> None:
    sure = standing(sigma_m=0.0, arrived=True)
    assert arrives(sure, 3.0 * TOLERANCE_M - 1e-6)
    assert not arrives(sure, 3.0 * TOLERANCE_M + 1e-6)
