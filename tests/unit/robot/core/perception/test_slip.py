from math import cos, hypot, inf, nan, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS
from robot.core.perception import odometry as odometries
from robot.core.perception import slip as slips
from robot.core.perception.odometry import Odometry
from robot.core.perception.slip import Slip
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Wheels
from tests.support.each import each

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
