"""Intervals and tests for trials, exact where counting is cheap, and deterministic.

The intervals of quantiles come from order statistics: unlike a bootstrap they need no seed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from math import ceil, comb, erfc, exp, floor, inf, ldexp, lgamma, log, nan, sqrt
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.outcome import OUTSIDE

Floats = NDArray[np.float64]

CONFIDENCE: Final = 1.0 - OUTSIDE
CONFIDENT: Final = f"{100.0 * CONFIDENCE:g} %"
Z_TWO_SIDED: Final = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2.0)
"""Two-sided quantile of the normal distribution in standard deviations."""

EXACT_RANKS: Final = 40
"""Up to this number of pairs the signed-rank test enumerates all sign patterns."""


BISECTIONS: Final = 60


class Interval(NamedTuple):
    """Lower and upper bound."""

    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Proportion:
    """A proportion, `count` of `of`, which tells as much as `independent` trials; None: as `of`."""

    count: int
    of: int
    independent: float | None = field(default=None, compare=False)

    @property
    def rate(self) -> float:
        """The proportion; NaN of nothing."""
        return self.count / self.of if self.of else nan

    @property
    def interval(self) -> Interval:
        """Wilson's interval."""
        return wilson(self.count, self.of, self.independent)

    @property
    def most(self) -> float:
        """The exact one-sided upper bound."""
        if self.independent is None or not self.of:
            return upper_bound(self.count, self.of)
        return upper_bound(ceil(self.rate * self.independent), max(1, floor(self.independent)))


def wilson(count: int, of: int, independent: float | None = None) -> Interval:
    """Return the score interval of a proportion (Wilson 1927); (0, 1) of nothing.

    It is as wide as that of so many `independent` trials at the same rate.
    """
    if of == 0:
        return Interval(0.0, 1.0)
    size = float(of) if independent is None else independent
    rate, weight = count / of, Z_TWO_SIDED * Z_TWO_SIDED / size
    middle = (rate + weight / 2.0) / (1.0 + weight)
    half = Z_TWO_SIDED / (1.0 + weight) * sqrt(rate * (1.0 - rate) / size + weight / (4.0 * size))
    low = 0.0 if count == 0 else max(0.0, middle - half)
    return Interval(low, 1.0 if count == of else min(1.0, middle + half))


def independent_size(chosen: NDArray[np.bool_], worlds: NDArray[np.str_]) -> float:
    """Return as many independent trials as these, in several trials a world, tell as much.

    It is their number over the design effect (Kish 1965): the variance of the proportion by worlds
    over that of independent trials. Where all trials end alike, nothing tells how much those of one
    world depend on each other: each world counts once.
    """
    _, places = np.unique(worlds, return_inverse=True)
    each = np.bincount(places).astype(np.float64)
    count, of = len(each), len(chosen)
    rate = float(np.count_nonzero(chosen)) / of if of else 0.0
    if count < 2 or rate in (0.0, 1.0):
        return float(count)
    apart = np.bincount(places, chosen.astype(np.float64)) - rate * each
    variance = count / (count - 1) * float((apart**2).sum()) / of**2
    alone = rate * (1.0 - rate) / (of - 1)
    return min(float(of), max(1.0, of * alone / variance)) if variance > 0.0 else float(of)


def upper_bound(count: int, of: int, confidence: float = CONFIDENCE) -> float:
    """Return the exact one-sided upper bound of a proportion (Clopper and Pearson 1934).

    With this confidence the true rate is not larger. Without events it is 1 - (1 - confidence) to
    the power of 1 / of; 1 of nothing.
    """
    if count >= of:
        return 1.0
    # The terms far below the count vanish, as the rate is at least count / of.
    least = max(0, count - 20 - int(12.0 * sqrt(count)))
    low, high = count / of, 1.0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        below = sum(_binomial(k, of, middle) for k in range(least, count + 1))
        low, high = (middle, high) if below > 1.0 - confidence else (low, middle)
    return high


def ratio_interval(first: int, of_first: int, second: int, of_second: int) -> Interval:
    """Return the log interval of a ratio of two proportions (Katz et al. 1978).

    It takes the two samples as independent. For pairs of trials that tend to end alike it is wider
    than necessary. Unbounded where one count is zero: then the logarithm has no estimate.
    """
    if not first or not second:
        return Interval(0.0, inf)
    half = Z_TWO_SIDED * sqrt(1.0 / first - 1.0 / of_first + 1.0 / second - 1.0 / of_second)
    ratio = (first / of_first) / (second / of_second)
    return Interval(ratio * exp(-half), ratio * exp(half))


def by_world(values: Floats, worlds: NDArray[np.str_]) -> Floats:
    """Return the mean of the known values in each world that has one."""
    known = np.isfinite(values)
    _, places = np.unique(worlds[known], return_inverse=True)
    found: Floats = np.bincount(places, values[known]) / np.bincount(places)
    return found


