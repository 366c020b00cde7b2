"""Wait for a condition that threads or other processes bring about."""

import time
from collections.abc import Callable
from threading import Event
from typing import Final

PATIENCE_S: Final = 60.0
"""How long a condition may take on a busy machine. A test that passes does not wait for it."""

POLL_S: Final = 0.003


def until(
    condition: Callable[[], object],
    within_s: float = PATIENCE_S,
    what: str | Callable[[], object] = "",
    poll_s: float = POLL_S,
) -> float:
    """Wait for a condition; return how many seconds it took.

    Raises:
        AssertionError: The condition was not met within `within_s`; the message holds `what`.
    """
    started_s, pause = time.monotonic(), Event()
    while not condition():
        if time.monotonic() - started_s > within_s:
            raise AssertionError(f"not within {within_s} s: {what() if callable(what) else what}")
        pause.wait(poll_s)
    return time.monotonic() - started_s
