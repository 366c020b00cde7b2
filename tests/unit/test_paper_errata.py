"""The paper's errors (docs/paper), computed: as printed, and in the control core."""

from math import atan2, cos, degrees, dist, hypot, inf, pi, radians, remainder, sin

import numpy as np
import pytest

from plant.shortest_path import path_length_m, shortest_path
from plant.world.file import load
from robot.core.navigators import vgm_and_bug
from robot.core.navigators.vgm_and_bug import PaperMemory
from robot.core.parameters import DEFAULTS
from robot.core.perception import odometry as odometries
from robot.core.perception.odometry import Odometry
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import BEARINGS
from robot.core.values import Decision, Goal, Pose
from study.trial.trial import Trial, run_trial
from tests.support.each import each

TRACK_M = DEFAULTS.track_m


def near_side(angle_rad: float) -> float:
    return remainder(angle_rad, 2 * pi)


def left_contact(pose: Pose) -> tuple[float, float]:
    half_m = TRACK_M / 2
    return pose.x_m - half_m * sin(pose.heading_rad), pose.y_m + half_m * cos(pose.heading_rad)


def pivot(arc_m: float, divisor_m: float) -> Pose:
    """Turn about the left wheel: the right one rolls `arc_m`; yaw is its speed over `divisor_m`."""
    pose, steps = Pose(0.0, 0.0, 0.0), 10_000
    for _ in range(steps):
        step_m, turn_rad = arc_m / 2 / steps, arc_m / divisor_m / steps
        middle_rad = pose.heading_rad + turn_rad / 2
        pose = Pose(
            pose.x_m + step_m * cos(middle_rad),
            pose.y_m + step_m * sin(middle_rad),
            pose.heading_rad + turn_rad,
        )
    return pose


def test_eq_6_stopped_wheel_must_not_move() -> None:
    stands = left_contact(Pose(0.0, 0.0, 0.0))
    assert dist(left_contact(pivot(0.2, divisor_m=TRACK_M)), stands) < 1e-6
    assert dist(left_contact(pivot(0.2, divisor_m=2 * TRACK_M)), stands) == pytest.approx(
        0.049, abs=0.001
    )


def test_eq_6_the_core_turns_by_the_track() -> None:
    odometry = Odometry()
    odometries.roll(odometry, 0.0, 0.01, DEFAULTS)
    assert odometry.pose.heading_rad == pytest.approx(0.01 / TRACK_M)


def quarter_circle(share: float) -> tuple[float, float]:
    """Drive a quarter circle of 0.5 m in 15 mm steps; `share` of each turn is in the step."""
    steps = round(0.5 * pi / 2 / 0.015)
    step_m, turn_rad = 0.5 * pi / 2 / steps, pi / 2 / steps
    x_m = y_m = heading_rad = 0.0
    for _ in range(steps):
        x_m += step_m * cos(heading_rad + share * turn_rad)
        y_m += step_m * sin(heading_rad + share * turn_rad)
        heading_rad += turn_rad
    return x_m, y_m


def test_eq_9_forgets_the_half_of_eq_8() -> None:
    end = (0.5, 0.5)
    assert dist(quarter_circle(share=0.5), end) * 1000 == pytest.approx(0.03, abs=0.005)
    assert dist(quarter_circle(share=1.0), end) * 1000 == pytest.approx(10.5, abs=0.2)


def test_eq_9_the_core_drives_the_quarter_circle_of_eq_8() -> None:
    odometry, steps = Odometry(), 52
    turn_rad, step_m = pi / 2 / steps, 0.5 * pi / 2 / steps
    for _ in range(steps):
        half_m = turn_rad * TRACK_M / 2
        odometries.roll(odometry, step_m - half_m, step_m + half_m, DEFAULTS)
    assert dist(odometry.pose[:2], (0.5, 0.5)) < 5e-5


def moved(pose: np.ndarray, right_m: float, left_m: float) -> np.ndarray:
    """Return the pose after a step by equation 8."""
    step_m, turn_rad = (right_m + left_m) / 2, (right_m - left_m) / TRACK_M
    middle_rad = pose[2] + turn_rad / 2
    step = np.array([step_m * cos(middle_rad), step_m * sin(middle_rad), turn_rad])
    after: np.ndarray = pose + step
    return after


@each("heading_rad", [0.0, 0.7, -2.5])
@each(("right_m", "left_m"), [(0.015, 0.012), (-0.01, 0.01), (0.003, -0.015)])
def test_eq_11_the_missing_f_q_is_the_derivative_of_eq_8(
    heading_rad: float, right_m: float, left_m: float
) -> None:
    pose, h = np.array([0.0, 0.0, heading_rad]), 1e-6
    by_right = (moved(pose, right_m + h, left_m) - moved(pose, right_m - h, left_m)) / (2 * h)
    by_left = (moved(pose, right_m, left_m + h) - moved(pose, right_m, left_m - h)) / (2 * h)
    step_m, a = (right_m + left_m) / 2, heading_rad + (right_m - left_m) / TRACK_M / 2
    slope = step_m / (2 * TRACK_M)
    printed = np.array(
        [
            [cos(a) / 2 - slope * sin(a), cos(a) / 2 + slope * sin(a)],
            [sin(a) / 2 + slope * cos(a), sin(a) / 2 - slope * cos(a)],
            [1 / TRACK_M, -1 / TRACK_M],
        ]
    )
    assert np.allclose(printed, np.column_stack([by_right, by_left]), atol=1e-9)
    wheels = np.diag([DEFAULTS.k_r_m * abs(right_m), DEFAULTS.k_l_m * abs(left_m)])
    assert np.allclose(core_covariance(heading_rad, right_m, left_m), printed @ wheels @ printed.T)


