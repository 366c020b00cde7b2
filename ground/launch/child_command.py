"""Run a verb in a child process that the kernel kills when the parent process ends."""

import ctypes
import os
import runpy
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from runtime.cli.verb_lookup import with_present_name

PR_SET_PDEATHSIG: Final = 1
START: Final = (
    "import sys; sys.path.insert(0, sys.argv.pop(1));"
    " from ground.launch.child_command import main; sys.exit(main(sys.argv[1:]))"
)


def command(arguments: Sequence[str], parent: int) -> list[str]:
    """Return the command line for `sidestep ARGUMENTS`, valid in any working directory.

    The arguments begin with the short word of a verb, such as `robot` for `run robot`.
    """
    root = str(Path(__file__).resolve().parents[2])
    # -P keeps the working directory out of the path: a stray json.py there must not be imported.
    return [sys.executable, "-P", "-c", START, root, str(parent), *with_present_name(arguments)]


def main(arguments: Sequence[str]) -> int:
    """Run the verb given after the parent's process id; return the exit code."""
    parent, *verb = arguments
    if not die_with_parent(int(parent)):
        return 1
    sys.argv[:] = ["sidestep", *verb]
    runpy.run_module("sidestep", run_name="__main__")  # run as the executable
    return 0


def die_with_parent(parent: int) -> bool:
    """Request SIGKILL at the parent's death (Linux only); return False if the parent is gone."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    return os.getppid() == parent
