"""Directions name their side; a value that is not finite has none."""

from math import inf, isfinite, nan, pi, radians

from hypothesis import given
from hypothesis import strategies as st

from ground.text.wording import NONE, SONARS, echo, heading_deg, metres, place, side, sonar
from robot.core.values import BEARINGS
from tests.support.each import each


@each(
    ("angle_deg", "words"),
    [
        (0.0, "straight ahead"),
        (0.4, "straight ahead"),
        (34.2, "34° left"),
        (-34.2, "34° right"),
        (120.0, "120° left, behind"),
        (-120.0, "120° right, behind"),
        (180.0, "straight behind"),
        (-179.8, "straight behind"),
        (350.0, "10° right"),
        (-725.0, "5° right"),
        (nan, NONE),
        (inf, NONE),
    ],
)
def test_a_direction_has_a_side_and_whole_degrees(angle_deg: float, words: str) -> None:
    assert side(radians(angle_deg)) == words


@given(st.floats())
def test_any_number_is_a_direction_or_none(angle_rad: float) -> None:
    angle_deg = heading_deg(angle_rad)
    assert (angle_deg is None) == (not isfinite(angle_rad))
    assert angle_deg is None or -180.0 <= angle_deg <= 180.0
    assert side(angle_rad)


def test_each_sonar_is_called_by_where_it_looks() -> None:
    assert [sonar(bearing_rad) for bearing_rad in BEARINGS] == list(SONARS)
    for name, bearing_rad in zip(SONARS, BEARINGS, strict=True):
        assert side(bearing_rad).startswith(f"{name[1:]}°")
        assert (name[0] == "L") == (bearing_rad > 0.0)


@each("bearing_rad", [0.0, 0.1, pi / 2, -pi, 1e300, nan, inf])
def test_where_no_sonar_looks_there_is_no_name(bearing_rad: float) -> None:
    assert sonar(bearing_rad) == ""


@given(st.floats(), st.floats())
def test_places_and_distances_are_short_whatever_they_are(x_m: float, y_m: float) -> None:
    assert len(metres(x_m)) < 20
    assert len(place(x_m, y_m)) < 40
    assert echo(x_m, y_m)


def test_echo_is_described_by_its_known_values() -> None:
    assert echo(0.213, BEARINGS[5]) == "echo 0.21 m 34° left (L34)"
    assert echo(0.213, 0.5) == "echo 0.21 m 29° left"
    assert echo(0.213, nan) == "echo 0.21 m"
    assert echo(inf, nan) == "no echo"
    assert echo(nan, nan) == NONE
    assert echo(nan, 0.5) == "echo -- 29° left"
