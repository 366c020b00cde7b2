"""Elementary functions against mpmath: at most one unit in the last place, everywhere."""

import ast
import re
from collections.abc import Callable, Iterable
from math import copysign, inf, isnan, nan, nextafter, pi, ulp
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from runtime import elementary
from runtime.elementary import (
    MAX_ANGLE_RAD,
    acos,
    asin,
    atan2,
    coarse_acos,
    coarse_atan2,
    cos,
    cos_sin,
    exp,
    hypot,
    sin,
    tanh,
)
from tests.support.each import each

SOURCE = Path(elementary.__file__)
MANY = 3000
PRECISION_BITS = 200


def errors_ulp(
    own: Callable[..., float], exact: Callable[..., mpf], points: Iterable[tuple[float, ...]]
) -> Iterable[tuple[float, tuple[float, ...]]]:
    with mp.workprec(PRECISION_BITS):
        for point in points:
            true = exact(*map(mpf, point))
            yield float(abs(mpf(own(*point)) - true) / ulp(float(true))), point


def spread(low: float, high: float, seed: int = 1) -> list[float]:
    random = Random(seed)
    return [random.uniform(low, high) for _ in range(MANY)]


def magnitudes(least: int, most: int) -> list[float]:
    """Return positive and negative numbers of all sizes between two powers of 2."""
    random = Random(2)
    return [
        random.choice((-1.0, 1.0)) * random.uniform(1.0, 2.0) * 2.0 ** random.randint(least, most)
        for _ in range(MANY)
    ]


def beside(*values: float) -> list[float]:
    """Return values with their neighbours, of both signs."""
    near = [
        one for value in values for one in (nextafter(value, -inf), value, nextafter(value, inf))
    ]
    return near + [-one for one in near]


MULTIPLES = [float(n * mp.pi / 4) for n in range(1273)]
ANGLES = [
    *(*spread(-0.8, 0.8), *spread(-pi, pi), *spread(-10.0, 10.0)),
    *(*spread(-MAX_ANGLE_RAD, MAX_ANGLE_RAD), *magnitudes(-1070, -1)),
    *beside(*[angle for angle in MULTIPLES if angle < MAX_ANGLE_RAD - 1.0]),
    *(MAX_ANGLE_RAD, -MAX_ANGLE_RAD, 5e-324, 1.0 / (1 << 28)),
]
"""Near the multiples of a quarter turn almost all bits cancel."""

UNITS = [
    *(*spread(-1.0, 1.0), *spread(0.499, 0.501), *spread(0.99, 1.0), *magnitudes(-1060, -1)),
    *[1.0 - one for one in map(abs, magnitudes(-53, -2))],
    *(*beside(0.5), -1.0, 1.0, nextafter(1.0, 0.0), 5e-324),
]
POWERS = [
    *(*spread(-1.0, 1.0), *spread(-40.0, 40.0), *spread(-745.0, 709.7), *magnitudes(-1060, 8)),
    *beside(*[float(n * mp.ln(2) / 2) for n in range(1, 2046, 7)], 708.3),
]
ARGUMENTS = [
    *(*spread(-1.0, 1.0), *spread(-25.0, 25.0), *magnitudes(-1060, 5)),
    *beside(0.55, 22.0, 1.0 / (1 << 28)),
]
POINTS = [
    *zip(spread(-5.0, 5.0, 3), spread(-5.0, 5.0, 4), strict=True),
    *zip(magnitudes(-500, 500), reversed(magnitudes(-500, 500)), strict=True),
    *zip(magnitudes(-1070, 1023), reversed(magnitudes(-20, 1023)), strict=True),
    *[(one, 1.0) for k in range(17) for one in beside(k / 16) if one != 0.0],
    *[(float(y), float(x)) for y in range(-12, 13) for x in range(-12, 13) if y and x],
]


@each(
    ("own", "exact", "points"),
    [
        (sin, mp.sin, [(one,) for one in ANGLES]),
        (cos, mp.cos, [(one,) for one in ANGLES]),
        (asin, mp.asin, [(one,) for one in UNITS]),
        (acos, mp.acos, [(one,) for one in UNITS]),
        (exp, mp.exp, [(one,) for one in POWERS]),
        (tanh, mp.tanh, [(one,) for one in ARGUMENTS]),
        (atan2, mp.atan2, POINTS),
    ],
)
def test_error_is_at_most_one_unit_in_the_last_place(
    own: Callable[..., float], exact: Callable[..., mpf], points: list[tuple[float, ...]]
) -> None:
    assert len(points) >= MANY
    worst, where = max(errors_ulp(own, exact, points))
    assert worst <= 1.0, where


@given(st.floats(-MAX_ANGLE_RAD, MAX_ANGLE_RAD))
def test_cosine_and_sine_together_are_those_alone(angle_rad: float) -> None:
    assert cos_sin(angle_rad) == (cos(angle_rad), sin(angle_rad))