def core_covariance(heading_rad: float, right_m: float, left_m: float) -> np.ndarray:
    """Return the core's covariance after one step from an exactly known pose."""
    o = Odometry()
    o.pose = Pose(0.0, 0.0, heading_rad)
    odometries.roll(o, left_m, right_m, DEFAULTS)
    return np.array([[o.pxx, o.pxy, o.pxh], [o.pxy, o.pyy, o.pyh], [o.pxh, o.pyh, o.phh]])


def test_eq_2_a_position_needs_the_translation_too() -> None:
    heading_rad, here = 0.6, (3.0, 1.0)
    turned = (
        cos(heading_rad) * here[0] + sin(heading_rad) * here[1],
        cos(heading_rad) * here[1] - sin(heading_rad) * here[0],
    )
    assert hypot(*turned) == pytest.approx(hypot(*here))  # its own place, seen from itself: not 0


def test_paper_prints_nine_sonar_directions_for_eight_cones() -> None:
    assert len(range(0, 1801, 225)) == 9
    assert [round(degrees(b), 2) for b in BEARINGS] == [(i - 3.5) * 22.5 for i in range(8)]
    assert degrees(BEARINGS[7]) + 22.5 / 2 == pytest.approx(90.0)


def test_gamma_as_printed_misses_the_tangent_and_loses_the_side() -> None:
    misses_deg, kept = [], 0
    bearings_deg = np.arange(-89.95, 90.0, 0.1)  # of the obstacle, positive to the left
    for bearing_deg in bearings_deg:
        beta_deg = -bearing_deg  # the paper's: positive to the right
        heading_deg = (-90 if beta_deg < 0 else 90) + beta_deg  # alpha + gamma: alpha cancels
        tangent_deg = bearing_deg + 90
        misses_deg.append(abs(remainder(heading_deg - tangent_deg, 180)))
        kept += near_side(radians(bearing_deg - heading_deg)) * bearing_deg > 0
    assert np.mean(misses_deg) == pytest.approx(45.0, abs=0.1)
    assert max(misses_deg) == pytest.approx(90.0, abs=0.2)
    assert kept / len(bearings_deg) == pytest.approx(0.5, abs=0.01)


def decide(sonar: int, pose: Pose, goal: tuple[float, float]) -> Decision:
    ring = Ring()
    ring.nearest, ring.nearest_m = sonar, 0.2
    where = goal_at(*goal)
    return vgm_and_bug.step_vgm(PaperMemory(), pose, ring, where, DEFAULTS)


def turn_rad(ring: Ring) -> float:
    goal, here = goal_at(3.0, 0.0), Pose(0.0, 0.0, 0.0)
    return vgm_and_bug.step_vgm(PaperMemory(), here, ring, goal, DEFAULTS).rotation_rad


def goal_at(x_m: float, y_m: float) -> Goal:
    fields = dict.fromkeys(Goal._fields, 0)
    return Goal(**fields | {"x_m": x_m, "y_m": y_m})


@each("sonar", range(8))
@each("goal", [(3.0, 0.0), (1.0, 2.0), (-1.0, -0.5)])
def test_gamma_of_the_core_is_tangent_and_keeps_the_side(
    sonar: int, goal: tuple[float, float]
) -> None:
    pose = Pose(0.4, -0.3, 0.8)
    decision = decide(sonar, pose, goal)
    heading_rad = atan2(decision.virtual_y_m - pose.y_m, decision.virtual_x_m - pose.x_m)
    to_obstacle_rad = near_side(pose.heading_rad + BEARINGS[sonar] - heading_rad)
    assert abs(to_obstacle_rad) == pytest.approx(pi / 2)
    assert to_obstacle_rad * BEARINGS[sonar] > 0


def test_virtual_goal_does_not_depend_on_the_map_origin() -> None:
    here = decide(6, Pose(0.0, 0.0, 0.3), (2.0, 1.0))
    there = decide(6, Pose(50.0, -20.0, 0.3), (52.0, -19.0))
    assert there.rotation_rad == pytest.approx(here.rotation_rad)
    assert there.virtual_x_m - 50.0 == pytest.approx(here.virtual_x_m)
    assert there.virtual_y_m + 20.0 == pytest.approx(here.virtual_y_m)


def test_d_obs_is_the_zone_width_compared_with_the_nearest_range() -> None:
    ring = Ring()
    ring.nearest, ring.nearest_m = 4, DEFAULTS.d_obs_m
    assert turn_rad(ring) == 0.0
    ring.nearest_m = DEFAULTS.d_obs_m - 0.001
    assert turn_rad(ring) != 0.0
    ring.nearest, ring.nearest_m = -1, inf
    assert turn_rad(ring) == 0.0


@each("seed", range(3))
def test_virtual_goal_method_can_miss_a_reachable_goal(
    seed: int,
) -> None:
    world = load("u_trap")
    assert path_length_m(shortest_path(world)) == pytest.approx(5.1, abs=0.1)
    trapped = run_trial(Trial(world=world, navigator="vgm", seed=seed))
    assert trapped.outcome == "stuck"
