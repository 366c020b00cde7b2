"""What a bad network does to samples, as settings, and in which order they come out of it."""

from collections.abc import Iterable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from random import Random
from typing import Final, Generic, TypeVar

from runtime.errors import UserError
from runtime.units import NS_PER_MS

S = TypeVar("S")
SHARES: Final = ("loss", "duplicate", "reorder")
LONGEST_MS: Final = 60_000.0


@dataclass(frozen=True, kw_only=True)
class LinkFaults:
    """The `[network.trouble]` table: what happens to samples on their way in. Answers are spared,
    and so are events, which would be fetched again.

    `loss`, `duplicate` and `reorder` are shares of all samples, 0 to 1; one that is reordered is
    overtaken by the next of its key. Each, and each copy, is late by `delay_ms`, and by up to
    `jitter_ms` more. `paths` are the beginnings of the topics it is about; none: all of them.

    Raises UserError, naming the field, for a share or a time that cannot be.
    """

    loss: float = 0.0
    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    paths: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        for name in SHARES:
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise UserError(f"{name}: {getattr(self, name)} is not a share from 0 to 1")
        for name in ("delay_ms", "jitter_ms"):
            if not 0.0 <= getattr(self, name) <= LONGEST_MS:
                limits = f"0 to {LONGEST_MS:.0f} ms"
                raise UserError(f"{name}: {getattr(self, name)} is not within {limits}")

    def concerns(self, path: str) -> bool:
        """Is it about this topic?"""
        return not self.paths or path.startswith(self.paths)


class FaultyLink(Generic[S]):
    """The way of one key's samples through trouble. Time is passed in, in ns of any clock.

    What is drawn depends on seed, key and number of the sample alone: with a clock that is
    simulated, the same samples always fare the same.
    """

    def __init__(self, trouble: LinkFaults, key: str) -> None:
        self._trouble = trouble
        self._random = Random(f"{trouble.seed} {key}")
        self._order = count()
        self._late: list[tuple[int, int, S]] = []
        self._overtaken: list[S] = []

    def take(self, sample: S, now_ns: int) -> list[S]:
        """What comes out now that this one went in."""
        trouble, drawn = self._trouble, self._random.random
        lost, doubled, held = (drawn() < getattr(trouble, name) for name in SHARES)
        copies = 0 if lost else 2 if doubled else 1
        if held and copies and not self._overtaken:
            self._overtaken = [sample] * copies
            return self.due(now_ns)
        for one in [sample] * copies + self._let_go():
            late_ms = trouble.delay_ms + drawn() * trouble.jitter_ms
            heappush(self._late, (now_ns + round(late_ms * NS_PER_MS), next(self._order), one))
        return self.due(now_ns)

    def due(self, now_ns: int) -> list[S]:
        """What has been late for long enough, in the order in which it was due."""
        found = []
        while self._late and self._late[0][0] <= now_ns:
            found.append(heappop(self._late)[2])
        return found

    @property
    def next_ns(self) -> int | None:
        """When the next one is due; None when none is on its way."""
        return self._late[0][0] if self._late else None

    def _let_go(self) -> list[S]:
        freed, self._overtaken = self._overtaken, []
        return freed


def earliest(ways: "Iterable[FaultyLink[S]]") -> int | None:
    """When the next sample of any of them is due."""
    return min((way.next_ns for way in ways if way.next_ns is not None), default=None)
