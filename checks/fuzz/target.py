"""A decoder as the fuzzer sees it: bytes in, and only allowed errors out."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from random import Random
from typing import Final, TypeAlias

from checks.fuzz.mutate import Material, mutate_sample
from plant.model.errors import WorldError
from runtime.errors import RemoteError, UserError

Errors: TypeAlias = tuple[type[BaseException], ...]
REFUSALS: Final[Errors] = (UserError, RemoteError, WorldError)


def no_bombs() -> Sequence[bytes]:
    """Return no bombs."""
    return ()


@dataclass(frozen=True, kw_only=True)
class FuzzTarget:
    """A decoder: `run` gets the bytes and a folder for files; errors not in `allowed` are crashes.

    `samples` are good inputs, and `bombs` are known bad ones, which are tried first. `weight` is
    the share of inputs: a fast decoder gets more.
    """

    name: str
    samples: Callable[[], Sequence[bytes]]
    run: Callable[[bytes, Path], object]
    allowed: Errors = REFUSALS
    words: Sequence[bytes] = ()
    bombs: Callable[[], Sequence[bytes]] = no_bombs
    weight: int = 20

    @cached_property
    def good(self) -> tuple[bytes, ...]:
        """The good samples."""
        return tuple(self.samples())

    @cached_property
    def _bad(self) -> tuple[bytes, ...]:
        return tuple(self.bombs())

    def input(self, seed: int, index: int) -> bytes:
        """Return an input: samples and bombs unchanged, then reproducible mutations."""
        fixed = (*self.good, *self._bad)
        if index < len(fixed):
            return fixed[index]
        return mutate_sample(Material(self.good, self.words), Random(f"{seed}/{self.name}/{index}"))

    def accepts(self, data: bytes, folder: Path) -> bool:
        """Return False if the input is refused with an allowed error; others are raised."""
        with suppress(*self.allowed):
            self.run(data, folder)
            return True
        return False
