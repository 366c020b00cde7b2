"""Whether the robot is in our hands: a loss, its end, and what must be read again after it."""

from enum import Enum
from typing import Final, NamedTuple

from ground.station.link.loss import LossKind
from runtime.units import NS_PER_MS

BEGUN_NS: Final = 150 * NS_PER_MS
"""A loss is told once it has been judged the same for so long: streams do not stop together."""
CHANGED_NS: Final = 1_500 * NS_PER_MS
"""A silence is given another cause only after this: whoever comes back is there in parts at first,
and is dialled again within half a second."""
HEARD: Final = (None, LossKind.SENSES_STALE, LossKind.OTHER_OPERATOR)
"""As long as it is one of these the robot is heard."""
SETTLED_NS: Final = 300 * NS_PER_MS
"""A loss is over when nothing has been lost for so long: one good frame is no return."""


class Need(Enum):
    """What is read again after each loss, and once at the start."""

    STATE = "state"
    PARAMETERS = "parameters"
    LEASE = "lease"


class Change(NamedTuple):
    """What has just begun (`now`), or what has ended (`before`) and after how long."""

    now: LossKind | None
    before: LossKind | None
    gap_ns: int


class Contact:
    """Fed with a judgement at each poll."""

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
        """Nothing is lost, and everything has been read since the last loss."""
        return self.kind is None and not self._missing

    @property
    def heard(self) -> bool:
        """Its loop is heard: what it says of itself is true, whether we may command it or not."""
        return self.kind in HEARD

    @property
    def missing(self) -> tuple[Need, ...]:
        return tuple(need for need in Need if need in self._missing)

    def read(self, need: Need, arrived_ns: int) -> None:
        """Something was read; it counts only when it came after the loss."""
        if self.kind is None and arrived_ns >= self.back_ns:
            self._missing.discard(need)

    def again(self, now_ns: int) -> None:
        """Everything is to be read once more, as after a loss."""
        self.back_ns = now_ns
        self._missing = set(Need)

    def judged(self, kind: LossKind | None, now_ns: int, since_ns: int) -> Change | None:
        """What has changed by this judgement; `since_ns` is when what is lost was last heard."""
        if kind is not self._guess:
            self._guess, self._guessed_ns = kind, now_ns
        if kind is None:
            return self._well(now_ns)
        self._well_ns = None
        sure_ns = BEGUN_NS if self.heard else CHANGED_NS
        if kind is self.kind or now_ns - self._guessed_ns < sure_ns:
            return None
        before = self.kind
        if before is None:
            self.since_ns = since_ns
        self.kind = kind
        self._missing = set(Need)
        return Change(kind, before, now_ns - self.since_ns)

    def _well(self, now_ns: int) -> Change | None:
        if self.kind is None:
            return None
        if self._well_ns is None:
            self._well_ns = now_ns
        if now_ns - self._well_ns < SETTLED_NS:
            return None
        before, self.kind = self.kind, None
        gap_ns = self._well_ns - self.since_ns
        self.again(self._well_ns)
        self._well_ns = None
        return Change(None, before, gap_ns)
