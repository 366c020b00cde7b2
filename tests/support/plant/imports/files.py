"""Handmade files of foreign formats, and the messages for invalid ones."""

from collections.abc import Callable

import pytest

from plant.model.errors import WorldError, WorldProblem

MAP = """\
type octile
height 5
width 8
map
........
.@@@@T..
.O....W.
.@.GS...
........
"""
SCEN = (
    "version 1\n0\tmaps/hand.map\t8\t5\t0\t0\t7\t4\t9.0\n1\tmaps/hand.map\t8\t5\t3\t3\t0\t4\t4.2\n"
)
YAML = """\
image: hand.pgm
resolution: 0.5   # metres per pixel
origin: [-1.0, -2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
# Ten by six: a black frame, a black block, and unknown grey in a corner.
ROWS = (
    (0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
    (0, 254, 254, 254, 254, 254, 254, 254, 205, 0),
    (0, 254, 254, 254, 254, 254, 254, 254, 254, 0),
    (0, 254, 254, 254, 0, 0, 254, 254, 254, 0),
    (0, 254, 254, 254, 254, 254, 254, 254, 254, 0),
    (0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
)
P5 = b"P5\n# made by hand\n10 6\n255\n" + bytes(value for row in ROWS for value in row)
P2 = ("P2\n10 6\n255\n" + "\n".join(" ".join(map(str, row)) for row in ROWS) + "\n").encode()


def refused(make: Callable[[], object]) -> WorldProblem:
    """Return the only problem that is reported, with file, reason and fix."""
    with pytest.raises(WorldError) as caught:
        make()
    (problem,) = caught.value.problems
    assert problem.file
    assert problem.key
    assert problem.reason
    assert problem.fix
    return problem
