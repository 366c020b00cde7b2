"""Odometry: its uncertainty, slip, and the heading that a wall corrects."""

from math import cos, hypot, inf, nan, pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS, Params
from robot.core.perception import odometry as odometries
from robot.core.perception import slip as slips
from robot.core.perception import wall_heading
from robot.core.perception.odometry import Odometry, tick_difference
from robot.core.perception.slip import Slip
from robot.core.perception.sonar_ring import Ring
from robot.core.perception.wall_heading import WallHeading
from robot.core.values import Pose, Wheels, wrap
from tests.support.each import each

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
TRACK_M = DEFAULTS.track_m
M_PER_TICK = DEFAULTS.m_per_tick
steps = st.floats(-0.03, 0.03)


def arc(p: Array, right_m: float, left_m: float) -> Array:
    """Return eq. 8 as a function of pose and wheel distances, for numerical derivatives."""
    turn_rad, step_m = (right_m - left_m) / TRACK_M, (right_m + left_m) / 2
    middle_rad = p[2] + turn_rad / 2
    moved: Array = p + np.array([step_m * cos(middle_rad), step_m * sin(middle_rad), turn_rad])
    return moved


def covariance(odometry: Odometry) -> Array:
    o = odometry
    return np.array([[o.pxx, o.pxy, o.pxh], [o.pxy, o.pyy, o.pyh], [o.pxh, o.pyh, o.phh]])


def at(pose: Pose, p: Array | None = None) -> Odometry:
    odometry = Odometry()
    odometry.pose = pose
    if p is not None:
        odometry.pxx, odometry.pxy, odometry.pxh = p[0]
        odometry.pyy, odometry.pyh, odometry.phh = p[1, 1], p[1, 2], p[2, 2]
    return odometry


def wheels(left: int, right: int, at_ms: int = 0) -> Wheels:
    return Wheels(left, right, 0, at_ms)


@given(st.floats(-pi, pi), steps, steps)
def test_covariance_follows_the_finite_differences_of_the_motion(
    heading_rad: float, right_m: float, left_m: float
) -> None:
    p, d = np.array([1.0, -2.0, heading_rad]), 1e-6
    f_p = np.array(
        [
            (arc(p + e, right_m, left_m) - arc(p - e, right_m, left_m)) / (2 * d)
            for e in np.eye(3) * d
        ]
    ).T
    by_right = (arc(p, right_m + d, left_m) - arc(p, right_m - d, left_m)) / (2 * d)
    by_left = (arc(p, right_m, left_m + d) - arc(p, right_m, left_m - d)) / (2 * d)
    f_q = np.array([by_right, by_left]).T
    before = np.array([[4e-4, 1e-5, 2e-5], [1e-5, 3e-4, -1e-5], [2e-5, -1e-5, 1e-3]])
    q = np.diag([DEFAULTS.k_r_m * abs(right_m), DEFAULTS.k_l_m * abs(left_m)])
    odometry = at(Pose(1.0, -2.0, heading_rad), before)
    odometries.roll(odometry, left_m, right_m, DEFAULTS)
    step_m, middle_rad = (right_m + left_m) / 2, p[2] + (right_m - left_m) / TRACK_M / 2
    shorter = 0.76 * 1e-3 * step_m * np.array([cos(middle_rad), sin(middle_rad), 0.0])
    after = f_p @ before @ f_p.T + f_q @ q @ f_q.T + np.outer(shorter, shorter)
    assert covariance(odometry) == pytest.approx(after, abs=1e-11)


def test_quarter_circle_is_accurate_to_0_05_mm() -> None:
    radius_m, step_m = 0.5, 0.015
    count = round(radius_m * pi / 2 / step_m)
    turn_rad = pi / 2 / count
    right_m, left_m = (radius_m + 0.1) * turn_rad, (radius_m - 0.1) * turn_rad
    odometry = at(Pose(0.0, 0.0, 0.0))
    x_m = y_m = heading_rad = 0.0
    for _ in range(count):
        odometries.roll(odometry, left_m, right_m, DEFAULTS)
        x_m += radius_m * turn_rad * cos(heading_rad + turn_rad)  # eq. 9 as printed
        y_m += radius_m * turn_rad * sin(heading_rad + turn_rad)
        heading_rad += turn_rad
    ours_m = np.hypot(odometry.pose.x_m - radius_m, odometry.pose.y_m - radius_m)
    printed_m = np.hypot(x_m - radius_m, y_m - radius_m)
    assert ours_m < 5e-5
    assert printed_m == pytest.approx(0.0105, abs=3e-4)


