"""`python -m checks.same_bits.functions`: print values of functions of libraries.

A control: it shows whether a variant changes what the C library, numpy and BLAS return. Each line
has the name of a function and its values for random arguments in hexadecimal.
"""

import math
import random
from collections.abc import Sequence
from typing import Final

import numpy as np

VALUES: Final = 20_000
LARGEST: Final = 3.0
VECTOR: Final = 20
"""Length of the vectors whose products are taken."""
OF_MATH: Final = ("sin", "cos", "exp", "tanh", "atan")


def lines() -> list[str]:
    """Return the lines to be printed."""
    source = random.Random(1)
    points = [(2.0 * source.random() - 1.0) * LARGEST for _ in range(VALUES)]
    array = np.array(points)
    table = array.reshape(-1, VECTOR)
    return [
        *(line(f"math.{name}", [getattr(math, name)(x) for x in points]) for name in OF_MATH),
        line("numpy.sin", np.sin(array).tolist()),
        line("numpy.exp", np.exp(array).tolist()),
        line("matrix product", (table @ table.T).ravel()[:VALUES].tolist()),
    ]


def line(name: str, values: Sequence[float]) -> str:
    """Return a name and values as a line."""
    return "\t".join((name, *(value.hex() for value in values)))


def values_of(line: str) -> tuple[str, list[str]]:
    """Return name and values of a printed line."""
    name, *values = line.split("\t")
    return name, values


if __name__ == "__main__":
    print("\n".join(lines()))
