from math import cos, hypot, isfinite, nan, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.core import closing as closings
from robot.core import ring as rings
from robot.core.closing import Closing
from robot.core.geometry import BEARINGS
from robot.core.parameters import DEFAULTS
from robot.core.ring import Ring
from robot.core.values import Scan

PERIOD_S = DEFAULTS.period_s
scans = st.lists(
    st.tuples(
        st.lists(st.integers(0, 3300), min_size=8, max_size=8), st.integers(0, 255), st.floats()
    ),
    max_size=30,
)


class Onlooker:
    """A ring of sonars and its follower, fed scan by scan."""

    def __init__(self) -> None:
        self.ring, self.closing, self.now_ms = Ring(), Closing(), 0

    def see(self, ranges_m: dict[int, float], speed_m_s: float = 0.0) -> list[float]:
        mm = tuple(round(1000 * ranges_m.get(i, 0.0)) for i in range(8))
        echo = sum(1 << i for i in ranges_m)
        rings.update(self.ring, Scan(mm, (0,) * 8, 0xFF, echo), self.now_ms, DEFAULTS)
        closings.watch(self.closing, self.ring, speed_m_s, DEFAULTS)
        self.now_ms += 50
        return self.ring.walks_m_s

    def nearing(self, i: int, rate_m_s: float, speed_m_s: float, scans: int = 20) -> list[float]:
        """An echo that is 0.5 m away at the last scan."""
        walks: list[float] = []
        for scan in range(scans):
            left_s = (scans - 1 - scan) * PERIOD_S
            walks = self.see({i: 0.5 + rate_m_s * left_s}, speed_m_s)
        return walks


@pytest.mark.parametrize("i", range(8))
def test_what_stands_still_does_not_walk_however_fast_the_robot_drives_at_it(i: int) -> None:
    for aside_rad in (-pi / 17, 0.0, pi / 17):
        rate_m_s = 0.3 * cos(BEARINGS[i] + aside_rad)
        assert max(Onlooker().nearing(i, rate_m_s, 0.3)) == 0.0


@pytest.mark.parametrize("i", range(8))
@pytest.mark.parametrize("speed_m_s", [0.0, 0.2])
def test_what_comes_by_itself_is_known_by_its_speed(i: int, speed_m_s: float) -> None:
    walks = Onlooker().nearing(i, 0.15 + speed_m_s * cos(BEARINGS[i]), speed_m_s)
    assert 0.1 < walks[i] < 0.2
    assert sum(map(bool, walks)) == 1


def test_what_goes_away_does_not_walk_at_the_robot() -> None:
    assert max(Onlooker().nearing(3, -0.2, 0.0)) == 0.0


def test_braking_makes_nothing_walk() -> None:
    onlooker, range_m = Onlooker(), 0.75
    for tick in range(30):
        speed_m_s = max(0.0, 0.3 - 0.075 * max(0, tick - 20))
        range_m -= speed_m_s * PERIOD_S
        assert max(onlooker.see({3: range_m}, speed_m_s)) == 0.0


def test_turning_on_the_spot_carries_an_echo_from_cone_to_cone_and_makes_nothing_walk() -> None:
    onlooker = Onlooker()
    for tick in range(40):
        bearing_rad = -1.2 + 0.06 * tick
        i = min(range(8), key=lambda k: abs(BEARINGS[k] - bearing_rad))
        assert max(onlooker.see({i: 0.4})) == 0.0


def test_a_walker_is_followed_from_cone_to_cone_and_through_a_lost_echo() -> None:
    onlooker, walks = Onlooker(), [0.0] * 8
    for tick in range(30):
        x_m, y_m = 0.55, 0.75 - 0.01 * tick  # 0.2 m/s across the way
        bearing_rad = (y_m / x_m) * 0.8
        i = min(range(8), key=lambda k: abs(BEARINGS[k] - bearing_rad))
        lost = tick == 25
        walks = onlooker.see({} if lost else {i: hypot(x_m, y_m) - 0.32})
        assert lost or tick < 25 or max(walks) > 0.0
    assert max(walks) > 0.05