def test_wheels_that_accelerate_while_turning_move_the_robot_aside() -> None:
    """Speed and turn change linearly; compared with an integration in 100 steps per tick.

    A small error is left, because the straight line between two places is shorter than the arc.
    """
    ours, arcs, fine = (at(Pose(0.0, 0.0, 0.0)) for _ in range(3))
    parts = 100

    def way_m(part: int) -> tuple[float, float]:
        """Return the ways of both wheels in one part."""
        return 2e-5 + 6e-8 * (part + 0.5), 1.5e-4 - 3e-8 * (part + 0.5)

    ours.left_m, ours.right_m = np.sum([way_m(part) for part in range(-parts, 0)], 0)
    for tick in range(20):
        steps_m = [way_m(tick * parts + part) for part in range(parts)]
        for step_m in steps_m:
            fine.left_m = fine.right_m = 0.0
            odometries.roll(fine, *step_m, DEFAULTS)
        left_m, right_m = np.sum(steps_m, 0)
        arcs.left_m = arcs.right_m = 0.0
        for odometry in (arcs, ours):
            odometries.roll(odometry, left_m, right_m, DEFAULTS)
    assert off_m(arcs, fine) > 5e-5
    assert off_m(ours, fine) < 0.11 * off_m(arcs, fine)


def off_m(one: Odometry, other: Odometry) -> float:
    return float(np.hypot(one.pose.x_m - other.pose.x_m, one.pose.y_m - other.pose.y_m))


def test_sample_that_is_missing_adds_no_motion_aside() -> None:
    """The step after it has no last one to compare with, and counts as an arc."""
    odometry = driven([(100, 60), (60, 100)])
    as_arc = driven([(100, 60), (60, 100)])
    odometries.update(odometry, None, DEFAULTS)
    assert (odometry.left_m, odometry.right_m, odometry.moved_m) == (0.0, 0.0, 0.0)
    as_arc.left_m = as_arc.right_m = 0.0
    sample = wheels(odometry.left + 90, odometry.right + 30, odometry.at_ms + 100)
    for updated in (odometry, as_arc):
        odometries.update(updated, sample, DEFAULTS)
    assert odometry.pose == as_arc.pose


def test_stopped_left_wheel_is_the_pivot() -> None:
    odometry = at(Pose(0.0, 0.0, 0.0))
    for _ in range(100):
        odometries.roll(odometry, 0.0, 0.002, DEFAULTS)
    x_m, y_m, heading_rad = odometry.pose
    left_x_m, left_y_m = x_m - 0.1 * sin(heading_rad), y_m + 0.1 * cos(heading_rad)
    assert (left_x_m, left_y_m) == pytest.approx((0.0, 0.1), abs=1e-5)
    assert heading_rad == pytest.approx(0.2 / TRACK_M)


