"""Run a verb in a child process that the kernel kills when the parent process ends."""

import ctypes
import os
import runpy
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from runtime.cli.verb_table import find, with_present_name

PR_SET_PDEATHSIG: Final = 1
PR_SET_NAME: Final = 15
MAX_NAME: Final = 15
"""Length of a process name in Linux."""
ROBOT: Final = "--id"
RECORDER: Final = "recorder"
START: Final = Path(__file__).resolve().with_name("sidestep_process.py")


def command(arguments: Sequence[str], parent: int) -> list[str]:
    """Return the command line for `sidestep ARGUMENTS`, valid in any working directory.

    The arguments begin with the short word of a verb, such as `robot` for `run robot`.
    """
    # -P keeps the folder of the script out of the path: its modules have names of their own.
    return [sys.executable, "-P", str(START), str(parent), *with_present_name(arguments)]


def main(arguments: Sequence[str]) -> int:
    """Run the verb given after the parent's process id; return the exit code."""
    parent, *verb = arguments
    if not die_with_parent(int(parent)):
        return 1
    set_process_name(role_of(verb))
    sys.argv[:] = ["sidestep", *verb]
    runpy.run_module("sidestep", run_name="__main__")  # run as the executable
    return 0


def role_of(arguments: Sequence[str]) -> str:
    """Return the role of a process, with its robot: `robot r1`, `recorder r1`, `plant`."""
    call = find(arguments)
    if call is None:
        return "sidestep"
    role = RECORDER if call.word == "record" else call.word
    at = call.arguments.index(ROBOT) + 1 if ROBOT in call.arguments else len(call.arguments)
    return " ".join([role, *call.arguments[at : at + 1]])


def set_process_name(name: str) -> None:
    """Set the name that `top` and `ps -e` show (Linux only)."""
    if sys.platform.startswith("linux"):
        text = name.encode("ascii", "replace")[:MAX_NAME]
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_NAME, text, 0, 0, 0)


def die_with_parent(parent: int) -> bool:
    """Request SIGKILL at the parent's death (Linux only); return False if the parent is gone."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    return os.getppid() == parent
