"""Elementary functions that return the same bits on every machine.

The C library's `sin`, `exp` and others differ between libraries, versions and processors in the
last bit. These use only + - * /, square roots and integers, which IEEE 754 defines to the bit. They
run in MicroPython, too; in single precision with the accuracy of that format.

Error: at most 1 unit in the last place. Arguments outside a domain, and NaN, give NaN, no error.
Every literal has at most 16 digits, which every parser of floats converts exactly: a longer one is
written as the quotient of two. Sums in two parts (`head`, `tail`) keep what rounding loses.
"""

from math import copysign, inf, nan, pi, sqrt
from typing import Final

MAX_ANGLE_RAD: Final = 1000.0
"""Largest argument of sine and cosine, in either direction."""

QUARTER: Final = 0.7853981633974483
PI: Final = pi
PI_TAIL: Final = 1.224646799147353 / 1e16
HALF_PI: Final = 0.5 * pi
HALF_PI_TAIL: Final = 6.123233995736766 / 1e17

PER_HALF_PI: Final = 0.6366197723675813
HALF_PI_1: Final = 3454217652357 / 2199023255552
HALF_PI_1_TAIL: Final = 2.896073971621982 / 1e13
HALF_PI_2: Final = 2800910879846 / 2199023255552 / 4398046511104
HALF_PI_2_TAIL: Final = 1.644625693632426 / 1e26
"""Half pi to 42 bits and the rest; the rest to 42 bits and the rest of that."""
CANCELLED: Final = 1.0 / 67108864
"""A remainder below this has lost too many bits: it is computed again with more of them."""
NEGLIGIBLE: Final = 1.0 / 268435456
"""Below this sin(x) = tanh(x) = x."""

# Minimax polynomials in the square of the argument; their errors are below 2^-58.
S1: Final = 0.1666666666666663
S2: Final = 0.008333333333322355
S3: Final = 0.0001984126982975858
S4: Final = 0.000002755731367412557
S5: Final = 2.505075522477174 / 1e8
S6: Final = 1.589662239808020 / 1e10
C1: Final = 0.0416666666666666
C2: Final = 0.001388888888887404
C3: Final = 0.00002480158728943038
C4: Final = 0.0000002755731433670432
C5: Final = 2.087572106464262 / 1e9
C6: Final = 1.135952934179666 / 1e11


def sin(angle_rad: float) -> float:
    """Return the sine of an angle of at most MAX_ANGLE_RAD."""
    if -QUARTER <= angle_rad <= QUARTER:
        return _sine(angle_rad, 0.0)
    quadrant, head, tail = _in_quadrant(angle_rad)
    value = _cosine(head, tail) if quadrant & 1 else _sine(head, tail)
    return -value if quadrant & 2 else value


def cos(angle_rad: float) -> float:
    """Return the cosine of an angle of at most MAX_ANGLE_RAD."""
    if -QUARTER <= angle_rad <= QUARTER:
        return _cosine(angle_rad, 0.0)
    quadrant, head, tail = _in_quadrant(angle_rad)
    value = _sine(head, tail) if quadrant & 1 else _cosine(head, tail)
    return -value if quadrant + 1 & 2 else value


def cos_sin(angle_rad: float) -> tuple[float, float]:
    """Return cosine and sine, which cost less together: the series of `_cosine` and `_sine`."""
    quadrant, head, tail = 0, angle_rad, 0.0
    if not -QUARTER <= angle_rad <= QUARTER:
        quadrant, head, tail = _in_quadrant(angle_rad)
    z = head * head
    half = 0.5 * z
    near = 1.0 - half
    fourth = z * z * (C1 - z * (C2 - z * (C3 - z * (C4 - z * (C5 - z * C6)))))
    cosine, sine = near + (((1.0 - near) - half) + (fourth - head * tail)), head
    if not -NEGLIGIBLE < head < NEGLIGIBLE:
        cube = z * (S1 - z * (S2 - z * (S3 - z * (S4 - z * (S5 - z * S6)))))
        sine = head - (head * cube - tail * near)
    if quadrant == 0:
        return cosine, sine
    if quadrant & 1:
        cosine, sine = -sine, cosine
    return (-cosine, -sine) if quadrant & 2 else (cosine, sine)


