from robot.core.parameters import DEFAULTS
from robot.core.perception import sonar_ring
from robot.core.perception.sonar_ring import FrozenSonar
from robot.core.values import Scan
from tests.support.robot.core.rings import scan


def drive(
    sonars: FrozenSonar, one: Scan, ticks: int, moved_m: float = 0.015, turned: float = 0.0
) -> None:
    for _ in range(ticks):
        sonar_ring.watch(sonars, one, moved_m, turned, DEFAULTS)


def test_echoes_that_ignore_a_turn_are_frozen() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({2: 1500, 6: 800}), ticks=12, turned=0.02)
    assert sonars.verdict
    drive(sonars, scan({2: 1501, 6: 800}), ticks=1)
    assert not sonars.verdict


def test_an_echo_close_ahead_that_does_not_come_closer_is_frozen() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({3: 350}), ticks=6)
    assert not sonars.verdict
    drive(sonars, scan({3: 350}), ticks=3)
    assert sonars.verdict


def test_a_straight_corridor_without_noise_is_not_frozen() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({0: 280, 7: 280, 1: 313, 6: 320, 2: 446, 5: 470}), ticks=200)
    assert not sonars.verdict


def test_standing_still_and_empty_space_are_not_frozen() -> None:
    standing, empty = FrozenSonar(), FrozenSonar()
    drive(standing, scan({3: 200}), ticks=200, moved_m=0.0)
    drive(empty, scan({}), ticks=200, turned=0.1)
    assert not standing.verdict
    assert not empty.verdict


def test_noisy_sonars_that_fall_silent_in_a_corridor_are_frozen() -> None:
    sonars = FrozenSonar()
    for k in range(8):
        drive(sonars, scan({0: 280 + k % 3, 7: 280}), ticks=1, moved_m=0.0)
    drive(sonars, scan({0: 280, 7: 280}), ticks=9)
    assert sonars.verdict


def test_circling_a_disc_is_not_frozen_turning_beside_it_is() -> None:
    circling, turning = FrozenSonar(), FrozenSonar()
    drive(circling, scan({0: 150, 1: 210, 2: 390}), ticks=200, turned=-0.02)
    drive(turning, scan({0: 150, 1: 210, 2: 390}), ticks=40, moved_m=0.004, turned=-0.04)
    assert not circling.verdict
    assert turning.verdict


def test_an_echo_ahead_that_stops_coming_closer_is_frozen() -> None:
    sonars = FrozenSonar()
    for k in range(5):
        drive(sonars, scan({0: 1880, 3: 900 - 15 * k, 7: 1880}), ticks=1)
    drive(sonars, scan({0: 1880, 3: 840, 7: 1880}), ticks=5)
    assert not sonars.verdict
    drive(sonars, scan({0: 1880, 3: 840, 7: 1880}), ticks=3)
    assert sonars.verdict


def test_echo_ahead_that_never_closed_may_be_a_wall() -> None:
    sonars = FrozenSonar()
    drive(sonars, scan({0: 1880, 3: 2017, 4: 2017, 7: 1880}), ticks=40)
    assert not sonars.verdict


def test_alternating_echoes_that_then_stay_are_frozen() -> None:
    noisy, smooth = FrozenSonar(), FrozenSonar()
    for k in range(8):
        drive(noisy, scan({0: 900 + 8 * (k % 2)}), ticks=1)
        drive(smooth, scan({0: 900 + 8 * k}), ticks=1)
    drive(noisy, scan({0: 900}), ticks=8)
    drive(smooth, scan({0: 900}), ticks=8)
    assert noisy.verdict
    assert not smooth.verdict


def test_a_missing_scan_is_not_judged() -> None:
    sonars = FrozenSonar()
    sonar_ring.watch(sonars, None, 1.0, 1.0, DEFAULTS)
    assert not sonars.verdict


def test_on_a_bend_only_a_close_echo_ahead_must_change() -> None:
    close, far = FrozenSonar(), FrozenSonar()
    drive(close, scan({2: 300, 3: 350}), ticks=8, turned=0.012)
    drive(far, scan({2: 300}), ticks=8, turned=0.012)
    assert close.verdict
    assert not far.verdict


def swinging(turned_rad: float) -> FrozenSonar:
    """Drive on while an echo alternates by 12 mm, and then no longer does."""
    sonars = FrozenSonar()
    for k in range(12):
        drive(sonars, scan({0: 280, 2: 500 + 12 * (k % 2), 7: 280}), ticks=1, turned=turned_rad)
    drive(sonars, scan({0: 280, 2: 500, 7: 280}), ticks=9)
    return sonars


def test_echoes_of_a_wavering_robot_are_not_noise() -> None:
    assert swinging(0.0).verdict
    assert not swinging(0.01).verdict
