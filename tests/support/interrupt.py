"""Send a signal to the process of the test once something has happened."""

import os
import signal
import threading
from collections.abc import Callable

from tests.support.until import until


def interrupt_when(condition: Callable[[], object], number: signal.Signals = signal.SIGINT) -> None:
    """Send this process a signal as soon as the condition holds, or when it does not in time."""

    def wait() -> None:
        try:
            until(condition)
        finally:
            os.kill(os.getpid(), number)

    threading.Thread(target=wait, daemon=True).start()
