"""What arrives on each topic: rate and loss, by counting; called from the bus, it only stores."""

from typing import Any, NamedTuple

from ground.telemetry import Age
from protocol.topics import Topic


class StreamRow(NamedTuple):
    """One line of the Links screen. Rates in Hz over the last seconds; None: nothing arrived."""

    topic: Topic[Any]
    rate_hz: float | None
    age_ns: int | None
    age: Age
    received: int
    lost: int
    lost_percent: float
    rejected: int
    last_rejection: str
