"""The one table of topics and services: key, message, rate, stale-after, publisher, priority."""

from dataclasses import dataclass
from enum import Enum

MS = 1_000_000


class Role(Enum):
    PLANT = "plant"
    ROBOT = "robot"
    GROUND = "ground"


class Priority(Enum):
    REAL_TIME = 1
    DATA_HIGH = 4
    DATA = 5
    DATA_LOW = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """A pub/sub stream. `stale_after_ns` 0: an event, never stale."""

    path: str
    messages: tuple[str, ...]
    publisher: Role
    rate_hz: float
    stale_after_ns: int
    priority: Priority = Priority.DATA
    doc: str

    def key(self, robot: str) -> str:
        return f"sidestep/{robot}/{self.path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """A query that is always answered: one request frame, one reply."""

    path: str
    requests: tuple[str, ...]
    server: Role
    doc: str

    def key(self, robot: str) -> str:
        return f"sidestep/{robot}/{self.path}"
