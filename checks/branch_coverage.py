"""`python -m checks.branch_coverage`: check that unit tests take every branch of the kernel.

The unit tests of guard, failsafe, mode machine, lease, wheel-command validity, mailbox, codec and
stop datagram must take each branch of these modules, without any other test. The exit code is 1,
with a list of the missed branches, if they do not or if a test fails.
"""

import os
import sys
from pathlib import Path
from typing import Final

import pytest
from coverage import Coverage

from checks.mutation.targets import TARGETS

ROOT: Final = Path(__file__).resolve().parents[1]
KERNEL: Final = (
    "robot/core/safety/guard.py",
    "robot/core/safety/failsafe.py",
    "robot/core/modes.py",
    "robot/lease.py",
    "plant/process/robot_link.py",
    "protocol/bus/mailbox.py",
    "protocol/wire/codec.py",
    "protocol/stop_datagram.py",
)
"""Modules whose mutation tests must take each of their branches."""

OPTIONS: Final = ("-q", "-p", "no:xdist", "-p", "no:cov", "-m", "not hypothesis")
"""Properties are left out: the written examples alone must take every branch."""


def main() -> int:
    """Run the tests with coverage and return the exit code."""
    os.chdir(ROOT)
    tests = dict.fromkeys(test for module in KERNEL for test in TARGETS[module])
    coverage = Coverage(data_file=None, branch=True, include=[*KERNEL], config_file=False)
    with coverage.collect():
        failed = pytest.main([*OPTIONS, *tests])
    return int(failed) or int(coverage.report(show_missing=True) < 100.0)


if __name__ == "__main__":
    sys.exit(main())
