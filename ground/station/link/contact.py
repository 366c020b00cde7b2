"""Track whether the robot can be commanded: a loss, its end, and what must be read after it."""

from enum import Enum
from typing import Final, NamedTuple

from ground.station.link.loss import LossKind
from runtime.units import NS_PER_MS

ONSET_NS: Final = 150 * NS_PER_MS
"""A loss is reported after its kind was the same for this time: streams do not stop at once."""
CHANGED_NS: Final = 1_500 * NS_PER_MS
"""A silent robot gets another kind of loss only after this time.

A returning robot is present in parts at first, and is dialled again within half a second.
"""
RECEIVING: Final = (None, LossKind.SENSES_STALE, LossKind.OTHER_OPERATOR)
"""With one of these kinds, data of the robot still arrive."""
SETTLED_NS: Final = 300 * NS_PER_MS
"""A loss is over when nothing was lost for this time: a single good frame does not end it."""


class Need(Enum):
    """Items to be read at the start and after each loss."""

    STATE = "state"
    PARAMETERS = "parameters"
    LEASE = "lease"


class Change(NamedTuple):
    """A loss that has begun (`now`), or one that has ended (`before`), and its duration."""

    now: LossKind | None
    before: LossKind | None
    gap_ns: int


class Contact:
    """State of the contact, updated with a kind of loss at each poll."""

    def __init__(self, now_ns: int) -> None:
        self.kind: LossKind | None = None
        self.since_ns = now_ns
        self.back_ns = now_ns
        self._well_ns: int | None = None
        self._guess: LossKind | None = None
        self._guessed_ns = now_ns
        self._missing = set(Need)

    @property
    def ready(self) -> bool:
        """True if nothing is lost and everything was read since the last loss."""
        return self.kind is None and not self._missing

    @property
    def is_receiving(self) -> bool:
        """True if data of the robot's control loop arrive, even if it cannot be commanded."""
        return self.kind in RECEIVING

    @property
    def missing(self) -> tuple[Need, ...]:
        """Items not yet read since the last loss."""
        return tuple(need for need in Need if need in self._missing)

    def read(self, need: Need, arrived_ns: int) -> None:
        """Note that something was read; it counts only if it arrived after the loss."""
        if self.kind is None and arrived_ns >= self.back_ns:
            self._missing.discard(need)

    def require_all(self, now_ns: int) -> None:
        """Require that everything is read again, as after a loss."""
        self.back_ns = now_ns
        self._missing = set(Need)

    def update(self, kind: LossKind | None, now_ns: int, since_ns: int) -> Change | None:
        """Update the kind of loss; return the change, if any.

        `since_ns` is the time of the last message of what is lost.
        """
        if kind is not self._guess:
            self._guess, self._guessed_ns = kind, now_ns
        if kind is None:
            return self._well(now_ns)
        self._well_ns = None
        sure_ns = ONSET_NS if self.is_receiving else CHANGED_NS
        if kind is self.kind or now_ns - self._guessed_ns < sure_ns:
            return None
        before = self.kind
        if before in RECEIVING or kind in RECEIVING:  # else the same silence under another name
            self.since_ns = since_ns
        self.kind = kind
        self._missing = set(Need)
        return Change(kind, before, now_ns - self.since_ns)

    def _well(self, now_ns: int) -> Change | None:
        if self.kind is None:
            return None
        if self._well_ns is None:
            self._well_ns = now_ns
        is_told = self.kind is LossKind.OTHER_OPERATOR  # the lease does not flicker like a link
        if now_ns - self._well_ns < SETTLED_NS and not is_told:
            return None
        before, self.kind = self.kind, None
        gap_ns = self._well_ns - self.since_ns
        self.require_all(self._well_ns)
        self._well_ns = None
        return Change(None, before, gap_ns)
