"""Settings of a faulty link, and the order in which samples leave it."""

from collections.abc import Iterable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from random import Random
from typing import Final, Generic, TypeVar

from runtime.errors import UserError
from runtime.units import NS_PER_MS

S = TypeVar("S")
PROBABILITIES: Final = ("loss", "duplicate", "reorder")
MAX_DELAY_MS: Final = 60_000.0


@dataclass(frozen=True, kw_only=True)
class LinkFaults:
    """The `[network.trouble]` table: faults applied to received samples.

    Answers are exempt, and so are events, which would be fetched again.

    `loss`, `duplicate` and `reorder` are probabilities, 0 to 1. A reordered sample is delivered
    after the next one of its key. Each sample, and each copy, is delayed by `delay_ms` plus up to
    `jitter_ms`. `paths` are the prefixes of the affected topics; empty: all topics.

    Raises UserError, naming the field, for a value out of range.
    """

    loss: float = 0.0
    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    paths: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        for name in PROBABILITIES:
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise UserError(f"{name}: {getattr(self, name)} is not a probability from 0 to 1")
        for name in ("delay_ms", "jitter_ms"):
            if not 0.0 <= getattr(self, name) <= MAX_DELAY_MS:
                limits = f"0 to {MAX_DELAY_MS:.0f} ms"
                raise UserError(f"{name}: {getattr(self, name)} is not within {limits}")

    def concerns(self, path: str) -> bool:
        """Return whether the faults apply to this topic."""
        return not self.paths or path.startswith(self.paths)


class FaultyLink(Generic[S]):
    """The faulty link of one key. Time is passed in, in ns of any clock.

    Random numbers depend only on seed, key and number of the sample: on a simulated clock the same
    samples always have the same fate.
    """

    def __init__(self, trouble: LinkFaults, key: str) -> None:
        self._trouble = trouble
        self._random = Random(f"{trouble.seed} {key}")
        self._order = count()
        self._late: list[tuple[int, int, S]] = []
        self._overtaken: list[S] = []

    def take(self, sample: S, now_ns: int) -> list[S]:
        """Put a sample in; return the samples that leave the link now."""
        trouble, drawn = self._trouble, self._random.random
        lost, doubled, held = (drawn() < getattr(trouble, name) for name in PROBABILITIES)
        copies = 0 if lost else 2 if doubled else 1
        if held and copies and not self._overtaken:
            self._overtaken = [sample] * copies
            return self.due(now_ns)
        for one in [sample] * copies + self._released():
            late_ms = trouble.delay_ms + drawn() * trouble.jitter_ms
            heappush(self._late, (now_ns + round(late_ms * NS_PER_MS), next(self._order), one))
        return self.due(now_ns)

    def due(self, now_ns: int) -> list[S]:
        """Return the samples whose delay has passed, in order of their time."""
        found = []
        while self._late and self._late[0][0] <= now_ns:
            found.append(heappop(self._late)[2])
        return found

    @property
    def next_ns(self) -> int | None:
        """The time at which the next sample is due; None if none is delayed."""
        return self._late[0][0] if self._late else None

    def _released(self) -> list[S]:
        freed, self._overtaken = self._overtaken, []
        return freed


def earliest(links: "Iterable[FaultyLink[S]]") -> int | None:
    """Return the time at which the next sample of any link is due."""
    return min((link.next_ns for link in links if link.next_ns is not None), default=None)
