"""A router is held to what comes after its own process is there; a start takes what it takes."""

import pytest

from verification.restarts import Recovery, of

TOOK = [Recovery(0.5, 0.7), Recovery(0.6, 2.0)]


def test_without_a_limit_only_the_whole_is_told() -> None:
    (figure,) = of("plant", TOOK, None)
    assert (figure.values, figure.met) == ((0.7, 2.0), None)


def test_what_is_judged_begins_when_it_listens() -> None:
    whole, healing = of("router", TOOK, 1.0)
    assert whole.met is None
    assert healing.values == pytest.approx((0.2, 1.4))
    assert healing.met is True
