"""Measures of motion: stop time, path and contacts, from true states every 50 ms."""

import pytest

from checks.harness import motion
from checks.harness.motion import HOLDS, Seen
from protocol.wire.messages import GroundTruth


def seen(*speeds_m_s: float, touching: tuple[int, ...] = ()) -> list[Seen]:
    """Return one state per period; each speed is that of the period before it."""
    x_m, found = 0.0, []
    for number, speed_m_s in enumerate(speeds_m_s):
        x_m += speed_m_s * 0.05 if number else 0.0
        truth = GroundTruth(
            time_ns=number * 50_000_000,
            seq=number,
            x_m=x_m,
            y_m=0.0,
            heading_rad=0.0,
            speed_m_s=speed_m_s,
            yaw_rate_rad_s=0.0,
            clearance_m=1.0,
            contact=int(number in touching),
        )
        found.append(Seen(number * 0.05, truth))
    return found


AT_REST = (0.0,) * HOLDS


def test_robot_stops_at_begin_of_first_period_without_motion() -> None:
    assert motion.stood_s(seen(0.3, 0.3, 0.1, *AT_REST)) == pytest.approx(0.10)
    assert motion.stood_s(seen(0.3, *AT_REST)) == 0.0


def test_short_rest_is_no_stop() -> None:
    short = seen(0.3, *AT_REST[:-1], 0.1)
    assert motion.stood_s(short) is None
    assert motion.stood_s(seen(0.3, 0.0, 0.1, *AT_REST)) == pytest.approx(0.10)


def test_path_ends_where_the_robot_stops() -> None:
    assert motion.distance_m(seen(0.3, 0.3, 0.1, *AT_REST, 0.3)) == pytest.approx(0.02)
    assert motion.distance_m(seen(0.3, 0.3, 0.3)) == pytest.approx(0.03)


def test_motion_after_a_stop_is_detected() -> None:
    assert motion.moved_again(seen(0.3, *AT_REST, 0.1))
    assert not motion.moved_again(seen(0.3, *AT_REST, 0.0))
    assert not motion.moved_again(seen(0.3, 0.3))


def test_lasting_contact_counts_once() -> None:
    assert motion.contacts(seen(0.3, 0.3, 0.3, 0.3, touching=(1, 2))) == 1
    assert motion.contacts(seen(0.3, 0.3, 0.3, 0.3, touching=(0, 2))) == 2


def test_time_from_contact_to_stop() -> None:
    touched = seen(0.3, 0.3, 0.2, *AT_REST, touching=(1,))
    assert motion.touched_s(touched) == pytest.approx(0.05)
    assert motion.touched_s(seen(0.3, *AT_REST)) is None
    assert motion.touched_s(seen(0.3, 0.3, 0.3, touching=(1,))) is None