def test_covariance_matches_the_errors() -> None:
    """Monte Carlo over 5 m of S-curve: the mean normalised estimation error squared is 3."""
    rng = np.random.default_rng(7)
    runs, ticks = 4000, 250
    odometry = at(Pose(0.0, 0.0, 0.0))
    x, y, h = np.zeros(runs), np.zeros(runs), np.zeros(runs)
    for k in range(ticks):
        turn_rad = 0.012 * (1 if k < ticks // 2 else -1)
        right_m, left_m = 0.02 + turn_rad * TRACK_M / 2, 0.02 - turn_rad * TRACK_M / 2
        odometries.roll(odometry, left_m, right_m, DEFAULTS)
        true_right = right_m + rng.normal(0, (DEFAULTS.k_r_m * right_m) ** 0.5, runs)
        true_left = left_m + rng.normal(0, (DEFAULTS.k_l_m * left_m) ** 0.5, runs)
        turn, step = (true_right - true_left) / TRACK_M, (true_right + true_left) / 2
        x, y, h = x + step * np.cos(h + turn / 2), y + step * np.sin(h + turn / 2), h + turn
    error = np.array([x, y, h]).T - np.array(odometry.pose)
    nees = np.einsum("ni,ij,nj->n", error, np.linalg.inv(covariance(odometry)), error)
    assert float(nees.mean()) == pytest.approx(3.0, abs=0.2)


@given(st.lists(st.tuples(steps, steps), min_size=1, max_size=60), st.floats(-pi, pi))
def test_the_covariance_stays_positive_semi_definite(
    travel: list[tuple[float, float]], heading_rad: float
) -> None:
    odometry = at(Pose(0.0, 0.0, heading_rad))
    for left_m, right_m in travel:
        odometries.roll(odometry, left_m, right_m, DEFAULTS)
    p = covariance(odometry)
    assert np.linalg.eigvalsh(p).min() >= -1e-12 * max(1.0, float(np.trace(p)))
    assert -pi < odometry.pose.heading_rad <= pi


def test_the_first_sample_only_latches() -> None:
    odometry = Odometry()
    odometries.update(odometry, wheels(123_456, -99), DEFAULTS)
    assert odometry.pose == Pose(0.0, 0.0, 0.0)
    assert not odometry.jumped


def test_speeds_are_those_of_the_wheels() -> None:
    odometry = Odometry()
    odometries.update(odometry, wheels(0, 0), DEFAULTS)
    odometries.update(odometry, wheels(40, 60, 50), DEFAULTS)
    assert odometry.speed_m_s == pytest.approx(0.2)
    assert odometry.yaw_rate_rad_s == pytest.approx(20 * M_PER_TICK / TRACK_M / 0.05)
    assert odometry.moved_m == pytest.approx(0.01)


def test_next_sample_includes_a_missing_one() -> None:
    patient, steady = Odometry(), Odometry()
    for at_ms, count in ((0, 0), (50, 50), (100, 100), (150, 150)):
        odometries.update(steady, wheels(count, count, at_ms), DEFAULTS)
        sample = None if at_ms in (50, 100) else wheels(count, count, at_ms)
        odometries.update(patient, sample, DEFAULTS)
        if sample is None:
            assert patient.pose == Pose(0.0, 0.0, 0.0)
    assert patient.pose == pytest.approx(steady.pose)
    assert patient.speed_m_s == pytest.approx(steady.speed_m_s)


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-1000, 1000))
def test_a_counter_may_wrap_between_two_samples(count: int, moved: int) -> None:
    wrapped = (count + moved + 2**31) % 2**32 - 2**31
    assert tick_difference(wrapped, count) == moved


def test_a_jump_no_wheel_can_make_is_reported_and_ignored() -> None:
    odometry = driven([(50, 50)])
    odometries.update(odometry, wheels(5050, 50, 100), DEFAULTS)
    assert odometry.jumped
    assert odometry.pose.x_m == pytest.approx(0.01)
    assert (odometry.left_m, odometry.right_m, odometry.moved_m) == (0.0, 0.0, 0.0)
    odometries.update(odometry, wheels(5100, 100, 150), DEFAULTS)
    assert not odometry.jumped
    assert odometry.pose == pytest.approx((0.02, 0.0, 0.0))


def test_paused_clock_gives_no_new_speed() -> None:
    odometry = Odometry()
    for at_ms, count in ((0, 0), (50, 50), (50, 60)):
        odometries.update(odometry, wheels(count, count, at_ms), DEFAULTS)
    assert odometry.pose.x_m == pytest.approx(0.012)
    assert odometry.speed_m_s == pytest.approx(0.2)


def test_repeated_sample_keeps_the_speeds() -> None:
    """Read a tick before its sample, and one so late that two samples lie between."""
    odometry, speeds = Odometry(), []
    for at_ms in (0, 50, 50, 100, 200):
        odometries.update(odometry, wheels(-at_ms, at_ms, at_ms), DEFAULTS)
        speeds.append(odometry.yaw_rate_rad_s)
    turned_rad_s = 2 * 50 * M_PER_TICK / TRACK_M / 0.05
    assert speeds == pytest.approx([0.0, *[turned_rad_s] * 4])


