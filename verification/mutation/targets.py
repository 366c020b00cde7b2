"""Which modules are mutated, and the unit tests that must notice it."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

CORE: Final = "tests/unit/core"
ROBOT: Final = "tests/unit/robot"
PLANT: Final = "tests/unit/plant"
PROTOCOL: Final = "tests/unit/protocol"

TARGETS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "robot/core/safety/guard.py": (f"{CORE}/test_guard.py",),
        "robot/core/safety/failsafe.py": (f"{CORE}/test_failsafe.py",),
        "robot/core/machine.py": (f"{CORE}/test_machine.py",),
        "robot/core/modes.py": (
            f"{CORE}/test_modes_in_detail.py",
            f"{CORE}/test_modes.py",
            f"{CORE}/test_fence.py",
            f"{CORE}/test_lost_fence.py",
        ),
        "robot/core/perception/stall.py": (f"{CORE}/test_stall.py", f"{CORE}/test_watches.py"),
        "robot/lease.py": (f"{ROBOT}/test_lease.py",),
        "robot/teleop.py": (f"{ROBOT}/test_teleop.py",),
        "robot/commands.py": (f"{ROBOT}/test_commands.py", f"{ROBOT}/test_vehicle.py"),
        "robot/process.py": (f"{ROBOT}/test_process.py",),
        "robot/senses.py": (
            f"{ROBOT}/test_read_senses.py",
            f"{ROBOT}/test_stamps.py",
            f"{ROBOT}/test_ages.py",
            f"{ROBOT}/test_displaced.py",
            f"{ROBOT}/test_process.py",
        ),
        "robot/scheduling/cycle_meter.py": (f"{ROBOT}/test_meter.py",),
        "robot/stop_latch.py": (f"{ROBOT}/test_stop_latch.py",),
        "robot/operator_delays.py": (f"{ROBOT}/test_delays.py",),
        "protocol/bus/mailbox.py": (f"{PROTOCOL}/test_mailbox.py",),
        "protocol/bus/robot_clock.py": (f"{PROTOCOL}/test_robot_clock.py",),
        "plant/process/command_gate.py": (f"{PLANT}/test_command_gate.py",),
    }
)
"""Source files with their tests, the module's own first."""
