"""Runs a verb in a child process that the kernel ends with its parent, whatever ends the parent."""

import ctypes
import os
import runpy
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

PR_SET_PDEATHSIG: Final = 1
START: Final = (
    "import sys; sys.path.insert(0, sys.argv.pop(1));"
    " from ground.launch.child_command import main; sys.exit(main(sys.argv[1:]))"
)


def command(arguments: Sequence[str], parent: int) -> list[str]:
    """What to execute for `sidestep ARGUMENTS`, from any directory, installed or not."""
    root = str(Path(__file__).resolve().parents[2])
    # -P keeps the working directory out of the path: a stray json.py there must not be imported.
    return [sys.executable, "-P", "-c", START, root, str(parent), *arguments]


def main(arguments: Sequence[str]) -> int:
    parent, *verb = arguments
    if not tie_to(int(parent)):
        return 1
    sys.argv[:] = ["sidestep", *verb]
    runpy.run_module("sidestep", run_name="__main__")  # the executable, which nobody imports
    return 0


def tie_to(parent: int) -> bool:
    """Die when the parent dies; False when it is dead already. Only Linux can do this."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    return os.getppid() == parent