def test_jump_limit_depends_on_the_elapsed_time() -> None:
    for at_ms, jumped in ((50, True), (500, False)):
        odometry = Odometry()
        odometries.update(odometry, wheels(0, 0), DEFAULTS)
        odometries.update(odometry, wheels(700, 700, at_ms), DEFAULTS)
        assert odometry.jumped is jumped


def driven(level_ticks: "list[tuple[int, int]]", params: Params = DEFAULTS) -> Odometry:
    odometry = Odometry()
    left = right = 0
    for k, (more_left, more_right) in enumerate([(0, 0), *level_ticks]):
        left, right = left + more_left, right + more_right
        odometries.update(odometry, wheels(left, right, 50 * k), params)
    return odometry


def test_whole_ticks_cause_a_small_uncertainty() -> None:
    exact = DEFAULTS._replace(k_r_m=0.0, k_l_m=0.0)
    odometry = driven([(75, 75)] * 400, exact)  # six metres
    assert 1e-4 < odometry.pxx**0.5 < 4e-4
    assert odometry.pxx == pytest.approx(odometry.pyy)
    assert odometry.phh**0.5 == pytest.approx(0.0002 / 6**0.5 / TRACK_M)


def test_an_uncertain_heading_makes_the_way_uncertain_too() -> None:
    """Compared with many robots that drive straight by their wheels and drift by slip."""
    params = DEFAULTS._replace(k_r_m=2e-5, k_l_m=2e-5)
    steps_count, step_m = 667, 0.015
    odometry = driven([(75, 75)] * steps_count, params)
    rng = np.random.default_rng(3)
    slips = rng.normal(0.0, (2e-5 * step_m) ** 0.5, (2, steps_count, 4000))
    turns = (slips[0] - slips[1]) / TRACK_M
    headings = np.cumsum(turns, axis=0) - turns / 2
    x_m = np.sum((step_m + slips.mean(axis=0)) * np.cos(headings), axis=0)
    second_moment = np.mean((x_m - odometry.pose.x_m) ** 2)
    first_order = 2e-5 * steps_count * step_m / 2
    assert second_moment > 5 * first_order
    assert odometry.pxx == pytest.approx(second_moment, rel=0.15)


def test_a_larger_right_wheel_rolls_farther_on_the_same_ticks() -> None:
    params = DEFAULTS._replace(wheel_ratio=1.005)
    odometry = driven([(50, 50)] * 100, params)
    left_share, right_share = odometries.wheel_shares(params)
    assert right_share / left_share == pytest.approx(1.005)
    assert (left_share + right_share) / 2 == pytest.approx(1.0)
    assert odometry.pose.heading_rad == pytest.approx((right_share - left_share) / TRACK_M)


@given(st.lists(st.tuples(st.integers(-150, 150), st.integers(-150, 150)), max_size=60))
def test_the_covariance_never_has_a_negative_variance(ticks: "list[tuple[int, int]]") -> None:
    least = np.linalg.eigvalsh(covariance(driven(ticks)))[0]
    assert least >= -1e-12


STEP_TICKS = 60  # 12 mm
STEP_M = STEP_TICKS * DEFAULTS.m_per_tick


