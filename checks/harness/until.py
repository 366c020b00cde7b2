"""Wait for a condition that others bring about, and interrupt this process once it holds."""

import os
import signal
import threading
from collections.abc import Callable
from threading import Event
from time import monotonic
from typing import Final

PATIENCE_S: Final = 60.0
"""How long a condition may take on a busy machine. What is met does not wait for it."""

POLL_S: Final = 0.002
RARELY_S: Final = 0.02
SHARE: Final = 0.05
"""The pause grows with the wait, from POLL_S to RARELY_S: four tests that wait for processes would
else use a tenth of a core."""


def until(
    condition: Callable[[], object],
    what: str | Callable[[], object] = "",
    within_s: float = PATIENCE_S,
    poll_s: float = POLL_S,
) -> float:
    """Wait for a condition; return how many seconds it took.

    Raises RuntimeError with `what` when it does not hold in time.
    """
    started_s, pause = monotonic(), Event()
    while not condition():
        waited_s = monotonic() - started_s
        if waited_s > within_s:
            raise RuntimeError(f"not within {within_s:g} s: {what() if callable(what) else what}")
        pause.wait(max(poll_s, min(SHARE * waited_s, RARELY_S)))
    return monotonic() - started_s


def interrupt_when(condition: Callable[[], object], number: signal.Signals = signal.SIGINT) -> None:
    """Send this process a signal as soon as the condition holds, or when it does not in time."""

    def wait() -> None:
        try:
            until(condition)
        finally:
            os.kill(os.getpid(), number)

    threading.Thread(target=wait, daemon=True).start()
