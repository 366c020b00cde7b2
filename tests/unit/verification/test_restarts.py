"""Only the time after the start of its process is limited for a router."""

import pytest

from checks.faults.restarts import Recovery, held_after_cut, of
from robot.emergency_stop import KeptStop
from tests.support.each import each

TOOK = [Recovery(0.5, 0.7), Recovery(0.6, 2.0)]


def test_without_limit_only_the_total_is_reported() -> None:
    (figure,) = of("plant", TOOK, None)
    assert (figure.values, figure.met) == ((0.7, 2.0), None)


def test_limited_time_begins_when_the_hub_listens() -> None:
    whole, healing = of("router", TOOK, 1.0)
    assert whole.met is None
    assert healing.values == pytest.approx((0.2, 1.4))
    assert healing.met is True


@each("number", range(3))
def test_stop_outlives_a_power_cut(number: int) -> None:
    assert held_after_cut(number)


def test_stop_that_is_not_saved_is_lost_in_a_power_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(KeptStop, "keep", lambda *_, **__: None)
    assert not held_after_cut(0)
