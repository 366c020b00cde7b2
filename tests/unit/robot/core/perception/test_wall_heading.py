from math import cos, inf, nan, pi, radians, sin, tan

import numpy as np
import pytest

from robot.core.parameters import DEFAULTS, Params
from robot.core.perception import odometry as odometries
from robot.core.perception import wall_heading
from robot.core.perception.odometry import Odometry
from robot.core.perception.slip import Slip
from robot.core.perception.sonar_ring import Ring
from robot.core.perception.wall_heading import WallHeading
from robot.core.values import Pose, Wheels, wrap
from tests.support.each import each

STEP_TICKS = 50  # 10 mm
STEP_M = STEP_TICKS * DEFAULTS.m_per_tick
NEAR_M = 0.1
LEFT, RIGHT = 1, -1


class Drive:
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

    def turn(self, angle_rad: float) -> "Drive":
        """Turn on the spot, without an echo."""
        ticks = round(0.5 * angle_rad * DEFAULTS.track_m / DEFAULTS.m_per_tick / 40)
        for _ in range(40):
            self.left -= ticks
            self.right += ticks
            self.heading_rad += 2.0 * ticks * DEFAULTS.m_per_tick / DEFAULTS.track_m
            self.wheels()
            self.see({})
        return self

    def along(self, wall_rad: float, way_m: float = 0.5, side: int = LEFT) -> "Drive":
        """Drive straight past a wall of this true direction; then there is none for 10 cm."""
        normal_x, normal_y = -side * sin(wall_rad), side * cos(wall_rad)
        offset_m = normal_x * self.x_m + normal_y * self.y_m + NEAR_M + DEFAULTS.radius_m
        for _ in range(round(way_m / STEP_M)):
            self.go()
            distance_m = offset_m - normal_x * self.x_m - normal_y * self.y_m
            distance_m += float(self.random.normal(0.0, 1.0)) * self.sigma_m
            self.see({7 if side == LEFT else 0: distance_m - DEFAULTS.radius_m})
        return self.free()

    def free(self, way_m: float = 0.1) -> "Drive":
        for _ in range(round(way_m / STEP_M)):
            self.go()
            self.see({})
        return self

    def go(self) -> None:
        self.left += STEP_TICKS
        self.right += STEP_TICKS
        self.x_m += STEP_M * cos(self.heading_rad)
        self.y_m += STEP_M * sin(self.heading_rad)
        self.wheels()

    def drift(self, angle_rad: float, sigma_rad: float) -> "Drive":
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
    drive, plain = Drive().along(0.05), Drive().free(0.6)
    assert drive.walls.wall_rad == pytest.approx(0.05, abs=0.004)
    assert drive.odometry.pose == plain.odometry.pose


@each("side", [LEFT, RIGHT])
@each("turned_deg", [0.0, 90.0, 180.0, -90.0])
def test_parallel_or_perpendicular_wall_corrects(side: int, turned_deg: float) -> None:
    drive = Drive().along(0.0).turn(radians(turned_deg)).drift(0.06, 0.06)
    drive.along(radians(turned_deg), side=side)
    assert abs(drive.error_rad) < 0.02
    assert drive.odometry.phh < 0.04**2


def test_correction_moves_the_position_back_onto_the_way() -> None:
    drive = Drive().along(0.0).drift(0.06, 0.06).free(1.0)
    off_m = drive.odometry.pose.y_m - drive.y_m
    drive.along(0.0)
    assert abs(drive.odometry.pose.y_m - drive.y_m) < 0.3 * off_m


@each("wall_deg", [12.0, 30.0, 45.0])
def test_wall_of_another_direction_does_not_correct(wall_deg: float) -> None:
    drive = Drive().along(0.0).turn(radians(wall_deg)).drift(0.03, 0.03)
    before_rad = drive.error_rad
    drive.along(radians(wall_deg))
    assert drive.error_rad == pytest.approx(before_rad, abs=1e-9)
    assert drive.walls.differed == 1.0


def test_nothing_is_corrected_while_most_walls_differ() -> None:
    drive = Drive().along(0.0)
    for wall_deg in (20.0, 40.0, 65.0):
        drive.turn(radians(wall_deg) - drive.heading_rad).along(radians(wall_deg))
    drive.turn(-drive.heading_rad).drift(0.03, 0.03)
    before_rad = drive.error_rad
    drive.along(0.0)
    assert drive.error_rad == pytest.approx(before_rad, abs=1e-9)