def mean_interval(values: Sequence[float] | Floats) -> Interval:
    """Return the interval of a mean by the normal approximation; unbounded below two values."""
    found = _finite(values)
    if len(found) < 2:
        return Interval(-inf, inf)
    half = Z_TWO_SIDED * float(found.std(ddof=1))
    half /= sqrt(len(found))
    return Interval(float(found.mean()) - half, float(found.mean()) + half)


def binomial_two_sided(count: int, of: int) -> float:
    """Return the two-sided p-value of the sign test for `count` of `of`."""
    if of == 0:
        return 1.0
    fewer = min(count, of - count)
    term, total = 1, 1
    for k in range(fewer):
        term = term * (of - k) // (k + 1)
        total += term
    # The numbers may have thousands of digits, too many for a float: divide by shifting.
    shift = max(0, total.bit_length() - 64)
    return min(1.0, ldexp(total >> shift, shift - of + 1))


def signed_rank(differences: Sequence[float] | Floats) -> float:
    """Return the two-sided p-value of Wilcoxon's signed-rank test.

    Zeros are left out and ties share their rank. The test is exact up to `EXACT_RANKS` pairs, ties
    included; above, it is normal with corrections for ties and continuity.
    """
    values = np.asarray(differences, dtype=np.float64)
    values = values[np.isfinite(values) & (values != 0.0)]
    if len(values) == 0:
        return 1.0
    doubled = _doubled_ranks(np.abs(values))
    positive = int(doubled[values > 0.0].sum())
    fewer = min(positive, int(doubled.sum()) - positive)
    if len(values) <= EXACT_RANKS:
        ways = [1]
        for rank in doubled.tolist():
            ways = _spread(ways, rank)
        return min(1.0, 2 * sum(ways[: fewer + 1]) / (1 << len(values)))
    mean, spread = float(doubled.sum()) / 2.0, sqrt(float((doubled**2).sum())) / 2.0
    return min(1.0, erfc(max(0.0, mean - fewer - 1.0) / spread / sqrt(2.0)))


def _doubled_ranks(sizes: Floats) -> NDArray[np.int64]:
    """Return twice the rank of each value, so that mean ranks of ties are whole numbers."""
    _, group, counts = np.unique(sizes, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    doubled = 2 * last - counts + 1
    found: NDArray[np.int64] = doubled[group].astype(np.int64)
    return found


def _spread(ways: list[int], rank: int) -> list[int]:
    """Return the number of ways to reach each sum with one more rank in it or not."""
    found = ways + [0] * rank
    for total, count in enumerate(ways):
        found[total + rank] += count
    return found


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for multiple tests (Holm 1979), in the order given."""
    order = sorted(range(len(p_values)), key=lambda index: p_values[index])
    stepped = (p_values[index] * (len(order) - place) for place, index in enumerate(order))
    adjusted = dict(zip(order, accumulate(stepped, max), strict=True))
    return [min(1.0, adjusted[index]) for index in range(len(p_values))]


def quantile(values: Sequence[float] | Floats, at: float) -> float:
    """Return the quantile, interpolated between neighbours; NaN of nothing."""
    found = _finite(values)
    return float(np.quantile(found, at)) if len(found) else nan


def mean(values: Sequence[float] | Floats) -> float:
    """Return the mean of the known values; NaN of nothing."""
    found = _finite(values)
    return float(found.mean()) if len(found) else nan


def quantile_interval(
    values: Sequence[float] | Floats, at: float, worlds: NDArray[np.str_] | None = None
) -> Interval:
    """Return a distribution-free interval by order statistics (David & Nagaraja 7.1).

    A bound is infinite where there are too few values. With the world of each value, several values
    of one world tell no more than one.
    """
    known = np.isfinite(np.asarray(values, dtype=np.float64))
    found = np.sort(_finite(values))
    count = len(found) if worlds is None else len(np.unique(worlds[known]))
    tail = (1.0 - CONFIDENCE) / 2.0
    below = _binomial_quantile(tail, count, at)
    above = _binomial_quantile(1.0 - tail, count, at) + 1
    low = float(found[below * len(found) // count - 1]) if below >= 1 else -inf
    high = inf if above > count else float(found[-(-above * len(found) // count) - 1])
    return Interval(low, high)


def _finite(values: Sequence[float] | Floats) -> Floats:
    found = np.asarray(values, dtype=np.float64)
    return found[np.isfinite(found)]


def _binomial_quantile(probability: float, of: int, rate: float) -> int:
    """Return the smallest k with P(count <= k) >= probability."""
    total = 0.0
    # Terms beyond ten standard deviations are zero in a float.
    for k in range(max(0, int(of * rate - 10.0 * sqrt(of)) - 1), of + 1):
        total += _binomial(k, of, rate)
        if total >= probability:
            return k
    return of


def _binomial(k: int, of: int, rate: float) -> float:
    if of <= 60:
        return comb(of, k) * rate**k * (1.0 - rate) ** (of - k)
    ways = lgamma(of + 1) - lgamma(k + 1) - lgamma(of - k + 1)
    return exp(ways + k * log(rate) + (of - k) * log(1.0 - rate))
