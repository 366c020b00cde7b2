"""Random choices for the generation of worlds, the same with every Python.

Python promises the numbers of `Random.random` for a seed, and no other method's for all versions.
So this module makes the others from them and from the bits behind them.
"""

import random
from collections.abc import MutableSequence, Sequence
from typing import TypeVar

One = TypeVar("One")


class Draws:
    """A stream of random choices; equal names give equal streams."""

    __slots__ = ("_source",)

    def __init__(self, name: str) -> None:
        self._source = random.Random(name)

    def random(self) -> float:
        """Return a number from 0 to below 1."""
        return self._source.random()

    def uniform(self, low: float, high: float) -> float:
        """Return a number from `low` to `high`."""
        return low + (high - low) * self._source.random()

    def randrange(self, count: int) -> int:
        """Return a whole number from 0 to below `count`, from as few bits as hold it."""
        bits = count.bit_length()
        while True:
            number = self._source.getrandbits(bits)
            if number < count:
                return number

    def randint(self, low: int, high: int) -> int:
        """Return a whole number from `low` to `high`."""
        return low + self.randrange(high - low + 1)

    def choice(self, options: Sequence[One]) -> One:
        """Return one of the options."""
        return options[self.randrange(len(options))]

    def shuffle(self, items: MutableSequence[One]) -> None:
        """Put the items into a random order."""
        for last in range(len(items) - 1, 0, -1):
            other = self.randrange(last + 1)
            items[last], items[other] = items[other], items[last]

    def sample(self, options: Sequence[One], count: int) -> list[One]:
        """Return so many different options in random order."""
        left, chosen = list(options), []
        for size in range(len(left), len(left) - count, -1):
            index = self.randrange(size)
            chosen.append(left[index])
            left[index] = left[size - 1]
        return chosen
