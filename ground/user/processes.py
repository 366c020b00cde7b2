"""Identify a process for longer than its id, which the system gives to another process later."""

import os
from functools import cache
from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")
AFTER_NAME: Final = ")"
"""Ends the name of the program in `stat`; the name may contain blanks and this character."""
STATE: Final = 0
"""Field of `stat` after the name."""
START: Final = 19
"""Field of `stat` after the name: clock ticks since the boot."""
ENDED: Final = ("Z", "X")


def start_of(pid: int) -> str | None:
    """Return the boot and the start time of a process; None if it does not run.

    Where the system has no /proc, the text is empty for a process that runs.
    """
    if not PROC.joinpath("self").exists():
        return "" if _exists(pid) else None
    try:
        text = PROC.joinpath(str(pid), "stat").read_text(errors="replace")
    except OSError:
        return None
    fields = text.rpartition(AFTER_NAME)[2].split()
    return None if fields[STATE] in ENDED else f"{_boot()} {fields[START]}"


@cache
def _boot() -> str:
    """Return the id of this boot."""
    try:
        return PROC.joinpath("sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return "unknown"


def _exists(pid: int) -> bool:
    """Return whether there is a process with this id."""
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except OSError:
        return False
    return True
