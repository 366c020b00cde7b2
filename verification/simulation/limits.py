"""The limits that the invariants hold the stack to, in one table."""

from typing import Final

MS: Final = 1_000_000

STILL_M_S: Final = 0.01
"""Rim speed of a wheel that stands."""

PERIOD_NS: Final = 50 * MS
TTL_NS: Final = 150 * MS

COMMAND_STOP_NS: Final = 400 * MS
"""From the tick that the last command to move answers to wheels that stand: the rest of its time to
live (150 ms), one period of the plant, and braking from 0.3 m/s by command at 1.5 m/s^2 with a lag
of 50 ms."""

STOP_NS: Final = 550 * MS
"""From the press of an emergency stop on a sound network to wheels that stand: one tick of the
robot, and the way above."""

OPERATOR_SLACK_NS: Final = 300 * MS
"""On top of `op_lost_ms` since the last heartbeat was sent: the network and one tick."""

LATE_REQUEST_NS: Final = 300 * MS
"""A request may be acted on for so long after its operator has given up."""

FENCE_M: Final = 0.20
"""So far outside the middle of the robot may come to stand: one tick, the stop and its braking."""

TICK_GAP_NS: Final = 120 * MS
"""Between two ticks of a loop that nothing disturbs."""
