import numpy as np
import pytest

from study.statistics.consistency import KINDS, Array, bounds, judged, speeds_of


@pytest.mark.parametrize(
    ("degrees_of_freedom", "count", "low", "high"),
    [(3, 10, 1.6791, 4.6979), (2, 50, 1.48444, 2.59122), (3, 200, 2.6698, 3.3490)],
)
def test_the_bounds_are_those_of_tables_of_chi_square(
    degrees_of_freedom: int, count: int, low: float, high: float
) -> None:
    assert bounds(degrees_of_freedom, count) == pytest.approx((low, high), rel=0.01)


def drawn(scale: float, count: int = 400) -> list[tuple[Array, Array]]:
    """Errors whose covariance is believed to be so many times what it is."""
    rng = np.random.default_rng(5)
    p = np.array([[4e-4, 1e-4, 2e-4], [1e-4, 9e-4, 3e-4], [2e-4, 3e-4, 4e-4]])
    return [(rng.multivariate_normal(np.zeros(3), p), scale * p) for _ in range(count)]


def test_errors_as_believed_are_consistent() -> None:
    found = judged(drawn(1.0))
    assert found.consistent
    assert found.inside == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("scale", [0.7, 1.5])
def test_one_who_is_too_sure_or_too_unsure_is_found_out(scale: float) -> None:
    assert not judged(drawn(scale)).consistent


@pytest.mark.parametrize("kind", KINDS[:3])
def test_the_scripts_of_the_open_floor_end_with_a_stand_and_stay_within_the_wheels_limits(
    kind: str,
) -> None:
    for seed in range(20):
        speeds = list(speeds_of(kind, np.random.default_rng(seed)))
        assert speeds[-10:] == [(0.0, 0.0)] * 10
        assert max(abs(speed) for pair in speeds for speed in pair) <= 0.30
        assert 50 < len(speeds) < 1200