class Drive:
    """Drive towards a wall straight ahead on wheels that may lose a share of their distance."""

    def __init__(self, wall_m: float = 2.0) -> None:
        self.slip, self.odometry, self.ring = Slip(), Odometry(), Ring()
        self.ticks = self.tick = 0
        self.wall_m = wall_m
        self.x_m = 0.0
        self.odd_m = 0.0
        self.wheels()

    def wheels(self) -> None:
        sample = Wheels(self.ticks, self.ticks, 0, 50 * self.tick)
        odometries.update(self.odometry, sample, DEFAULTS)
        self.tick += 1

    def see(self) -> None:
        ahead_m = self.wall_m - self.x_m - DEFAULTS.radius_m + self.odd_m
        edge = cos(pi / 8)
        aside_m = (ahead_m + DEFAULTS.radius_m) / edge - DEFAULTS.radius_m
        self.ring.range_m = [inf, inf, aside_m, ahead_m, ahead_m, aside_m, inf, inf]

    def go(self, way_m: float, lost: float = 0.0) -> "Drive":
        for _ in range(round(way_m / STEP_M)):
            self.ticks += STEP_TICKS
            self.x_m += STEP_M * (1.0 - lost)
            self.wheels()
            self.see()
            slips.watch(self.slip, self.odometry, self.ring, DEFAULTS)
        return self

    @property
    def off_m(self) -> float:
        return float(self.odometry.pose.x_m) - self.x_m

    @property
    def sigma_m(self) -> float:
        return float(self.odometry.pxx**0.5)


def test_wheels_that_grip_are_not_called_slipping() -> None:
    drive = Drive().go(1.5)
    assert drive.slip.share == 0.0
    assert drive.sigma_m < 0.01


@each("lost", [0.3, 0.5, 0.9])
def test_slip_is_detected_and_extends_the_covariance(
    lost: float,
) -> None:
    drive = Drive().go(0.5).go(0.8, lost)
    assert drive.slip.share == pytest.approx(lost, abs=0.15)
    assert 0.5 * drive.off_m < drive.sigma_m < 3.0 * drive.off_m


def test_covariance_includes_slip_before_its_detection() -> None:
    drive = Drive().go(0.5).go(0.5, 0.6)
    assert drive.off_m < 2.0 * drive.sigma_m


def test_when_the_ground_grips_again_nothing_more_is_added() -> None:
    drive = Drive(3.0).go(0.5).go(0.8, 0.5).go(0.9)
    assert drive.slip.share == 0.0
    before_m = drive.sigma_m
    drive.go(0.2)
    assert drive.sigma_m == pytest.approx(before_m, rel=0.02)


def test_slip_that_nothing_shows_any_more_is_over_after_a_while() -> None:
    drive = Drive(2.0).go(0.3).go(0.8, 0.5)
    assert drive.slip.share > 0.0
    drive.wall_m = 100.0
    drive.go(slips.LASTS_M + 0.1)
    assert drive.slip.share == 0.0


def test_a_corridor_that_stays_as_it_is_is_no_sign_of_slip() -> None:
    drive = Drive()

    def see() -> None:
        half_m, rim_m = 0.5, DEFAULTS.radius_m
        edges = [half_m / sin(edge) - rim_m for edge in (pi / 8, pi / 4)]
        drive.ring.range_m = [0.4, 0.4, edges[1], edges[0], edges[0], edges[1], 0.4, 0.4]

    drive.see = see  # type: ignore[method-assign]
    drive.go(3.0)
    assert drive.slip.share == 0.0


def test_a_single_false_echo_is_no_sign_of_slip() -> None:
    drive = Drive()
    for k in range(100):
        drive.odd_m = 0.5 if k % 9 == 0 else 0.0
        drive.go(STEP_M)
        assert drive.slip.share == 0.0


def test_noise_of_the_sonars_alone_is_no_sign_of_slip() -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        drive = Drive(2.2)
        for _ in range(140):
            drive.odd_m = float(rng.normal(0.0, 0.02))
            drive.go(STEP_M)
            assert drive.slip.share == 0.0


def test_approaching_object_is_no_sign_of_slip() -> None:
    drive = Drive(2.4)
    for _ in range(80):
        drive.wall_m -= 0.008
        drive.go(STEP_M)
        assert drive.slip.share == 0.0


def test_stationary_robot_gives_no_evidence() -> None:
    drive = Drive()
    drive.see()
    for _ in range(50):
        drive.wheels()
        slips.watch(drive.slip, drive.odometry, drive.ring, DEFAULTS)
    assert drive.slip.way_m == 0.0


ranges = st.none() | st.just(inf) | st.just(nan) | st.floats(0.02, 3.0)