@given(st.floats(), st.floats())
def test_functions_are_as_symmetric_as_those_of_mathematics(x: float, y: float) -> None:
    for odd in (sin, asin, tanh):
        assert repr(odd(-x)) == repr(-odd(x)).replace("-nan", "nan")
    assert repr(cos(-x)) == repr(cos(x))
    assert repr(atan2(-y, x)) == repr(-atan2(y, x)).replace("-nan", "nan")


@given(st.floats(-1.0, 1.0))
def test_arcs_stay_within_their_ranges(value: float) -> None:
    assert -pi / 2 <= asin(value) <= pi / 2
    assert 0.0 <= acos(value) <= pi


@each("angle_rad", [inf, -inf, nan, nextafter(MAX_ANGLE_RAD, inf), -1e300])
def test_angles_beyond_the_domain_give_nan(angle_rad: float) -> None:
    assert isnan(sin(angle_rad))
    assert isnan(cos(angle_rad))
    assert all(isnan(one) for one in cos_sin(angle_rad))


@each("value", [nan, inf, -inf, nextafter(1.0, 2.0), -2.0])
def test_arcs_beyond_their_domain_give_nan(value: float) -> None:
    assert isnan(asin(value))
    assert isnan(acos(value))


def test_zero_keeps_its_sign() -> None:
    for function in (sin, asin, tanh):
        assert [copysign(1.0, function(zero)) for zero in (0.0, -0.0)] == [1.0, -1.0]
    assert [cos(zero) for zero in (0.0, -0.0)] == [1.0, 1.0]
    assert cos_sin(0.0) == (1.0, 0.0)


def test_exp_and_tanh_at_their_ends() -> None:
    assert [exp(one) for one in (inf, 710.0, -746.0, -inf, 0.0)] == [inf, inf, 0.0, 0.0, 1.0]
    assert [tanh(one) for one in (inf, 40.0, -40.0, -inf)] == [1.0, 1.0, -1.0, -1.0]
    assert isnan(exp(nan))
    assert isnan(tanh(nan))


HALF, WHOLE, EIGHTH = pi / 2, pi, pi / 4


@each(
    ("y", "x", "angle_rad"),
    [
        (0.0, 0.0, 0.0),
        (-0.0, 0.0, -0.0),
        (0.0, -0.0, WHOLE),
        (-0.0, -0.0, -WHOLE),
        (0.0, 1.0, 0.0),
        (-0.0, -1.0, -WHOLE),
        (1.0, 0.0, HALF),
        (-1.0, -0.0, -HALF),
        (1.0, inf, 0.0),
        (-1.0, -inf, -WHOLE),
        (inf, 1.0, HALF),
        (inf, inf, EIGHTH),
        (-inf, -inf, -3.0 * EIGHTH),
        (1e308, 1e308, EIGHTH),
        (5e-324, 5e-324, EIGHTH),
        (5e-324, 1e308, 0.0),
    ],
)
def test_atan2_of_zeros_infinities_and_extremes(y: float, x: float, angle_rad: float) -> None:
    assert atan2(y, x).hex() == angle_rad.hex()


@each(("y", "x"), [(nan, 1.0), (1.0, nan), (nan, inf), (inf, nan)])
def test_atan2_of_nan_is_nan(y: float, x: float) -> None:
    assert isnan(atan2(y, x))


@given(st.floats(-1e150, 1e150), st.floats(-1e150, 1e150))
def test_hypot_is_the_length_of_a_vector(x: float, y: float) -> None:
    assert hypot(x, y) == pytest.approx(float(mp.hypot(x, y)), rel=1e-15, abs=1e-160)


def test_coarse_angles_are_near_the_exact_ones() -> None:
    for y, x in POINTS:
        assert coarse_atan2(y, x) == pytest.approx(float(mp.atan2(y, x)), abs=3e-5)
    assert [coarse_atan2(0.0, x) for x in (1.0, 0.0, -1.0)] == [0.0, 0.0, pi]
    assert [coarse_atan2(y, 0.0) for y in (1.0, -1.0)] == pytest.approx([pi / 2, -pi / 2])
    for k in range(1001):
        assert coarse_acos(k / 1000) == pytest.approx(float(mp.acos(k / 1000)), abs=5e-5)


def test_only_portable_operations_are_used() -> None:
    """Only sums, products, quotients, square roots and integers; no name MicroPython lacks."""
    tree = ast.parse(SOURCE.read_text())
    names = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "math"
        for alias in node.names
    }
    assert names == {"copysign", "inf", "nan", "pi", "sqrt"}
    operators = {type(node.op) for node in ast.walk(tree) if isinstance(node, ast.BinOp)}
    assert operators == {ast.Add, ast.Sub, ast.Mult, ast.Div, ast.LShift, ast.BitAnd}
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.Starred)]


def test_every_literal_is_exact_for_a_simple_parser() -> None:
    """A parser that multiplies or divides whole numbers below 2^53 by 10^22 or less is exact."""
    literals = re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?", SOURCE.read_text())
    for literal in literals:
        mantissa, _, power = literal.partition("e")
        whole, _, fraction = mantissa.partition(".")
        assert int(whole + fraction) < 2**53, literal
        assert -22 <= int(power or 0) - len(fraction) <= 26, literal
    assert len(literals) > 50
