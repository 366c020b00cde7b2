"""The least of a function of one positive number that spans many powers of ten."""

from collections.abc import Callable
from math import exp, log
from typing import Final

SHRINK: Final = 0.6180339887498949
ROUNDS: Final = 36
"""To 3e-8 of the span, in powers of ten."""


def least(function: Callable[[float], float], low: float, high: float) -> float:
    """Golden-section search on the logarithm, for a function with one valley."""
    a, b = log(low), log(high)
    c, d = b - SHRINK * (b - a), a + SHRINK * (b - a)
    at_c, at_d = function(exp(c)), function(exp(d))
    for _ in range(ROUNDS):
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - SHRINK * (b - a)
            at_c = function(exp(c))
        else:
            a, c, at_c = c, d, at_d
            d = a + SHRINK * (b - a)
            at_d = function(exp(d))
    return exp(0.5 * (a + b))
