"""What the operating system can do for punctuality; each option falls back with a warning."""

import gc
import os
import sys

FIFO_PRIORITY = 50
SWITCH_S = 0.0005


def freeze_heap() -> str | None:
    """Move all that exists out of the collector's sight: no full collection stalls the loop.

    None when it worked, else the warning to show.
    """
    if not hasattr(gc, "freeze"):
        return "this Python cannot freeze its heap: a collection may stall the loop"
    gc.collect()
    gc.freeze()
    return None


def share_interpreter() -> None:
    """Let no thread keep the interpreter from the loop for longer; the usual 5 ms may do harm."""
    sys.setswitchinterval(SWITCH_S)


def use_fifo(priority: int = FIFO_PRIORITY) -> str | None:
    """Schedule the calling thread SCHED_FIFO; None when it worked, else the warning to show.

    To be called after the bus is open: threads started later would inherit the class.
    """
    if not hasattr(os, "sched_setscheduler"):
        return "real-time scheduling is not available on this system: running as a normal process"
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        return "real-time scheduling refused (needs CAP_SYS_NICE): running as a normal process"
    except OSError as error:
        return f"real-time scheduling failed ({error.strerror}): running as a normal process"
    return None