def _in_quadrant(angle_rad: float) -> tuple[int, float, float]:
    """Return the nearest multiple of half pi, and the angle from there (Cody and Waite)."""
    if not -MAX_ANGLE_RAD <= angle_rad <= MAX_ANGLE_RAD:
        return 0, nan, nan
    turns = angle_rad * PER_HALF_PI
    quadrant = int(turns + 0.5) if turns > 0.0 else int(turns - 0.5)
    rest = angle_rad - quadrant * HALF_PI_1  # exact: 10 bits times 42
    less = quadrant * HALF_PI_1_TAIL
    head = rest - less
    if -CANCELLED < head < CANCELLED:
        return _in_quadrant_exactly(rest, quadrant)
    return quadrant, head, (rest - head) - less


def _in_quadrant_exactly(rest: float, quadrant: int) -> tuple[int, float, float]:
    less = quadrant * HALF_PI_2  # exact
    nearly = rest - less
    lost = nearly - rest
    tail = (rest - (nearly - lost)) - (less + lost) - quadrant * HALF_PI_2_TAIL
    head = nearly + tail
    return quadrant, head, (nearly - head) + tail


def _sine(head: float, tail: float) -> float:
    """Return the sine of head + tail, at most an eighth of a turn."""
    if -NEGLIGIBLE < head < NEGLIGIBLE:
        return head
    z = head * head
    cube = z * (S1 - z * (S2 - z * (S3 - z * (S4 - z * (S5 - z * S6)))))
    return head - (head * cube - tail * (1.0 - 0.5 * z))


def _cosine(head: float, tail: float) -> float:
    """Return the cosine of head + tail, at most an eighth of a turn."""
    z = head * head
    half = 0.5 * z
    fourth = z * z * (C1 - z * (C2 - z * (C3 - z * (C4 - z * (C5 - z * C6)))))
    value = 1.0 - half
    return value + (((1.0 - value) - half) + (fourth - head * tail))


SPLIT: Final = 134217729.0
"""2^27 + 1: splits a float into two halves whose products are exact (Dekker)."""
FAINT: Final = 1.0 / (1 << 60)
"""Below this atan(x) = x."""
MOST: Final = float(1 << 500)
LEAST: Final = 1.0 / MOST
SCALE: Final = float(1 << 600)

ATAN_HEADS: Final = (
    0.0,
    133525159 / 1073741824,
    263043837 / 1073741824,
    385227074 / 1073741824,
    497837829 / 1073741824,
    599791448 / 1073741824,
    690954054 / 1073741824,
    771837835 / 1073741824,
    843314857 / 1073741824,
)
ATAN_TAILS: Final = (
    0.0,
    -3.090596976285573 / 1e10,
    -3.847101141689820 / 1e10,
    -0.986952432881620 / 1e10,
    3.555457821993637 / 1e10,
    -2.401434661281012 / 1e10,
    2.810020152818131 / 1e10,
    -5.621238957199952 / 1e11,
    -4.352757847752083 / 1e10,
)
"""The arc tangents of k / 8, to 30 bits and the rest."""
A1: Final = 0.3333333333333316
A2: Final = 0.1999999999937235
A3: Final = 0.1428571354791544
A4: Final = 0.1111073247633514
A5: Final = 0.09002611640874305
D1: Final = 0.1666666666666676
D2: Final = 0.07499999999970101
D3: Final = 0.0446428571752842
D4: Final = 0.03038194267536432
D5: Final = 0.02237221590355906
D6: Final = 0.0173515955427577
D7: Final = 0.01398101800990798
D8: Final = 0.01139729747685858
D9: Final = 0.01078929572880269
D10: Final = 0.003672282716578947
D11: Final = 0.02179040729192251
D12: Final = -0.0211163785293054
D13: Final = 0.03270194902768546


def atan2(y: float, x: float) -> float:
    """Return the angle of the point (x, y), from -pi to pi; zeros and infinities have signs."""
    across, along = (y if y >= 0.0 else -y), (x if x >= 0.0 else -x)
    if not (across < inf and along < inf):
        if across + along != inf:
            return nan
        across, along = float(across == inf), float(along == inf)
    if across <= along:
        head, tail = _small_angle(across, along)
    else:
        less, less_tail = _small_angle(along, across)
        head = HALF_PI - less
        tail = ((HALF_PI - head) - less) + (HALF_PI_TAIL - less_tail)
    if x < 0.0 or (x == 0.0 and y == 0.0 and copysign(1.0, x) < 0.0):
        less = head
        head = PI - less
        tail = ((PI - head) - less) + (PI_TAIL - tail)
    return copysign(head + tail, y)


