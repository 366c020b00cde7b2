"""Exact Poisson intervals."""

from math import isclose

from study.people.comparison import Rate, poisson_interval
from tests.support.each import each


@each(
    ("count", "low", "high"),
    [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (3, 0.6187, 8.7673), (10, 4.7954, 18.3904)],
)
def test_poisson_interval_equals_published_values(count: int, low: float, high: float) -> None:
    found = poisson_interval(count)
    assert isclose(found.low, low, abs_tol=1e-4)
    assert isclose(found.high, high, abs_tol=1e-4)


def test_rate_divides_events_and_interval_by_hours() -> None:
    rate = Rate(3, 2.0)
    assert rate.per_hour == 1.5
    assert isclose(rate.interval.high, poisson_interval(3).high / 2.0)


def test_rate_without_time_is_unknown() -> None:
    assert Rate(0, 0.0).interval == (0.0, float("inf"))
