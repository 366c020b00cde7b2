"""The size of an object on the board's heap is that of its blocks."""

import pytest

from checks.speed.board.memory_size import heap_bytes, lengths
from robot.core.values import Pose


class Thing:
    __slots__ = ("a", "b")

    def __init__(self, a: object, b: object) -> None:
        self.a, self.b = a, b


class Loose:
    """An object with a __dict__, whose size is not bounded."""


def test_memory_size_is_that_of_its_blocks() -> None:
    assert heap_bytes(Thing(1, None)) == 32
    assert heap_bytes(Thing(1.5, 1 << 40)) == 32 + 16 + 32
    assert heap_bytes(Thing([0] * 10, bytearray(20))) == 32 + (16 + 48) + (16 + 32)
    assert heap_bytes(Thing([0.0] * 10, Pose(0.0, 0.0, 0.0))) == 32 + (16 + 48 + 160) + (32 + 48)
    shared = [0] * 4
    assert heap_bytes(Thing(shared, shared)) == 32 + 32
    with pytest.raises(TypeError, match="Loose: no __slots__"):
        heap_bytes(Thing(Loose(), 1))


def test_lengths_grow_with_a_list() -> None:
    growing: list[int] = []
    thing = Thing(growing, [1, 2])
    assert lengths(thing) == 2
    growing.append(1)
    assert lengths(thing) == 3
