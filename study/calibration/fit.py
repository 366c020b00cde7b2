"""The parameters under which the measured ends of the runs are most likely, and how surely so.

Wheels and track by generalized least squares: each end is weighed with the covariance that the
robot's own odometry has for it. Then k_r and k_l by maximum likelihood from what still scatters.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, log
from typing import Final, NamedTuple

import numpy as np

from robot.core.parameters import Params
from robot.parameters.table import with_values
from study.calibration.runs import Array, Run, believed, covariance_of, errors_of

SYSTEMATIC: Final = ("wheel_ratio", "track_m")
ROUNDS: Final = 4
STEP: Final = 1e-4
PROBE_M: Final = 1e-9
SURE: Final = 2.58
"""Standard errors by which a parameter must be off to be changed: one in a hundred by chance."""
LEAST_K_M: Final = 1e-10
MOST_K_M: Final = 1e-2
SHRINK: Final = 0.6180339887498949
SEARCH_ROUNDS: Final = 36
"""To 3e-8 of the span, in powers of ten."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Best value and standard error by parameter name."""

    value: dict[str, float]
    error: dict[str, float]

    def adopted(self, before: Params) -> dict[str, float]:
        """Only what differs from the present value by more than chance: the rest stays.

        What chance does to a k grows with the true one, and that may be the present one.
        """
        kept = {}
        for name, value in self.value.items():
            now, doubt = float(getattr(before, name)), self.error[name]
            if name not in SYSTEMATIC and value > 0.0:
                doubt *= max(1.0, now / value)
            if abs(value - now) > SURE * doubt:
                kept[name] = float(f"{value:.6g}")
        return kept


class Spreads(NamedTuple):
    """Per run: covariance by whole ticks and by a unit k of both wheels, and the bend by that k."""

    grain: Array
    by_slip: Array
    bend: Array

    def covariance(self, k_m: float) -> Array:
        bend = k_m * self.bend
        total: Array = self.grain + k_m * self.by_slip + bend[:, :, None] * bend[:, None, :]
        return total


def fitted(runs: Sequence[Run], before: Params) -> Fit:
    """Alternate: wheels and track with the present k, then k from the rest.

    Raises OutOfRange or LinAlgError when the runs are none that any robot could have driven.
    """
    params, k_m = before, max(0.5 * (before.k_r_m + before.k_l_m), LEAST_K_M)
    information: Array = np.zeros((2, 2))
    for _ in range(ROUNDS):
        spreads = spreads_of(runs, params)
        weights = np.linalg.inv(spreads.covariance(k_m))
        slopes, errors = slopes_of(runs, params), errors_of(runs, params)
        information = np.einsum("nip,nij,njq->pq", slopes, weights, slopes)
        pull = np.einsum("nip,nij,nj->p", slopes, weights, errors)
        change = np.linalg.solve(information, pull)
        values = [getattr(params, name) for name in SYSTEMATIC] + change
        params = with_values(params, dict(zip(SYSTEMATIC, map(float, values), strict=True)))
        k_m = likeliest_k(errors - np.einsum("nip,p->ni", slopes, change), spreads)
    return judged(params, information, k_m, len(runs))


def judged(params: Params, information: Array, k_m: float, runs: int) -> Fit:
    """With standard errors; a variance is as sure as the number of errors it was found from."""
    covariance = np.linalg.inv(information)
    relative = (2.0 / (3 * runs - len(SYSTEMATIC))) ** 0.5
    value = {name: float(getattr(params, name)) for name in SYSTEMATIC}
    error = dict(zip(SYSTEMATIC, map(float, np.sqrt(np.diag(covariance))), strict=True))
    for name in ("k_r_m", "k_l_m"):
        value[name] = k_m if k_m > 1.01 * LEAST_K_M else 0.0
        error[name] = relative * k_m
    return Fit(value=value, error=error)


def spreads_of(runs: Sequence[Run], params: Params) -> Spreads:
    """From the core itself, run with no slip and with a probe of slip."""
    still = with_values(params, {"k_r_m": 0.0, "k_l_m": 0.0})
    probe = with_values(params, {"k_r_m": PROBE_M, "k_l_m": PROBE_M})
    grain, by_slip, bends = [], [], []
    for run in runs:
        grain.append(covariance_of(believed(run, still)))
        probed = believed(run, probe)
        by_slip.append((covariance_of(probed) - grain[-1]) / PROBE_M)
        bends.append(np.array([probed.bend_x_m, probed.bend_y_m, 0.0]) / PROBE_M)
    return Spreads(np.array(grain), np.array(by_slip), np.array(bends))


def slopes_of(runs: Sequence[Run], params: Params) -> Array:
    """How the believed end moves with each systematic parameter: (runs, 3, parameters)."""
    slopes = []
    for name in SYSTEMATIC:
        step = STEP * getattr(params, name)
        more = with_values(params, {name: getattr(params, name) + step})
        less = with_values(params, {name: getattr(params, name) - step})
        slopes.append((errors_of(runs, less) - errors_of(runs, more)) / (2.0 * step))
    stacked: Array = np.stack(slopes, axis=2)
    return stacked


def likeliest_k(errors: Array, spreads: Spreads) -> float:
    """One k for both wheels: a square, on which both roll as far, cannot tell them apart."""

    def unlikely(k_m: float) -> float:
        covariance = spreads.covariance(k_m)
        distance2 = np.einsum("ni,nij,nj->", errors, np.linalg.inv(covariance), errors)
        return float(distance2 + np.linalg.slogdet(covariance)[1].sum())

    return least(unlikely, LEAST_K_M, MOST_K_M)


def least(function: Callable[[float], float], low: float, high: float) -> float:
    """Golden-section search on the logarithm, for a function with one valley."""
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