def test_two_walls_that_agree_replace_a_lone_reference() -> None:
    drive = Drive().along(0.0).turn(radians(30.0))
    drive.along(radians(30.0)).along(radians(30.0))
    assert drive.walls.wall_rad == pytest.approx(radians(30.0), abs=0.01)
    assert (drive.walls.agreed, drive.walls.differed) == (1.0, 1.0)


def test_unknown_heading_takes_the_next_wall_as_reference() -> None:
    drive = Drive().along(0.0).drift(0.5, 0.5)
    drive.along(0.0)
    assert drive.error_rad == pytest.approx(-0.5, abs=1e-9)
    drive.drift(0.06, 0.06).along(0.0)
    assert drive.error_rad == pytest.approx(-0.5, abs=0.015)


def test_walls_that_are_not_quite_parallel_count_less() -> None:
    drive = Drive()
    for wall_deg in (0.0, 1.5, -1.5, 1.5, -1.5, 1.5):
        drive.along(radians(wall_deg))
    assert drive.walls.spread_rad2 > 2.0 * wall_heading.WALL_RAD2


def test_wall_that_is_followed_for_long_counts_once() -> None:
    drive = Drive().along(0.0).drift(0.05, 0.05).along(0.0, 3.0)
    assert drive.walls.agreed == 1.0
    assert drive.walls.left.repeats == 8


@each("radius_m", [0.1, 0.3, 0.8])
def test_disc_that_is_driven_round_is_no_wall(radius_m: float) -> None:
    drive = Drive()
    orbit_m = radius_m + NEAR_M + DEFAULTS.radius_m
    for _ in range(round(2.0 * pi * orbit_m / STEP_M)):
        more = STEP_TICKS * 0.5 * DEFAULTS.track_m / orbit_m
        drive.left += round(STEP_TICKS - more)
        drive.right += round(STEP_TICKS + more)
        drive.wheels()
        drive.see({7: NEAR_M})
    assert drive.walls.agreed < 0.0


def test_post_that_is_passed_is_no_wall() -> None:
    drive = Drive()
    for k in range(-40, 41):
        drive.go()
        drive.see({0: ((STEP_M * k) ** 2 + 0.3**2) ** 0.5 - DEFAULTS.radius_m})
    assert drive.walls.agreed < 0.0


def test_wall_that_is_approached_obliquely_is_not_used() -> None:
    drive = Drive()
    for k in range(60):
        drive.go()
        drive.see({7: 0.5 - STEP_M * k * tan(radians(10.0))})
    assert drive.walls.agreed < 0.0


def test_corner_between_two_walls_is_no_wall() -> None:
    drive = Drive()
    for k in range(34):
        drive.go()
        drive.see({7: NEAR_M + max(0.0, 0.004 * (k - 17))})
    assert drive.walls.agreed < 0.0


def test_single_false_echoes_do_not_end_a_stretch() -> None:
    drive = Drive()
    for k in range(40):
        drive.go()
        drive.see({7: 0.05 if k % 10 == 5 else 0.2})
    assert drive.walls.wall_rad == pytest.approx(0.0, abs=0.002)
    assert drive.walls.agreed == 0.0


def test_nothing_is_corrected_while_the_wheels_slip() -> None:
    drive = Drive().along(0.0).drift(0.06, 0.06)
    drive.slip.share = 0.3
    before_rad = drive.error_rad
    drive.along(0.0)
    assert drive.error_rad == before_rad


def test_correction_reduces_the_direction_of_unknown_slip() -> None:
    drive = Drive().along(0.0).drift(0.06, 0.06)
    drive.slip.one_h = 1.0
    drive.along(0.0)
    assert abs(drive.slip.one_h) < 0.2


def test_certain_heading_is_not_changed() -> None:
    drive = Drive(0.005, DEFAULTS._replace(k_r_m=0.0, k_l_m=0.0))
    for wall_deg in (0.0, 0.5, -0.5, 0.5):
        drive.along(radians(wall_deg))
    assert drive.walls.agreed == 3.0
    assert drive.odometry.pose.heading_rad == 0.0


@each("value", [nan, inf])
def test_pose_that_is_not_finite_is_left_alone(value: float) -> None:
    drive = Drive().along(0.0)
    drive.odometry.pose = Pose(value, 0.0, 0.0)
    drive.go()
    drive.see({7: NEAR_M})
    assert drive.walls.wall_rad == pytest.approx(0.0, abs=0.002)


def test_error_fits_the_covariance_on_long_ways_between_walls() -> None:
    slip_m = DEFAULTS.k_r_m**0.5
    squares, inside = [], 0
    for seed in range(40):
        drive = Drive(sigma_m=0.004)
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
