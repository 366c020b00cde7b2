"""The doubt about a position is the longer half axis of its confidence ellipse."""

from math import inf, log, nan, sqrt

import pytest

from protocol.outcome import CHI2_2, OUTSIDE, doubt_m, doubt_words
from study.intervals import CHI2_2 as OF_THE_STUDY
from tests.support.each import each


def test_constant_is_the_quantile_of_the_study() -> None:
    assert pytest.approx(-2.0 * log(OUTSIDE), rel=1e-12) == CHI2_2
    assert CHI2_2 == OF_THE_STUDY


@each("axes", [(0.04, 0.01), (0.01, 0.04)])
def test_doubt_is_the_longer_axis(axes: tuple[float, float]) -> None:
    assert doubt_m(axes[0], 0.0, axes[1]) == pytest.approx(0.2 * sqrt(CHI2_2))


def test_correlation_makes_the_ellipse_longer() -> None:
    assert doubt_m(0.01, 0.01, 0.01) == pytest.approx(sqrt(0.02 * CHI2_2))


@each("value", [nan, inf, -1.0])
def test_no_covariance_gives_no_doubt(value: float) -> None:
    assert doubt_m(value, 0.0, value) is None


def test_words_show_centimetres_or_unknown() -> None:
    assert doubt_words(0.4249) == "position doubt 0.42 m"
    assert doubt_words(None) == "position doubt unknown"
