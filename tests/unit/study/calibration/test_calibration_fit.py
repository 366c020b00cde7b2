from math import log

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS
from robot.parameter_table import OutOfRangeError, with_values
from study.calibration import (
    Fit,
    SquareRun,
    believed,
    covariance_of,
    covariance_parts_of,
    fit_parameters,
    minimum,
    most_likely_k,
)
from tests.support.each import each
from tests.support.study.calibration_runs import squares


@given(st.floats(-20.0, 5.0))
def test_minimum_of_a_unimodal_function_is_found(bottom: float) -> None:
    found = minimum(lambda x: (log(x) - bottom) ** 2, 1e-10, 1e4)
    assert log(found) == pytest.approx(bottom, abs=1e-5)


def test_fit_is_exact_without_slip() -> None:
    truth = {"wheel_ratio": 1.005, "track_m": 0.202}
    fit = fit_parameters(squares(truth, 2), DEFAULTS)
    assert fit.value["wheel_ratio"] == pytest.approx(1.005, abs=1e-7)
    assert fit.value["track_m"] == pytest.approx(0.202, abs=1e-7)
    assert fit.value["k_r_m"] == fit.value["k_l_m"] == 0.0


def test_fit_with_slip_is_within_its_errors() -> None:
    truth = {"wheel_ratio": 1.005, "track_m": 0.201}
    fit = fit_parameters(squares(truth, 15, slip_m=2e-5, seed=4), DEFAULTS)
    for name, value in (*truth.items(), ("k_r_m", 2e-5), ("k_l_m", 2e-5)):
        assert abs(fit.value[name] - value) < 3.0 * fit.error[name]
    assert fit.error["wheel_ratio"] < 5e-4
    assert set(fit.adopted(DEFAULTS)) >= {"wheel_ratio", "k_r_m", "k_l_m"}


def test_insignificant_changes_are_not_adopted() -> None:
    fit = fit_parameters(squares({}, 15, slip_m=2e-6, seed=2), DEFAULTS)
    assert fit.adopted(DEFAULTS) == {}


@each("k_m", [1e-7, 2e-6, 3e-5])
def test_most_likely_k_matches_simulated_errors(k_m: float) -> None:
    spreads = covariance_parts_of(squares({}, 20), DEFAULTS)
    rng = np.random.default_rng(8)
    drawn = [rng.multivariate_normal(np.zeros(3), one) for one in spreads.covariance(k_m)]
    assert most_likely_k(np.array(drawn), spreads) == pytest.approx(k_m, rel=0.3)


def test_covariance_parts_add_up_to_that_of_the_core() -> None:
    runs = squares({}, 1)
    covariance = covariance_parts_of(runs, DEFAULTS).covariance(3e-6)
    params = with_values(DEFAULTS, {"k_r_m": 3e-6, "k_l_m": 3e-6})
    for one, run in zip(covariance, runs, strict=True):
        assert one == pytest.approx(covariance_of(believed(run, params)), rel=2e-3, abs=1e-9)


def test_impossible_runs_raise_an_error() -> None:
    runs = [
        SquareRun(direction=run.direction, ticks=run.ticks, measured=run.measured._replace(x_m=9e3))
        for run in squares({}, 2)
    ]
    with pytest.raises(OutOfRangeError):
        fit_parameters(runs, DEFAULTS)


@each(("k_m", "set_"), [(1.4e-6, False), (1.1e-6, True), (3.5e-6, True)])
def test_k_changes_only_when_significantly_different(k_m: float, set_: bool) -> None:
    relative = 0.13
    value = {"wheel_ratio": 1.0, "track_m": 0.2, "k_r_m": k_m, "k_l_m": k_m}
    error = {"wheel_ratio": 1e-4, "track_m": 1e-4, "k_r_m": relative * k_m, "k_l_m": relative * k_m}
    assert ("k_r_m" in Fit(value=value, error=error).adopted(DEFAULTS)) is set_
