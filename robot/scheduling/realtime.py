"""What the operating system can do for punctuality; each option falls back with a warning."""

import os
import sys
import threading
from contextlib import suppress
from pathlib import Path

FIFO_PRIORITY = 50
BELOW = 10
SWITCH_S = 0.0005


def share_interpreter() -> None:
    """Let no thread keep the interpreter from the loop for longer; the usual 5 ms may do harm."""
    sys.setswitchinterval(SWITCH_S)


def use_fifo(priority: int = FIFO_PRIORITY) -> str | None:
    """Schedule this process SCHED_FIFO, the calling thread above the others; None when it worked,
    else the warning to show.

    The others, too: one that is not given a processor while it holds the interpreter would hold up
    the loop. To be called after the bus is open: what is started later does not inherit the class.
    """
    if not hasattr(os, "sched_setscheduler"):
        return "real-time scheduling is not available on this system: running as a normal process"
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        for thread in other_threads():
            with suppress(ProcessLookupError):  # it has ended meanwhile
                os.sched_setscheduler(thread, policy, os.sched_param(priority - BELOW))
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        return "real-time scheduling refused (needs CAP_SYS_NICE): running as a normal process"
    except OSError as error:
        return f"real-time scheduling failed ({error.strerror}): running as a normal process"
    return None


def other_threads() -> list[int]:
    """Those of this process that the system knows of, without the one that asks."""
    tasks = Path("/proc/self/task")
    own = threading.get_native_id()
    if not tasks.exists():
        return []
    return [number for number in map(int, os.listdir(tasks)) if number != own]
