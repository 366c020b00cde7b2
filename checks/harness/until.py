"""Wait for a condition that other threads or processes bring about."""

from collections.abc import Callable
from threading import Event
from time import monotonic
from typing import Final

PATIENCE_S: Final = 60.0
POLL_S: Final = 0.002


def until(
    condition: Callable[[], object],
    what: str | Callable[[], object],
    within_s: float = PATIENCE_S,
) -> None:
    """Wait for a condition; RuntimeError with `what` when it does not hold in time."""
    deadline_s, pause = monotonic() + within_s, Event()
    while not condition():
        if monotonic() > deadline_s:
            words = what() if callable(what) else what
            raise RuntimeError(f"not within {within_s:g} s: {words}")
        pause.wait(POLL_S)