def _small_angle(y: float, x: float) -> tuple[float, float]:
    """Return the angle of a point with 0 <= y <= x in two parts."""
    tangent = y / x if x != 0.0 else 0.0
    if tangent < FAINT:
        return tangent, 0.0
    if not LEAST < x < MOST:
        y, x = (y / SCALE, x / SCALE) if x > 1.0 else (y * SCALE, x * SCALE)
    scaled = tangent * SPLIT
    upper = scaled - (scaled - tangent)
    scaled = x * SPLIT
    x_upper = scaled - (scaled - x)
    lost = ((y - upper * x_upper) - upper * (x - x_upper)) / x - (tangent - upper)
    if tangent < 0.0625:
        z = tangent * tangent
        cube = z * (A1 - z * (A2 - z * (A3 - z * (A4 - z * A5))))
        return tangent, lost - tangent * cube
    eighths = int(8.0 * tangent + 0.5)
    step = 0.125 * eighths
    beyond = tangent - step  # exact: they differ by less than a factor of 2
    wide = 1.0 + step * tangent
    turned = beyond / wide
    z = turned * turned
    cube = z * (A1 - z * (A2 - z * (A3 - z * (A4 - z * A5))))
    begin = ATAN_HEADS[eighths]
    head = begin + beyond
    tail = (lost - beyond * step * tangent) / wide - turned * cube + ATAN_TAILS[eighths]
    return head, (beyond - (head - begin)) + tail


def asin(sine: float) -> float:
    """Return the angle from -pi / 2 to pi / 2 with a sine."""
    if -0.5 <= sine <= 0.5:
        if -NEGLIGIBLE < sine < NEGLIGIBLE:
            return sine
        return sine + sine * _arc_series(sine * sine)
    size = sine if sine >= 0.0 else -sine
    if not size <= 1.0:
        return nan
    half, half_tail = _half_arc(size)
    head = HALF_PI - 2.0 * half
    tail = ((HALF_PI - head) - 2.0 * half) + (HALF_PI_TAIL - 2.0 * half_tail)
    return copysign(head + tail, sine)


def acos(cosine: float) -> float:
    """Return the angle from 0 to pi with a cosine."""
    if -0.5 <= cosine <= 0.5:
        head = HALF_PI - cosine
        lost = (HALF_PI - head) - cosine
        return head + (lost + (HALF_PI_TAIL - cosine * _arc_series(cosine * cosine)))
    size = cosine if cosine >= 0.0 else -cosine
    if not size <= 1.0:
        return nan
    half, half_tail = _half_arc(size)
    if cosine > 0.0:
        return 2.0 * (half + half_tail)
    head = PI - 2.0 * half
    return head + (((PI - head) - 2.0 * half) + (PI_TAIL - 2.0 * half_tail))


def _half_arc(cosine: float) -> tuple[float, float]:
    """Return half the angle with a cosine from 0.5 to 1, as the arc of its sine, in two parts."""
    z = 0.5 * (1.0 - cosine)
    sine = sqrt(z)
    if sine == 0.0:
        return 0.0, 0.0
    scaled = sine * SPLIT
    upper = scaled - (scaled - sine)
    return upper, (z - upper * upper) / (sine + upper) + sine * _arc_series(z)


def _arc_series(z: float) -> float:
    """Return asin(x) / x - 1 with z = x * x up to 0.25."""
    series = D6 + z * (D7 + z * (D8 + z * (D9 + z * (D10 + z * (D11 + z * (D12 + z * D13))))))
    return z * (D1 + z * (D2 + z * (D3 + z * (D4 + z * (D5 + z * series)))))


# Minimax polynomials with fewer terms, for the coarse functions.
Q1: Final = 0.999973216
Q2: Final = 0.331803177
Q3: Final = 0.185728843
Q4: Final = 0.0927491825
Q5: Final = 0.0242752478
R1: Final = 1.57075638
R2: Final = 0.212815484
R3: Final = 0.0766593365
R4: Final = 0.0206725583