@given(
    st.lists(
        st.tuples(
            st.integers(-75, 75), st.integers(-75, 75), st.lists(ranges, min_size=8, max_size=8)
        ),
        max_size=80,
    )
)
def test_whatever_is_seen_the_covariance_stays_one(
    steps: "list[tuple[int, int, list[float | None]]]",
) -> None:
    slip, odometry, ring = Slip(), Odometry(), Ring()
    left = right = 0
    odometries.update(odometry, Wheels(0, 0, 0, 0), DEFAULTS)
    for k, (more_left, more_right, seen) in enumerate(steps, 1):
        left, right = left + more_left, right + more_right
        odometries.update(odometry, Wheels(left, right, 0, 50 * k), DEFAULTS)
        ring.range_m = seen
        slips.watch(slip, odometry, ring, DEFAULTS)
        assert 0.0 <= slip.share <= 1.0
    o = odometry
    p = np.array([[o.pxx, o.pxy, o.pxh], [o.pxy, o.pyy, o.pyh], [o.pxh, o.pyh, o.phh]])
    assert np.linalg.eigvalsh(p)[0] >= -1e-9 * max(1.0, hypot(o.pxx, o.pyy, o.phh))


WALL_STEP_TICKS = 50  # 10 mm
WALL_STEP_M = WALL_STEP_TICKS * DEFAULTS.m_per_tick
NEAR_M = 0.1
LEFT, RIGHT = 1, -1


class DriveAlongWall:
    """Drive along walls whose true direction is known, with an estimate that may be wrong."""

    def __init__(self, sigma_m: float = 0.0, params: Params = DEFAULTS) -> None:
        self.params = params
        self.walls, self.odometry, self.ring, self.slip = WallHeading(), Odometry(), Ring(), Slip()
        self.left = self.right = self.tick = 0
        self.x_m = self.y_m = self.heading_rad = 0.0
        self.sigma_m = sigma_m
        self.random = np.random.default_rng(1)
        self.see({})
        self.wheels()

    def wheels(self) -> None:
        sample = Wheels(self.left, self.right, 0, 50 * self.tick)
        odometries.update(self.odometry, sample, self.params)
        self.tick += 1

    def see(self, range_m: dict[int, float]) -> None:
        self.ring.range_m = [range_m.get(i, inf) for i in range(8)]
        wall_heading.watch(self.walls, self.odometry, self.ring, self.slip, self.params)

    def turn(self, angle_rad: float) -> "DriveAlongWall":
        """Turn on the spot, without an echo."""
        ticks = round(0.5 * angle_rad * DEFAULTS.track_m / DEFAULTS.m_per_tick / 40)
        for _ in range(40):
            self.left -= ticks
            self.right += ticks
            self.heading_rad += 2.0 * ticks * DEFAULTS.m_per_tick / DEFAULTS.track_m
            self.wheels()
            self.see({})
        return self

    def along(self, wall_rad: float, way_m: float = 0.5, side: int = LEFT) -> "DriveAlongWall":
        """Drive straight past a wall of this true direction; then there is none for 10 cm."""
        normal_x, normal_y = -side * sin(wall_rad), side * cos(wall_rad)
        offset_m = normal_x * self.x_m + normal_y * self.y_m + NEAR_M + DEFAULTS.radius_m
        for _ in range(round(way_m / WALL_STEP_M)):
            self.go()
            distance_m = offset_m - normal_x * self.x_m - normal_y * self.y_m
            distance_m += float(self.random.normal(0.0, 1.0)) * self.sigma_m
            self.see({7 if side == LEFT else 0: distance_m - DEFAULTS.radius_m})
        return self.free()

    def free(self, way_m: float = 0.1) -> "DriveAlongWall":
        for _ in range(round(way_m / WALL_STEP_M)):
            self.go()
            self.see({})
        return self

    def go(self) -> None:
        self.left += WALL_STEP_TICKS
        self.right += WALL_STEP_TICKS
        self.x_m += WALL_STEP_M * cos(self.heading_rad)
        self.y_m += WALL_STEP_M * sin(self.heading_rad)
        self.wheels()

    def drift(self, angle_rad: float, sigma_rad: float) -> "DriveAlongWall":
        """Turn the estimate only."""
        x_m, y_m, heading_rad = self.odometry.pose
        self.odometry.pose = Pose(x_m, y_m, wrap(heading_rad + angle_rad))
        self.odometry.phh += sigma_rad * sigma_rad
        return self

    @property
    def error_rad(self) -> float:
        return float(wrap(self.heading_rad - self.odometry.pose.heading_rad))

    @property
    def covariance(self) -> np.ndarray:
        o = self.odometry
        rows = [[o.pxx, o.pxy, o.pxh], [o.pxy, o.pyy, o.pyh], [o.pxh, o.pyh, o.phh]]
        return np.array(rows)


