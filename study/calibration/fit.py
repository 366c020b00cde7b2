"""Maximum-likelihood parameters of the measured ends of the runs, with standard errors.

Wheels and track by generalized least squares: each end is weighted with the covariance of the
robot's own odometry. Then k_r and k_l by maximum likelihood from the remaining scatter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, log
from typing import Final, NamedTuple

import numpy as np

from robot.core.parameters import Params
from robot.parameters.table import with_values
from study.calibration.runs import Array, SquareRun, believed, covariance_of, errors_of

SYSTEMATIC: Final = ("wheel_ratio", "track_m")
ROUNDS: Final = 4
STEP: Final = 1e-4
PROBE_M: Final = 1e-9
MIN_STANDARD_ERRORS: Final = 2.58
"""Standard errors by which a parameter must differ to be changed; by chance one in a hundred."""
MIN_K_M: Final = 1e-10
MAX_K_M: Final = 1e-2
SHRINK: Final = 0.6180339887498949
SEARCH_ROUNDS: Final = 36
"""The search ends within 3e-8 of the span, which is logarithmic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Best value and standard error by parameter name."""

    value: dict[str, float]
    error: dict[str, float]

    def adopted(self, before: Params) -> dict[str, float]:
        """Return only values that differ from the present ones by more than chance.

        The standard error of a k grows with the true k, which may be the present one.
        """
        kept = {}
        for name, value in self.value.items():
            now, error = float(getattr(before, name)), self.error[name]
            if name not in SYSTEMATIC and value > 0.0:
                error *= max(1.0, now / value)
            if abs(value - now) > MIN_STANDARD_ERRORS * error:
                kept[name] = float(f"{value:.6g}")
        return kept


class CovarianceParts(NamedTuple):
    """Per run: covariance by whole ticks and per unit k of both wheels, and the bend per unit k."""

    grain: Array
    by_slip: Array
    bend: Array

    def covariance(self, k_m: float) -> Array:
        """Return the covariances of all runs for this k, shape (runs, 3, 3)."""
        bend = k_m * self.bend
        total: Array = self.grain + k_m * self.by_slip + bend[:, :, None] * bend[:, None, :]
        return total


def fit_parameters(runs: Sequence[SquareRun], before: Params) -> Fit:
    """Alternate between wheels and track with the present k, and k from the residuals.

    Raises OutOfRangeError or LinAlgError for runs that no robot can have driven.
    """
    params, k_m = before, max(0.5 * (before.k_r_m + before.k_l_m), MIN_K_M)
    information: Array = np.zeros((2, 2))
    for _ in range(ROUNDS):
        spreads = covariance_parts_of(runs, params)
        weights = np.linalg.inv(spreads.covariance(k_m))
        slopes, errors = jacobians_of(runs, params), errors_of(runs, params)
        information = np.einsum("nip,nij,njq->pq", slopes, weights, slopes)
        pull = np.einsum("nip,nij,nj->p", slopes, weights, errors)
        change = np.linalg.solve(information, pull)
        values = [getattr(params, name) for name in SYSTEMATIC] + change
        params = with_values(params, dict(zip(SYSTEMATIC, map(float, values), strict=True)))
        k_m = most_likely_k(errors - np.einsum("nip,p->ni", slopes, change), spreads)
    return with_standard_errors(params, information, k_m, len(runs))


def with_standard_errors(params: Params, information: Array, k_m: float, runs: int) -> Fit:
    """Return the fit with the standard error of each parameter.

    That of a variance follows from the number of errors it was estimated from.
    """
    covariance = np.linalg.inv(information)
    relative = (2.0 / (3 * runs - len(SYSTEMATIC))) ** 0.5
    value = {name: float(getattr(params, name)) for name in SYSTEMATIC}
    error = dict(zip(SYSTEMATIC, map(float, np.sqrt(np.diag(covariance))), strict=True))
    for name in ("k_r_m", "k_l_m"):
        value[name] = k_m if k_m > 1.01 * MIN_K_M else 0.0
        error[name] = relative * k_m
    return Fit(value=value, error=error)


def covariance_parts_of(runs: Sequence[SquareRun], params: Params) -> CovarianceParts:
    """Run the core's odometry without slip, and with a small slip as a probe."""
    still = with_values(params, {"k_r_m": 0.0, "k_l_m": 0.0})
    probe = with_values(params, {"k_r_m": PROBE_M, "k_l_m": PROBE_M})
    grain, by_slip, bends = [], [], []
    for run in runs:
        grain.append(covariance_of(believed(run, still)))
        probed = believed(run, probe)
        by_slip.append((covariance_of(probed) - grain[-1]) / PROBE_M)
        bends.append(np.array([probed.bend_x_m, probed.bend_y_m, 0.0]) / PROBE_M)
    return CovarianceParts(np.array(grain), np.array(by_slip), np.array(bends))


def jacobians_of(runs: Sequence[SquareRun], params: Params) -> Array:
    """Return derivatives of the estimated ends, shape (runs, 3, parameters)."""
    slopes = []
    for name in SYSTEMATIC:
        step = STEP * getattr(params, name)
        more = with_values(params, {name: getattr(params, name) + step})
        less = with_values(params, {name: getattr(params, name) - step})
        slopes.append((errors_of(runs, less) - errors_of(runs, more)) / (2.0 * step))
    stacked: Array = np.stack(slopes, axis=2)
    return stacked


def most_likely_k(errors: Array, spreads: CovarianceParts) -> float:
    """Return one k for both wheels: on a square both roll as far, so they cannot be separated."""

    def minus_log_likelihood(k_m: float) -> float:
        covariance = spreads.covariance(k_m)
        distance2 = np.einsum("ni,nij,nj->", errors, np.linalg.inv(covariance), errors)
        return float(distance2 + np.linalg.slogdet(covariance)[1].sum())

    return minimum(minus_log_likelihood, MIN_K_M, MAX_K_M)


def minimum(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the minimum of a unimodal function by golden-section search on the logarithm."""
    a, b = log(low), log(high)
    c, d = b - SHRINK * (b - a), a + SHRINK * (b - a)
    at_c, at_d = function(exp(c)), function(exp(d))
    for _ in range(SEARCH_ROUNDS):
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - SHRINK * (b - a)
            at_c = function(exp(c))
        else:
            a, c, at_c = c, d, at_d
            d = a + SHRINK * (b - a)
            at_d = function(exp(d))
    return exp(0.5 * (a + b))
