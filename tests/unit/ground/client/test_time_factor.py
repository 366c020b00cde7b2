"""The factor of simulated time comes from the plant's stamps alone."""

from collections.abc import Callable
from math import inf

import pytest

from ground.client.time_factor import TimeFactor, chosen_speed
from tests.support.each import each

MS = 1_000_000
SECOND = 1_000 * MS


def after(
    seconds: float, stamp_ns: Callable[[int], int], *, speed: float | None = 1.0
) -> tuple[str, str]:
    """Return words and hint after a time in which a stamp came every 50 ms."""
    factor, now_ns = TimeFactor(speed), 0
    while now_ns <= seconds * SECOND:
        factor.take(stamp_ns(now_ns), now_ns)
        now_ns += 50 * MS
    return factor.words(now_ns), factor.hint(now_ns)


@each(
    ("pace", "speed", "words", "hint"),
    [
        (1.0, 1.0, "SIM 1.0x", ""),
        (0.95, 1.0, "SIM 0.9x", ""),
        (0.8, 1.0, "SIM 0.8x", "computer busy"),
        (4.0, 5.0, "SIM 4.0x", "computer busy"),
        (4.0, inf, "SIM 4.0x", ""),
        (0.3, None, "SIM 0.3x", ""),
        (0.0, 1.0, "SIM 0.0x", "stands still"),
    ],
)
def test_slow_simulation_is_told_from_the_chosen_speed(
    pace: float, speed: float | None, words: str, hint: str
) -> None:
    assert after(6.0, lambda now_ns: round(now_ns * pace), speed=speed) == (words, hint)


@each(("factor", "pace"), [(0.5, 0.5), (0.01, 0.2), (3.0, 1.0)])
def test_ages_follow_a_slow_simulation_within_limits(factor: float, pace: float) -> None:
    measured, stamp_ns = TimeFactor(), 0
    assert measured.pace(0) == 1.0
    for number in range(100):
        stamp_ns = round(number * 50 * MS * factor)
        measured.take(stamp_ns, number * 50 * MS)
    assert measured.pace(100 * 50 * MS) == pytest.approx(pace)


def test_two_seconds_are_needed() -> None:
    assert after(1.9, lambda _: 0) == ("SIM", "")


def test_restarted_plant_begins_a_new_window() -> None:
    factor, shown = TimeFactor(1.0), set()
    for now_ns in range(0, 8 * SECOND, 50 * MS):
        before = now_ns < 5 * SECOND
        factor.take(now_ns + 30 * SECOND if before else now_ns - 5 * SECOND, now_ns)
        shown.add((factor.words(now_ns), factor.hint(now_ns)))
    assert shown == {("SIM", ""), ("SIM 1.0x", "")}


def test_factor_without_news_of_the_plant_is_unknown() -> None:
    factor = TimeFactor(1.0)
    for number in range(100):
        factor.take(number * 10 * MS, number * 50 * MS)
    assert factor.hint(5 * SECOND) == "computer busy"
    assert (factor.words(10 * SECOND), factor.hint(10 * SECOND)) == ("SIM", "")
    factor.take(100 * SECOND, 20 * SECOND)
    assert factor.words(20 * SECOND) == "SIM"


def test_speed_of_the_command_line_is_a_number() -> None:
    assert (chosen_speed("max"), chosen_speed("0.5")) == (inf, 0.5)