def test_another_echo_is_not_the_last_one_come_nearer() -> None:
    onlooker = Onlooker()
    for _ in range(20):
        onlooker.see({3: 0.7})
    assert max(onlooker.see({3: 0.4})) == 0.0
    assert max(onlooker.see({3: 0.4})) == 0.0


def test_noise_of_the_usual_size_walks_nowhere() -> None:
    onlooker = Onlooker()
    swing = [3, -8, 5, 0, -4, 7, -2, 6, -7, 1, 4, -5]
    for tick in range(240):
        range_m = 0.5 + 0.001 * swing[(tick * 7) % 12]
        assert max(onlooker.see({3: range_m, 4: 0.6})) == 0.0


def test_far_away_nothing_is_followed() -> None:
    onlooker = Onlooker()
    for tick in range(20):
        walks = onlooker.see({3: 2.0 - 0.03 * tick})
    assert max(walks) == 0.0
    assert not any(onlooker.closing.seen)


@given(scans)
def test_it_is_total_and_what_walks_is_a_finite_speed(
    given_scans: list[tuple[list[int], int, float]],
) -> None:
    ring, closing = Ring(), Closing()
    for tick, (ranges, bits, speed_m_s) in enumerate(given_scans):
        rings.update(ring, Scan(tuple(ranges), (0,) * 8, bits, 0xFF), tick * 50, DEFAULTS)
        closings.watch(closing, ring, speed_m_s, DEFAULTS)
        for walks_m_s, range_m in zip(ring.walks_m_s, ring.range_m, strict=True):
            assert walks_m_s >= 0.0
            assert walks_m_s == 0.0 or (range_m is not None and isfinite(walks_m_s + range_m))


def test_a_speed_that_is_no_number_is_forgotten() -> None:
    onlooker = Onlooker()
    onlooker.see({3: 0.5}, nan)
    assert onlooker.nearing(3, 0.15, 0.0)[3] > 0.1


def test_who_walked_up_to_the_flank_is_there_though_no_longer_measured() -> None:
    onlooker = Onlooker()
    for tick in range(20):
        onlooker.see({6: 0.21 - 0.01 * tick})
    assert closings.is_flanked(onlooker.ring)
    assert closings.limit_m_s(onlooker.ring, 0.3) == 0.0
    held = [max(onlooker.see({7: 0.02})) > 0.0 for _ in range(60)]
    assert all(held[:15])
    assert not any(held[40:])


def test_who_steps_back_from_the_flank_is_let_go() -> None:
    onlooker = Onlooker()
    for tick in range(20):
        onlooker.see({6: 0.21 - 0.01 * tick})
    for tick in range(10):
        onlooker.see({6: 0.02 + 0.01 * tick})
    assert not closings.is_flanked(onlooker.ring)


def test_a_wall_beside_the_robot_was_never_a_walker() -> None:
    onlooker = Onlooker()
    for _ in range(40):
        assert max(onlooker.see({0: 0.02, 1: 0.03}, 0.2)) == 0.0
    assert not closings.is_flanked(onlooker.ring)


def test_the_limit_lets_a_walker_pass_and_takes_only_speed_away() -> None:
    onlooker = Onlooker()
    onlooker.see({3: 0.5, 0: 0.3})
    assert closings.limit_m_s(onlooker.ring, 0.3) == 0.3
    onlooker.ring.walks_m_s[0] = 0.2  # at 0.3 m
    assert closings.limit_m_s(onlooker.ring, 0.3) == 0.3  # beside, not ahead
    onlooker.ring.walks_m_s[3] = 0.05
    slowed_m_s = closings.limit_m_s(onlooker.ring, 0.3)
    assert 0.0 < slowed_m_s < 0.1
    assert closings.limit_m_s(onlooker.ring, 0.01) == 0.01
    onlooker.ring.walks_m_s[3] = 0.2
    assert closings.limit_m_s(onlooker.ring, 0.3) == 0.0
    onlooker.ring.range_m[3] = None
    assert closings.limit_m_s(onlooker.ring, 0.3) == 0.3
