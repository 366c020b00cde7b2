"""`python -m checks.mutation.kernel`: check that unit tests take every branch of the kernel.

The unit tests of guard, failsafe, mode machine, lease, wheel-command validity, mailbox, codec and
stop datagram must take each branch of these modules, without any other test. The exit code is 1,
with a list of the missed branches, if they do not or if a test fails. The table of the mutated
modules, with the unit tests that must detect their mutants, is here, too.
"""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

import pytest
from coverage import Coverage

TARGETS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "robot/core/safety/guard.py": ("tests/unit/robot/core/test_guard.py",),
        "robot/core/safety/failsafe.py": (
            "tests/unit/robot/core/test_failsafe.py",
            "tests/unit/robot/core/test_place.py",
        ),
        "robot/core/modes.py": (
            "tests/unit/robot/core/test_modes.py",
            "tests/unit/robot/core/test_fence.py",
            "tests/unit/robot/core/test_place.py",
        ),
        "robot/core/place.py": ("tests/unit/robot/core/test_place.py",),
        "robot/core/perception/stall.py": ("tests/unit/robot/core/test_stall.py",),
        "robot/lease.py": ("tests/unit/robot/test_lease.py",),
        "robot/commands.py": (
            "tests/unit/robot/test_senses.py",
            "tests/unit/robot/test_commands.py",
            "tests/unit/robot/test_vehicle.py",
            "tests/unit/robot/test_lease.py",
        ),
        "robot/process.py": (
            "tests/unit/robot/test_process.py",
            "tests/unit/robot/test_process_stop.py",
            "tests/unit/robot/test_process_requests.py",
            "tests/unit/robot/test_scheduling.py",
        ),
        "robot/senses.py": (
            "tests/unit/robot/test_senses.py",
            "tests/unit/robot/test_process.py",
        ),
        "runtime/sequence.py": ("tests/unit/runtime/test_clock.py",),
        "robot/emergency_stop.py": ("tests/unit/robot/test_stop_latch.py",),
        "protocol/stop_datagram.py": ("tests/unit/protocol/test_stop_datagram.py",),
        "protocol/bus/mailbox.py": ("tests/unit/protocol/test_bus_mailbox.py",),
        "protocol/bus/robot_clock.py": ("tests/unit/protocol/test_bus_clock.py",),
        "plant/process/robot_link.py": ("tests/unit/plant/test_robot_link.py",),
        "protocol/wire/codec.py": ("tests/unit/protocol/test_wire_codec.py",),
    }
)
"""Source files with their tests, the module's own first."""


ROOT: Final = Path(__file__).resolve().parents[2]
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
