"""The statistics agree with published values and hold their invariants."""

from itertools import product
from math import inf, isinf, isnan, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.outcome import CHI2_2, OUTSIDE
from study import intervals
from study.intervals import (
    Interval,
    Proportion,
    binomial_two_sided,
    by_world,
    holm,
    independent_size,
    mean,
    mean_interval,
    quantile,
    quantile_interval,
    ratio_interval,
    signed_rank,
    upper_bound,
    wilson,
)
from tests.support.each import each

NUMBERS = st.floats(-1e6, 1e6) | st.sampled_from([nan, inf, -inf, 0.0])


@each(
    ("count", "of", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_agrees_with_newcombe_1998(count: int, of: int, low: float, high: float) -> None:
    assert wilson(count, of) == pytest.approx((low, high), abs=5e-5)


@each(
    ("count", "of", "high"),
    [(81, 263, 0.3676), (15, 148, 0.1617), (0, 20, 0.1684), (1, 29, 0.1776)],
)
def test_exact_bound_agrees_with_newcombe_1998(count: int, of: int, high: float) -> None:
    assert upper_bound(count, of, 0.975) == pytest.approx(high, abs=5e-5)


def test_ratio_interval_agrees_with_the_aspirin_study() -> None:
    """Physicians' Health Study (1989): 189 of 11,034 against 104 of 11,037, 1.82 (1.43 to 2.31)."""
    found = ratio_interval(189, 11_034, 104, 11_037)
    assert found == pytest.approx((1.43, 2.31), abs=5e-3)
    inverse = ratio_interval(104, 11_037, 189, 11_034)
    assert inverse == pytest.approx((1.0 / found.high, 1.0 / found.low))


@each(("first", "second"), [(0, 5), (5, 0), (0, 0)])
def test_ratio_without_events_is_unbounded(first: int, second: int) -> None:
    assert ratio_interval(first, 10, second, 10) == (0.0, inf)


def test_bound_without_events_shrinks_with_the_trials() -> None:
    assert upper_bound(0, 29_956) == pytest.approx(1.0 - OUTSIDE ** (1 / 29_956), rel=1e-9)
    assert (upper_bound(0, 0), upper_bound(3, 3)) == (1.0, 1.0)
    assert Proportion(0, 29_956).most < 1e-4 < Proportion(0, 29_955).most


@given(st.integers(1, 2000), st.data())
def test_bound_is_above_the_share_and_grows(of: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, of - 1))
    assert count / of < upper_bound(count, of) <= upper_bound(count + 1, of)


def test_mean_has_an_interval_from_two_values_on() -> None:
    assert mean([1.0, nan, 3.0]) == 2.0
    assert mean_interval([1.0, 3.0]) == pytest.approx((2.0 - 1.96, 2.0 + 1.96), abs=1e-3)
    assert isnan(mean([]))
    assert mean_interval([1.0]) == (-inf, inf)


def test_share_of_nothing_has_the_full_interval() -> None:
    assert isnan(Proportion(0, 0).rate)
    assert Proportion(0, 0).interval == (0.0, 1.0)


@given(st.integers(1, 5000), st.data())
def test_interval_contains_the_share_and_is_symmetric(of: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, of))
    low, high = Proportion(count, of).interval
    assert 0.0 <= low <= count / of <= high <= 1.0
    assert wilson(of - count, of) == pytest.approx((1.0 - high, 1.0 - low), abs=1e-9)


def test_sign_test_agrees_with_published_values() -> None:
    """Published for McNemar's exact test, which is the sign test on discordant pairs."""
    assert binomial_two_sided(9, 11) == pytest.approx(0.06543, abs=5e-6)
    assert binomial_two_sided(150, 236) == pytest.approx(3.72e-5, rel=0.01)


def clustered(*worlds: tuple[int, int]) -> Proportion:
    """Return the share of successes of worlds, each with successes and trials."""
    chosen = [at < good for good, of in worlds for at in range(of)]
    names = [str(place) for place, (_, of) in enumerate(worlds) for _ in range(of)]
    size = independent_size(np.array(chosen), np.array(names))
    return Proportion(sum(chosen), len(chosen), size)


def test_one_trial_a_world_counts_as_independent() -> None:
    found = clustered(*[(1, 1)] * 7, *[(0, 1)] * 3)
    assert found.independent == pytest.approx(10.0)
    assert found.interval == pytest.approx(Proportion(7, 10).interval)


def test_seeds_that_end_alike_count_once_a_world() -> None:
    found = clustered(*[(10, 10)] * 7, *[(0, 10)] * 3)
    assert found.independent == pytest.approx(10.0, rel=0.12)
    assert found.interval == pytest.approx(Proportion(7, 10).interval, abs=0.02)


def test_failures_spread_over_worlds_widen_nothing() -> None:
    found = clustered(*[(9, 10)] * 20)
    assert found.independent == 200.0


def test_without_a_failure_each_world_counts_once() -> None:
    found = clustered(*[(10, 10)] * 20)
    assert found.interval == Proportion(20, 20).interval
    none = clustered(*[(0, 10)] * 20)
    assert none.most == Proportion(0, 20).most


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(1, 5)), min_size=1, max_size=20))
def test_clusters_never_narrow_an_interval(worlds: list[tuple[int, int]]) -> None:
    found = clustered(*((min(good, of), of) for good, of in worlds))
    low, high = found.interval
    plain_low, plain_high = Proportion(found.count, found.of).interval
    assert low <= plain_low + 1e-12
    assert high >= plain_high - 1e-12
    assert found.most >= Proportion(found.count, found.of).most - 1e-9 or found.of <= 1


