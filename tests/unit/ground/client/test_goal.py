"""A typed goal becomes integers of the wire, or is refused with the number that is wrong."""

import argparse
from math import dist, inf, nan, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.client.goal import destination, from_robot, goal_request
from ground.client.operations.goals import Goto
from ground.grammar.driving import GotoWords
from ground.grammar.words import positive, seconds
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import Mode
from runtime.errors import UserError
from tests.support.each import each


def typed(*words: str) -> Goto:
    parser = argparse.ArgumentParser(exit_on_error=False)
    GotoWords.declare(parser)
    return parser.parse_args(list(words), GotoWords("goto")).operation()


def test_metres_and_degrees_become_millimetres_and_microradians() -> None:
    near = typed("2", "1", "--position-tolerance", "0.1").goal
    assert near == destination([2.0, 1.0], position_tolerance_m=0.1)
    where = typed("2", "-1.5", "90", "--tolerance", "0.1").goal
    assert where is not None
    request = goal_request(where.on_the_wire(), 7, Mode.GUIDED)
    assert (request.x_mm, request.y_mm) == (2000, -1500)
    assert request.heading_urad == round(pi / 2 * 1e6)
    assert (request.heading_free, request.position_tolerance_mm) == (0, 100)
    assert (request.request_id, request.mode) == (7, Mode.GUIDED)


def test_without_a_heading_any_will_do() -> None:
    assert goal_request(destination([1.0, 2.0]).on_the_wire(), 1, Mode.AUTO).heading_free == 1


@each(
    ("words", "named"),
    [
        (("3e6", "0"), "x"),
        (("0", "-3000000"), "y"),
        (("0", "0", "361"), "heading"),
        (("0", "0", "--tolerance", "2"), "tolerance"),
        (("0", "0", "--heading-tolerance", "181"), "heading tolerance"),
    ],
)
def test_what_no_robot_can_take_is_named(words: tuple[str, ...], named: str) -> None:
    with pytest.raises(UserError, match=rf"^{named} .* out of range"):
        typed(*words)


@each("text", ["0", "-1", "nan", "1e9"])
def test_a_time_is_positive_and_bounded(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        seconds(text)
    if text == "1e9":
        assert positive(text) == 1e9


numbers = st.floats() | st.sampled_from([nan, inf, -inf])


@given(st.lists(numbers, max_size=4), numbers, numbers)
def test_a_goal_fits_the_wire_or_is_refused(
    values: list[float], tolerance_m: float, tolerance_deg: float
) -> None:
    try:
        where = destination(
            values, position_tolerance_m=tolerance_m, heading_tolerance_deg=tolerance_deg
        )
    except UserError:
        return
    request = goal_request(where.on_the_wire(), 1, Mode.AUTO)
    assert decode(Encoder(1, 1).encode(request)).message == request


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1), st.floats(-50, 50))
def test_body_frame_goal_keeps_its_distance_in_the_world(
    x_m: float, y_m: float, heading_rad: float, ahead_m: float
) -> None:
    there = from_robot(destination([ahead_m, 0.0]), x_m, y_m, heading_rad)
    assert dist((there.x_m, there.y_m), (x_m, y_m)) == pytest.approx(abs(ahead_m), abs=1e-9)
    assert there.heading_rad is None


def test_left_of_a_robot_that_looks_up_is_west() -> None:
    there = from_robot(destination([0.0, 1.0, 90.0]), 3.0, 4.0, pi / 2)
    assert (there.x_m, there.y_m) == pytest.approx((2.0, 4.0))
    assert there.heading_rad is not None
    assert abs(there.heading_rad) == pytest.approx(pi)
