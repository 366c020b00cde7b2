"""Real-time options of the operating system; each returns a warning if unavailable."""

import os
import sys
import threading
from contextlib import suppress
from pathlib import Path

FIFO_PRIORITY = 50
BELOW = 10
SWITCH_S = 0.0005


def share_interpreter() -> None:
    """Limit the time that another thread may hold the interpreter; the default is 5 ms."""
    sys.setswitchinterval(SWITCH_S)


def use_fifo(priority: int = FIFO_PRIORITY) -> str | None:
    """Schedule the process SCHED_FIFO; return None, or a warning if that failed.

    The calling thread has priority over the others. These are included, because a preempted thread
    that holds the interpreter would block the loop. Call this after the bus is open: threads
    started later do not inherit the class.
    """
    if not hasattr(os, "sched_setscheduler"):
        return "real-time scheduling is not available on this system: running as a normal process"
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        for thread in other_threads():
            with suppress(ProcessLookupError):  # the thread has ended
                os.sched_setscheduler(thread, policy, os.sched_param(priority - BELOW))
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        return "real-time scheduling refused (needs CAP_SYS_NICE): running as a normal process"
    except OSError as error:
        return f"real-time scheduling failed ({error.strerror}): running as a normal process"
    return None


def other_threads() -> list[int]:
    """Return the native ids of the other threads of this process."""
    tasks = Path("/proc/self/task")
    own = threading.get_native_id()
    if not tasks.exists():
        return []
    return [number for number in map(int, os.listdir(tasks)) if number != own]
