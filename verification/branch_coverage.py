"""`python -m verification.branch_coverage`: every branch of the safety kernel, by its unit tests.

The unit tests of guard, failsafe, mode machine, lease, the plant's judgement of wheel commands,
mailbox and codec take each branch of these modules, without any other test. Ends with 1, and prints
what is missed, if they do not, or if one fails.
"""

import os
import sys
from pathlib import Path
from typing import Final

import pytest
from coverage import Coverage

from verification.mutation.targets import TARGETS

ROOT: Final = Path(__file__).resolve().parents[1]
KERNEL: Final = (
    "robot/core/safety/guard.py",
    "robot/core/safety/failsafe.py",
    "robot/core/modes.py",
    "robot/core/machine.py",
    "robot/lease.py",
    "plant/process/command_gate.py",
    "plant/process/robot_link.py",
    "protocol/bus/mailbox.py",
    "protocol/wire/codec.py",
)
"""Each with the tests of its mutants, which must take each of its branches."""

OPTIONS: Final = ("-q", "-p", "no:xdist", "-p", "no:cov", "-m", "not hypothesis")
"""Without properties: examples that are written down reach every branch by themselves."""


def main() -> int:
    os.chdir(ROOT)
    tests = dict.fromkeys(test for module in KERNEL for test in TARGETS[module])
    coverage = Coverage(data_file=None, branch=True, include=[*KERNEL], config_file=False)
    with coverage.collect():
        failed = pytest.main([*OPTIONS, *tests])
    return int(failed) or int(coverage.report(show_missing=True) < 100.0)


if __name__ == "__main__":
    sys.exit(main())