def coarse_atan2(y: float, x: float) -> float:
    """Return the angle of the point (x, y) within 3e-5 rad, at a third of the cost; 0 at (0, 0)."""
    across, along = (y if y >= 0.0 else -y), (x if x >= 0.0 else -x)
    steep = across > along
    if steep:
        across, along = along, across
    tangent = across / along if along else 0.0
    z = tangent * tangent
    angle_rad = tangent * (Q1 - z * (Q2 - z * (Q3 - z * (Q4 - z * Q5))))
    if steep:
        angle_rad = HALF_PI - angle_rad
    if x < 0.0:
        angle_rad = PI - angle_rad
    return angle_rad if y >= 0.0 else -angle_rad


def coarse_acos(cosine: float) -> float:
    """Return the angle with a cosine from 0 to 1 within 5e-5 rad, at a third of the cost."""
    return sqrt(1.0 - cosine) * (R1 - cosine * (R2 - cosine * (R3 - cosine * R4)))


MAX_EXP: Final = 710.0
MIN_EXP: Final = -746.0
PER_LN_2: Final = 1.442695040888963
LN_2: Final = 3048493539143 / 4398046511104
LN_2_TAIL: Final = 5.497923018708371 / 1e14
SAFE_DOUBLINGS: Final = 1000
E1: Final = 0.1666666666666666
E2: Final = 0.002777777777776239
E3: Final = 0.00006613756612342024
E4: Final = 0.000001653439090512851
E5: Final = 4.175335890364598 / 1e8
E6: Final = 1.056614767363661 / 1e9
E7: Final = 2.657763715152880 / 1e11
E8: Final = 5.922028652264443 / 1e13

NEAR_ONE: Final = 0.55
SATURATED: Final = 22.0


def exp(power: float) -> float:
    """Return e to a power: infinity and 0 beyond the range of floats."""
    if not MIN_EXP < power < MAX_EXP:
        return nan if power != power else inf if power > 0.0 else 0.0
    doublings, value, _ = _exp_parts(power)
    if doublings < -SAFE_DOUBLINGS:
        value, doublings = value / (1 << SAFE_DOUBLINGS), doublings + SAFE_DOUBLINGS
    elif doublings > SAFE_DOUBLINGS:
        value, doublings = value * (1 << SAFE_DOUBLINGS), doublings - SAFE_DOUBLINGS
    return value * (1 << doublings) if doublings >= 0 else value / (1 << -doublings)


def tanh(value: float) -> float:
    """Return the hyperbolic tangent."""
    size = value if value >= 0.0 else -value
    if size < NEAR_ONE:
        if size < NEGLIGIBLE:
            return value
        z = 4.0 * value * value
        series = z * _coth_series(z)
        return value - value * (series / (2.0 + series))
    if not size < SATURATED:
        return value if value != value else copysign(1.0, value)
    doublings, head, tail = _exp_parts(2.0 * size)
    scale = 1 << doublings
    head, tail = head * scale, tail * scale
    whole = head + 1.0
    tail += 1.0 - (whole - head)
    away = 2.0 / whole
    near = 1.0 - away
    return copysign(near + (((1.0 - near) - away) + away * tail / whole), value)


def hypot(x: float, y: float) -> float:
    """Return sqrt(x^2 + y^2) of lengths whose squares are finite."""
    return sqrt(x * x + y * y)


def _exp_parts(power: float) -> tuple[int, float, float]:
    """Return k and the two parts of e^power / 2^k."""
    turns = power * PER_LN_2
    doublings = int(turns + 0.5) if turns > 0.0 else int(turns - 0.5)
    head = power - doublings * LN_2  # exact: 11 bits times 42
    less = doublings * LN_2_TAIL
    rest = head - less
    z = rest * rest
    series = rest - z * _coth_series(z)
    growth = head - (less - rest * series / (2.0 - series))
    value = 1.0 + growth
    return doublings, value, growth - (value - 1.0)


def _coth_series(z: float) -> float:
    """Return (x coth(x / 2) - 2) / z with z = x * x up to 1.21."""
    return E1 - z * (E2 - z * (E3 - z * (E4 - z * (E5 - z * (E6 - z * (E7 - z * E8))))))
