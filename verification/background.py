"""`python -m verification.background COMMAND...`: run a command that yields to everything else.

It has a session of its own with the lowest weight, so that tests with containers, whose processes
belong to other groups of the scheduler, get the processors first. It ends with its parent.
"""

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from ground.launch.child_command import die_with_parent

LOWEST: Final = 19
GROUP: Final = Path("/proc/self/autogroup")


def main() -> None:
    """Become the command."""
    parent = os.getppid()
    with suppress(OSError):  # it may lead a group already
        os.setsid()
    os.nice(LOWEST)
    with suppress(OSError):  # a kernel without groups for sessions
        GROUP.write_text(f"{LOWEST}\n")
    if die_with_parent(parent):
        os.execv(sys.argv[1], sys.argv[1:])


if __name__ == "__main__":
    main()
