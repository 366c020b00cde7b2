import numpy as np
import pytest

from checks.speed.accuracy import KINDS, Array, bounds, consistency_of, speeds_of
from tests.support.each import each


@each(
    ("degrees_of_freedom", "count", "low", "high"),
    [(3, 10, 1.6791, 4.6979), (2, 50, 1.48444, 2.59122), (3, 200, 2.6698, 3.3490)],
)
def test_bounds_agree_with_chi_square_tables(
    degrees_of_freedom: int, count: int, low: float, high: float
) -> None:
    assert bounds(degrees_of_freedom, count) == pytest.approx((low, high), rel=0.01)


def drawn(scale: float, count: int = 400) -> list[tuple[Array, Array]]:
    """Return errors whose stated covariance is `scale` times the true one."""
    rng = np.random.default_rng(5)
    p = np.array([[4e-4, 1e-4, 2e-4], [1e-4, 9e-4, 3e-4], [2e-4, 3e-4, 4e-4]])
    return [(rng.multivariate_normal(np.zeros(3), p), scale * p) for _ in range(count)]


def test_errors_of_the_stated_covariance_are_consistent() -> None:
    found = consistency_of(drawn(1.0))
    assert found.consistent
    assert found.inside == pytest.approx(0.95, abs=0.03)


@each("scale", [0.7, 1.5])
def test_wrong_covariance_is_inconsistent(scale: float) -> None:
    assert not consistency_of(drawn(scale)).consistent


@each("kind", KINDS[:3])
def test_speed_scripts_end_at_rest_within_wheel_limits(
    kind: str,
) -> None:
    for seed in range(20):
        speeds = list(speeds_of(kind, np.random.default_rng(seed)))
        assert speeds[-10:] == [(0.0, 0.0)] * 10
        assert max(abs(speed) for pair in speeds for speed in pair) <= 0.30
        assert 50 < len(speeds) < 1200