def test_values_of_one_world_tell_no_more_than_one() -> None:
    values = np.repeat(np.arange(1.0, 17.0), 5)
    names = np.repeat([f"w{number}" for number in range(16)], 5)
    assert quantile_interval(values, 0.5, names) == (4.0, 13.0)
    assert sorted(by_world(values, names).tolist()) == list(range(1, 17))
    assert quantile_interval(values[:5], 0.5, names[:5]) == (-inf, inf)


def test_sign_test_agrees_with_the_binomial() -> None:
    assert binomial_two_sided(0, 0) == binomial_two_sided(1, 1) == 1.0
    assert binomial_two_sided(5, 10) == 1.0
    assert binomial_two_sided(0, 10) == 2 / 1024
    assert binomial_two_sided(10_000, 10_000) == 0.0
    assert 0.9 < binomial_two_sided(4_999, 10_000) <= 1.0


def test_signed_rank_agrees_with_darwins_maize() -> None:
    # Darwin 1876 (Fisher 1935, chapter 3), in eighths of an inch; exact p as R's wilcox.test.
    maize = [6, 8, 14, 16, 23, 24, 28, 29, 41, -48, 49, 56, 60, -67, 75]
    assert signed_rank(maize) == pytest.approx(0.04126, abs=5e-6)


@given(st.lists(st.integers(-4, 4), min_size=1, max_size=9))
def test_exact_signed_rank_agrees_with_enumeration(values: list[int]) -> None:
    sizes = [abs(value) for value in values if value]
    ranks = [sum(o < s for o in sizes) + (sum(o == s for o in sizes) + 1) / 2 for s in sizes]
    half = sum(ranks) / 2
    seen = abs(np.dot(ranks, [value > 0 for value in values if value]) - half)
    sums = [np.dot(ranks, signs) for signs in product((0, 1), repeat=len(ranks))]
    expected = sum(abs(total - half) >= seen - 1e-9 for total in sums) / len(sums)
    assert signed_rank(values) == pytest.approx(expected)


def test_signed_rank_approaches_the_normal_law() -> None:
    values = [((index * 37) % 101 - 44) / 10 for index in range(intervals.EXACT_RANKS)]
    exact = signed_rank(values)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(intervals, "EXACT_RANKS", 0)
        assert signed_rank(values) == pytest.approx(exact, abs=0.005)
    assert signed_rank([1.0, 2.0, -0.5] * 400) < 1e-9


@given(st.lists(NUMBERS, max_size=60))
def test_signed_rank_is_symmetric(values: list[float]) -> None:
    p = signed_rank(values)
    assert 0.0 < p <= 1.0
    assert signed_rank([-value for value in values]) == p


def test_holm_agrees_with_r() -> None:
    assert holm([0.01, 0.04, 0.03, 0.02]) == pytest.approx([0.04, 0.06, 0.06, 0.06])
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), max_size=30))
def test_holm_never_lowers_a_p_value(p_values: list[float]) -> None:
    adjusted = holm(p_values)
    assert all(p <= q <= 1.0 for p, q in zip(p_values, adjusted, strict=True))
    pairs = sorted(zip(p_values, adjusted, strict=True))
    assert [q for _, q in pairs] == sorted(adjusted)


def test_median_interval_has_the_published_ranks() -> None:
    # Conover, Practical Nonparametric Statistics 3.2: of 16 the 4th and the 13th.
    assert quantile_interval([float(rank) for rank in range(1, 17)], 0.5) == (4.0, 13.0)


def test_few_values_give_unbounded_interval() -> None:
    assert quantile_interval([1.0, 2.0, nan], 0.5) == (-inf, inf)
    assert isnan(quantile([nan, inf], 0.5))
    assert quantile([3.0, nan, 1.0], 0.5) == 2.0


@given(st.lists(NUMBERS, max_size=200), st.floats(0.05, 0.95))
def test_quantile_lies_within_its_interval(values: list[float], at: float) -> None:
    low, high = quantile_interval(values, at)
    middle = quantile(values, at)
    assert isnan(middle) or low <= middle <= high


def test_quantile_interval_has_its_coverage() -> None:
    random = np.random.default_rng(5)
    drawn = random.exponential(size=(2000, 80))
    held = 0
    for sample in drawn:
        low, high = quantile_interval(sample, 0.9)
        held += low <= 2.302585 <= high
    assert 0.94 <= held / len(drawn) <= 0.995


@each("of", [59, 61, 3000])
def test_interval_ranks_agree_for_few_and_many_values(of: int) -> None:
    low, high = quantile_interval(np.arange(1.0, of + 1.0), 0.5)
    half = 0.98 * of**0.5
    assert low == pytest.approx(of / 2 - half, abs=1.5)
    assert high == pytest.approx(of / 2 + half + 1, abs=1.5)
    assert not isinf(low)


def test_ellipse_size_agrees_with_tables() -> None:
    assert pytest.approx(5.9915, abs=5e-5) == CHI2_2
    assert Interval(1.0, 2.0).low == 1.0
