"""How a process ended, in words that follow its name."""

import signal
from typing import Final

from ground.launch.child_processes import how
from runtime.watchdog import HANGS

DEFECT: Final = "internal error: "
MOST: Final = 200


def cause_of(role: str, code: int, words: str) -> str:
    """From its exit code and the end of what it wrote."""
    if code == -signal.SIGALRM:
        return HANGS
    if code < 0:
        return f"was killed ({how(code)})"
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    for line in lines:
        if DEFECT in line:
            core = "a core exception" if role.startswith("robot") else "an exception"
            return f"ended by {core} ({line.partition(DEFECT)[2]})"[:MOST]
    last = f": {lines[-1]}" if lines else ""
    return f"ended by itself ({how(code)}{last})"[:MOST]
