"""`python -m verification.branch_coverage`: every branch of the safety kernel, by its unit tests.

The unit tests of guard, failsafe, modes, machine, lease and codec take each branch of these
modules, without any other test. Ends with 1, and prints what is missed, if they do not, or if one
fails.
"""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
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
)
TESTS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {module: TARGETS[module] for module in KERNEL}
    | {"protocol/wire/codec.py": ("tests/unit/protocol/wire/test_codec.py",)}
)
"""Modules with the tests that must take each of their branches."""

OPTIONS: Final = (
    *("-q", "-p", "no:xdist", "-p", "no:cov"),
    *("-m", "not hypothesis", "-k", "not pymavlink"),
)
"""Without properties: examples that are written down reach every branch by themselves."""


def main() -> int:
    os.chdir(ROOT)
    tests = dict.fromkeys(test for tests in TESTS.values() for test in tests)
    coverage = Coverage(data_file=None, branch=True, include=[*TESTS], config_file=False)
    with coverage.collect():
        failed = pytest.main([*OPTIONS, *tests])
    return int(failed) or int(coverage.report(show_missing=True) < 100.0)


if __name__ == "__main__":
    sys.exit(main())
