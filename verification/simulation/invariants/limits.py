"""The limits that the invariants hold the stack to, in one table, and what each is made of.

A limit is the sum of what the design allows, worst case each; nothing is added for comfort.
"""

from typing import Final

from runtime.units import NS_PER_MS

PERIOD_NS: Final = 50 * NS_PER_MS
TTL_NS: Final = 150 * NS_PER_MS
LINK_NS: Final = 1 * NS_PER_MS
"""Way of a frame on a sound network (0.3 ms), there and back."""

STILL_M_S: Final = 0.01
"""Rim speed of a wheel that stands: what is left of 0.3 m/s after three time constants."""

BRAKE_NS: Final = 38 * NS_PER_MS
"""The driver's brake from 0.3 m/s at 8 m/s^2."""

RAMP_NS: Final = 250 * NS_PER_MS
"""Braking by a command of zero speed: 0.3 to 0.075 m/s at 1.5 m/s^2 take 150 ms, the motor's lag
of 50 ms takes another 100 ms down to 0.01 m/s."""

SILENT_STOP_NS: Final = TTL_NS + BRAKE_NS
"""From the tick that the last command answers, when no other one follows, to wheels that stand."""

COMMAND_STOP_NS: Final = TTL_NS + RAMP_NS
"""From the tick that the last command to move answers. The latest command of zero speed that counts
is obeyed when the time to live of that one ends, and then begins to brake."""

TICK_NS: Final = PERIOD_NS + PERIOD_NS // 4
"""The longest that an undisturbed robot takes from one tick to the next: its grid waits a quarter
of a period for a scan."""

DISARMED_STOP_NS: Final = TICK_NS + COMMAND_STOP_NS
"""From the last tick in which the robot was armed: its command may answer that tick."""

STOP_NS: Final = LINK_NS + TICK_NS + PERIOD_NS + BRAKE_NS
"""From the press of an emergency stop on a sound network: the way there, the robot's next tick, the
plant's next period, and the driver's brake."""

FAILSAFE_STOP_NS: Final = TICK_NS + PERIOD_NS + BRAKE_NS
"""From the limit of a failsafe to wheels that stand: the robot's next tick, the plant's next
period, and the driver's brake."""

ACKNOWLEDGED_STOP_NS: Final = PERIOD_NS + BRAKE_NS
"""From a stop that its operator was told of: the status leaves right after the brake."""

LOST_BRAKE_NS: Final = TTL_NS + BRAKE_NS
"""The same when the brake was lost: the last command to move expires."""

BRAKED_NS: Final = COMMAND_STOP_NS + TICK_NS
"""After so long of commands to stand no forged command turns the wheels: it contradicts them."""

BOOT_NS: Final = 300 * NS_PER_MS
"""A robot that was started serves within this time."""

ROUNDING_NS: Final = 5 * NS_PER_MS
"""Ages are whole milliseconds, and the clock of a robot is known within the way of a frame."""

STEERED_NS: Final = RAMP_NS
"""After a frame of teleop has expired the robot slows down at its own limit of acceleration."""

LAPSE_NS: Final = 3_000 * NS_PER_MS + TICK_NS
"""After so long without a heartbeat of its holder the lease is free: 3 s, and one tick."""

GIVEN_UP_NS: Final = 500 * NS_PER_MS
"""A request of an operator whose process has ended counts for the rest of its attempt."""

FENCE_M: Final = 0.12
"""So far outside the fence the middle of the robot may move: 0.3 m/s for one tick until it is
seen (62 ms), one more until the plant obeys (50 ms), and the way of braking (0.04 m), with the
error of the odometry of a run (some millimetres), 0.3 * 0.112 + 0.04 = 0.08, and 0.04 for senses
that are late by up to their time to live."""

TICK_GAP_NS: Final = 2 * TICK_NS - 1 * NS_PER_MS
"""Between two ticks of a loop that nothing disturbs: a frame that comes late and one early."""

BACKLOG: Final = 64
"""Requests that wait in one line."""

STANDSTILL_NS: Final = 12_000 * NS_PER_MS
"""A goal that is being driven to ends as STUCK after 10 s without motion, a tick is 50 ms; the
rest is for a robot that turns on the spot."""

CALM_NS: Final = 3_000 * NS_PER_MS
"""After so long with nothing wrong everything that was late or is remembered is over."""
