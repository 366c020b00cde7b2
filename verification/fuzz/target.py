"""A decoder as the fuzzer sees it: bytes in, and nothing out of it but the errors it may raise."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from random import Random
from typing import Final, TypeAlias

from plant.model.errors import WorldError
from runtime.errors import RemoteError, UserError
from verification.fuzz.mutate import Material, mutated

Errors: TypeAlias = tuple[type[BaseException], ...]
REFUSALS: Final[Errors] = (UserError, RemoteError, WorldError)


def none() -> Sequence[bytes]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Target:
    """`run` gets the bytes and a folder of its own for files; what is not `allowed` is a crash.

    `samples` are good inputs, `bombs` bad ones that somebody thought of: those are tried first.
    The heavier, the more inputs: what is quick is tried more often.
    """

    name: str
    samples: Callable[[], Sequence[bytes]]
    run: Callable[[bytes, Path], object]
    allowed: Errors = REFUSALS
    words: Sequence[bytes] = ()
    bombs: Callable[[], Sequence[bytes]] = none
    weight: int = 20

    @cached_property
    def good(self) -> tuple[bytes, ...]:
        return tuple(self.samples())

    @cached_property
    def _bad(self) -> tuple[bytes, ...]:
        return tuple(self.bombs())

    def input(self, seed: int, index: int) -> bytes:
        """The same for the same numbers: samples as they are, bombs, then mutations."""
        fixed = (*self.good, *self._bad)
        if index < len(fixed):
            return fixed[index]
        return mutated(Material(self.good, self.words), Random(f"{seed}/{self.name}/{index}"))

    def accepts(self, data: bytes, folder: Path) -> bool:
        """False when the input is refused as it may be; whatever else it raises comes through."""
        with suppress(*self.allowed):
            self.run(data, folder)
            return True
        return False
