"""`python -m verification.idle COMMAND ...`: run a command with the processor time that is left.

The command is in the idle class of the scheduler. It has a session of its own, because the kernel
divides time between sessions first (autogroups). It ends with the process that started it.
"""

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from ground.launch.child_command import die_with_parent

AUTOGROUP: Final = Path("/proc/self/autogroup")
NICEST: Final = "19"


def main(argv: Sequence[str]) -> int:
    """Replace this process by the command; return 1 if its parent is gone."""
    parent = os.getppid()
    with suppress(PermissionError):  # it leads a group already
        os.setsid()
    with suppress(OSError):
        AUTOGROUP.write_text(NICEST)
    if hasattr(os, "SCHED_IDLE"):  # Linux only
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    if die_with_parent(parent):
        os.execvp(argv[0], [*argv])
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
