"""Numbers in the frozen program are those of the sources, to the last bit."""

from math import nextafter, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware.linker import exact, floats_in, is_literal, nearest
from runtime.errors import LocalError
from tests.support.each import each

LINE = "static const mp_obj_float_t one = {{&mp_type_float}, (mp_float_t)%s};"


def test_rounded_number_is_replaced_by_its_literal() -> None:
    frozen = LINE % "0.09274918249999999" + LINE % "0.5"
    assert exact(frozen, {0.0927491825, 0.5}) == LINE % "0.0927491825" + LINE % "0.5"


@given(st.floats(1e-30, 1e30))
def test_neighbour_is_replaced_by_the_number(value: float) -> None:
    assert nearest(nextafter(value, 1e300), [value]) == value


def test_number_of_no_literal_is_refused() -> None:
    with pytest.raises(LocalError, match=r"0\.25"):
        exact(LINE % "0.25", {0.5})


def test_number_between_two_literals_is_refused() -> None:
    two = [1.0, nextafter(nextafter(1.0, 2.0), 2.0)]
    with pytest.raises(LocalError):
        nearest(nextafter(1.0, 2.0), two)


def test_literals_of_a_program_are_found() -> None:
    assert floats_in(f"a = 0.1 + 3\nb = ({pi!r}, 'x')\n") == {0.1, pi}


@each(
    ("value", "kept"),
    [
        *((value, True) for value in (3, 0.1, pi, (1, -2), "text")),
        *((value, False) for value in (-0.5, 1e300, True, (), (0.5, pi), [1], ("a",), None)),
    ],
)
def test_only_constants_without_an_operation_become_literals(value: object, kept: bool) -> None:
    assert is_literal(value) is kept