def test_first_wall_becomes_the_reference_only() -> None:
    drive, plain = DriveAlongWall().along(0.05), DriveAlongWall().free(0.6)
    assert drive.walls.wall_rad == pytest.approx(0.05, abs=0.004)
    assert drive.odometry.pose == plain.odometry.pose


@each("side", [LEFT, RIGHT])
@each("turned_deg", [0.0, 90.0, 180.0, -90.0])
def test_parallel_or_perpendicular_wall_corrects(side: int, turned_deg: float) -> None:
    drive = DriveAlongWall().along(0.0).turn(radians(turned_deg)).drift(0.06, 0.06)
    drive.along(radians(turned_deg), side=side)
    assert abs(drive.error_rad) < 0.02
    assert drive.odometry.phh < 0.04**2


def test_correction_moves_the_position_back_onto_the_way() -> None:
    drive = DriveAlongWall().along(0.0).drift(0.06, 0.06).free(1.0)
    off_m = drive.odometry.pose.y_m - drive.y_m
    drive.along(0.0)
    assert abs(drive.odometry.pose.y_m - drive.y_m) < 0.3 * off_m


@each("wall_deg", [12.0, 30.0, 45.0])
def test_wall_of_another_direction_does_not_correct(wall_deg: float) -> None:
    drive = DriveAlongWall().along(0.0).turn(radians(wall_deg)).drift(0.03, 0.03)
    before_rad = drive.error_rad
    drive.along(radians(wall_deg))
    assert drive.error_rad == pytest.approx(before_rad, abs=1e-9)
    assert drive.walls.differed == 1.0


def test_nothing_is_corrected_while_most_walls_differ() -> None:
    drive = DriveAlongWall().along(0.0)
    for wall_deg in (20.0, 40.0, 65.0):
        drive.turn(radians(wall_deg) - drive.heading_rad).along(radians(wall_deg))
    drive.turn(-drive.heading_rad).drift(0.03, 0.03)
    before_rad = drive.error_rad
    drive.along(0.0)
    assert drive.error_rad == pytest.approx(before_rad, abs=1e-9)


def test_two_walls_that_agree_replace_a_lone_reference() -> None:
    drive = DriveAlongWall().along(0.0).turn(radians(30.0))
    drive.along(radians(30.0)).along(radians(30.0))
    assert drive.walls.wall_rad == pytest.approx(radians(30.0), abs=0.01)
    assert (drive.walls.agreed, drive.walls.differed) == (1.0, 1.0)


def test_unknown_heading_takes_the_next_wall_as_reference() -> None:
    drive = DriveAlongWall().along(0.0).drift(0.5, 0.5)
    drive.along(0.0)
    assert drive.error_rad == pytest.approx(-0.5, abs=1e-9)
    drive.drift(0.06, 0.06).along(0.0)
    assert drive.error_rad == pytest.approx(-0.5, abs=0.015)


def test_walls_that_are_not_quite_parallel_count_less() -> None:
    drive = DriveAlongWall()
    for wall_deg in (0.0, 1.5, -1.5, 1.5, -1.5, 1.5):
        drive.along(radians(wall_deg))
    assert drive.walls.spread_rad2 > 2.0 * wall_heading.WALL_RAD2


def test_wall_that_is_followed_for_long_counts_once() -> None:
    drive = DriveAlongWall().along(0.0).drift(0.05, 0.05).along(0.0, 3.0)
    assert drive.walls.agreed == 1.0
    assert drive.walls.left.repeats == 8


