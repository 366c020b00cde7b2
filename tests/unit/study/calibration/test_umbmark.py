from math import hypot

import pytest

from robot.core.parameters import DEFAULTS
from robot.parameter_table import with_values
from study.calibration import CCW, CW, umbmark, wheel_ratio
from tests.support.each import each
from tests.support.study.calibration_runs import SIDE_M, squares


def test_correct_parameters_give_no_error() -> None:
    mark = umbmark(squares({}, 1), DEFAULTS, SIDE_M)
    assert mark.largest_m == pytest.approx(0.0, abs=1e-9)
    assert mark.wheel_ratio == pytest.approx(1.0)
    assert mark.track_ratio == pytest.approx(1.0)


@each("ratio", [0.996, 0.999, 1.001, 1.005])
def test_wheel_ratio_is_within_15_percent(ratio: float) -> None:
    mark = umbmark(squares({"wheel_ratio": ratio}, 1), DEFAULTS, SIDE_M)
    assert mark.wheel_ratio - 1.0 == pytest.approx(ratio - 1.0, rel=0.15)
    assert mark.track_ratio == pytest.approx(1.0, abs=0.8 * abs(ratio - 1.0))


@each("track_m", [0.198, 0.1995, 0.2005, 0.203])
def test_track_ratio_is_within_10_percent(track_m: float) -> None:
    mark = umbmark(squares({"track_m": track_m}, 1), DEFAULTS, SIDE_M)
    assert mark.track_ratio - 1.0 == pytest.approx(track_m / 0.2 - 1.0, rel=0.1)
    assert mark.wheel_ratio == pytest.approx(1.0, abs=1e-4)


def test_centres_agree_with_the_small_angle_formula() -> None:
    """Bend sides by b to the left: ccw returns by 2 L b in x, -y, cw by -2 L b in x, y."""
    ratio = 1.0005
    bent_rad = (ratio - 1.0) * SIDE_M / DEFAULTS.track_m
    mark = umbmark(squares({"wheel_ratio": ratio}, 1), DEFAULTS, SIDE_M)
    way_m = 2.0 * SIDE_M * bent_rad
    assert mark.ccw_m == pytest.approx((way_m, -way_m), rel=0.1)
    assert mark.cw_m == pytest.approx((-way_m, -way_m), rel=0.1)
    assert mark.largest_m == max(hypot(*mark.cw_m), hypot(*mark.ccw_m))


def test_true_parameters_remove_the_error() -> None:
    truth = {"wheel_ratio": 1.006, "track_m": 0.203}
    runs = squares(truth, 1)
    assert umbmark(runs, DEFAULTS, SIDE_M).largest_m > 0.5
    assert umbmark(runs, with_values(DEFAULTS, truth), SIDE_M).largest_m < 1e-9


def test_straight_side_means_equal_wheels() -> None:
    assert wheel_ratio(0.0, 4.0, 0.2) == 1.0
    assert wheel_ratio(0.1, 4.0, 0.2) * wheel_ratio(-0.1, 4.0, 0.2) == pytest.approx(1.0)


def test_squares_are_driven_in_both_directions() -> None:
    directions = [run.direction for run in squares({}, 2)]
    assert directions == [CW, CW, CCW, CCW]
