from math import inf

from hypothesis import given
from hypothesis import strategies as st

from robot.core.parameters import DEFAULTS
from robot.core.perception import sonar_ring as rings
from robot.core.perception.sonar_ring import Ring
from robot.core.values import BEARINGS, Scan
from tests.support.robot.core.rings import scan

OPEN = (0,) * 8


def seen(one: Scan, now_ms: int = 0) -> Ring:
    ring = Ring()
    rings.update(ring, one, now_ms, DEFAULTS)
    return ring


def test_before_the_first_scan_everything_is_missing() -> None:
    ring = Ring()
    rings.update(ring, None, 0, DEFAULTS)
    assert ring.range_m == [None] * 8
    assert (ring.fresh, ring.nearest, ring.nearest_m) == (0, -1, inf)
    assert rings.bearing_rad(ring) is None


def test_no_echo_is_infinitely_far_and_not_missing() -> None:
    ring = seen(scan({}))
    assert ring.range_m == [inf] * 8
    assert ring.fresh == 8
    assert rings.bearing_rad(ring) is None


def test_the_nearest_echo_and_its_bearing() -> None:
    ring = seen(scan({1: 900, 6: 400, 3: 1200}))
    assert (ring.nearest, ring.nearest_m) == (6, 0.4)
    assert rings.bearing_rad(ring) == BEARINGS[6]
    assert ring.front_m == 1.2


def test_a_dead_sonar_is_missing_and_the_others_are_not() -> None:
    ring = seen(scan({3: 500}, valid=0xFF & ~(1 << 3)))
    assert ring.range_m[3] is None
    assert ring.fresh == 7
    assert ring.nearest == -1


def test_each_sonar_grows_stale_by_the_age_of_its_own_ping() -> None:
    ring = seen(scan({0: 500, 1: 600}))
    rings.update(ring, None, 125, DEFAULTS)
    assert ring.range_m[:2] == [0.5, 0.6]
    rings.update(ring, None, 130, DEFAULTS)  # group A was pinged 25 ms before the stamp
    assert ring.range_m[:2] == [None, 0.6]
    rings.update(ring, None, 151, DEFAULTS)
    assert ring.fresh == 0


def test_echo_at_zero_or_beyond_the_range_is_impossible() -> None:
    for impossible_mm in (0, 3301, 65535):
        ring = seen(scan({4: impossible_mm}))
        assert ring.impossible
        assert ring.range_m[4] is None
    rings.update(ring, scan({4: 3000}), 50, DEFAULTS)
    assert not ring.impossible
    assert not seen(scan({4: 3200})).impossible  # noise at the far end


@given(st.lists(st.one_of(st.none(), st.integers(1, 3000)), min_size=8, max_size=8))
def test_the_nearest_is_never_farther_than_any_echo(ranges_mm: list[int | None]) -> None:
    echoes = {i: mm for i, mm in enumerate(ranges_mm) if mm is not None}
    ring = seen(scan(echoes))
    assert ring.nearest_m == min(echoes.values(), default=inf) / 1000
    assert ring.nearest_m <= ring.front_m
