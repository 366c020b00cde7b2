"""The budget of each stage of a control cycle: time on the host, share on the LPC1768."""

from typing import Final, NamedTuple

PERIOD_MS: Final = 50

READ: Final = 0
ODOMETRY: Final = 1
NAVIGATE: Final = 2
GUARD: Final = 3
WRITE: Final = 4

Stage = NamedTuple("Stage", [("name", str), ("host_us", int), ("mcu_percent", int)])

STAGES: Final = (
    Stage("read", 800, 4),
    Stage("odometry", 100, 6),
    Stage("navigate", 200, 20),
    Stage("guard", 100, 4),
    Stage("write", 1300, 4),
)
"""In the order of the cycle: 5 % of the period on the host, less than half of it on the MCU."""

TICK_US: Final = sum([stage.host_us for stage in STAGES])