@each("radius_m", [0.1, 0.3, 0.8])
def test_disc_that_is_driven_round_is_no_wall(radius_m: float) -> None:
    drive = DriveAlongWall()
    orbit_m = radius_m + NEAR_M + DEFAULTS.radius_m
    for _ in range(round(2.0 * pi * orbit_m / WALL_STEP_M)):
        more = WALL_STEP_TICKS * 0.5 * DEFAULTS.track_m / orbit_m
        drive.left += round(WALL_STEP_TICKS - more)
        drive.right += round(WALL_STEP_TICKS + more)
        drive.wheels()
        drive.see({7: NEAR_M})
    assert drive.walls.agreed < 0.0


def test_post_that_is_passed_is_no_wall() -> None:
    drive = DriveAlongWall()
    for k in range(-40, 41):
        drive.go()
        drive.see({0: ((WALL_STEP_M * k) ** 2 + 0.3**2) ** 0.5 - DEFAULTS.radius_m})
    assert drive.walls.agreed < 0.0


def test_wall_that_is_approached_obliquely_is_not_used() -> None:
    drive = DriveAlongWall()
    for k in range(60):
        drive.go()
        drive.see({7: 0.5 - WALL_STEP_M * k * tan(radians(10.0))})
    assert drive.walls.agreed < 0.0


def test_corner_between_two_walls_is_no_wall() -> None:
    drive = DriveAlongWall()
    for k in range(34):
        drive.go()
        drive.see({7: NEAR_M + max(0.0, 0.004 * (k - 17))})
    assert drive.walls.agreed < 0.0


def test_single_false_echoes_do_not_end_a_stretch() -> None:
    drive = DriveAlongWall()
    for k in range(40):
        drive.go()
        drive.see({7: 0.05 if k % 10 == 5 else 0.2})
    assert drive.walls.wall_rad == pytest.approx(0.0, abs=0.002)
    assert drive.walls.agreed == 0.0


def test_nothing_is_corrected_while_the_wheels_slip() -> None:
    drive = DriveAlongWall().along(0.0).drift(0.06, 0.06)
    drive.slip.share = 0.3
    before_rad = drive.error_rad
    drive.along(0.0)
    assert drive.error_rad == before_rad


def test_correction_reduces_the_direction_of_unknown_slip() -> None:
    drive = DriveAlongWall().along(0.0).drift(0.06, 0.06)
    drive.slip.one_h = 1.0
    drive.along(0.0)
    assert abs(drive.slip.one_h) < 0.2


def test_certain_heading_is_not_changed() -> None:
    drive = DriveAlongWall(0.005, DEFAULTS._replace(k_r_m=0.0, k_l_m=0.0))
    for wall_deg in (0.0, 0.5, -0.5, 0.5):
        drive.along(radians(wall_deg))
    assert drive.walls.agreed == 3.0
    assert drive.odometry.pose.heading_rad == 0.0


@each("value", [nan, inf])
def test_pose_that_is_not_finite_is_left_alone(value: float) -> None:
    drive = DriveAlongWall().along(0.0)
    drive.odometry.pose = Pose(value, 0.0, 0.0)
    drive.go()
    drive.see({7: NEAR_M})
    assert drive.walls.wall_rad == pytest.approx(0.0, abs=0.002)


def test_error_fits_the_covariance_on_long_ways_between_walls() -> None:
    slip_m = DEFAULTS.k_r_m**0.5
    squares, inside = [], 0
    for seed in range(40):
        drive = DriveAlongWall(sigma_m=0.004)
        random = drive.random = np.random.default_rng(seed)
        for _ in range(4):
            for _ in range(4):
                drive.along(0.0, 0.5)
                noise_rad = slip_m * (2.0 * 0.6) ** 0.5 / DEFAULTS.track_m
                drive.heading_rad += float(random.normal(0.0, noise_rad))
            drive.turn(-drive.heading_rad)
        assert np.linalg.eigvalsh(drive.covariance)[0] > 0.0
        squares.append(drive.error_rad**2 / drive.odometry.phh)
        inside += squares[-1] < 3.84
    assert 0.5 < sum(squares) / len(squares) < 1.6
    assert inside >= 35
