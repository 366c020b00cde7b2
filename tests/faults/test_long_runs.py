"""32-bit counters wrap: a robot drives across the wrap without a change."""

from runtime.clock import ManualClock
from runtime.units import PERIOD_NS
from tests.support.each import each
from tests.support.harness import Stack

MS_NS = 1_000_000
FULL_NS = {"milliseconds": (1 << 32) * MS_NS, "ticks": (1 << 32) * PERIOD_NS}
"""After 49.7 days, which are 10 hours of the fastest lockstep, and after 6.8 years."""


@each("what", FULL_NS)
def test_a_robot_drives_on_when_a_count_is_full(what: str) -> None:
    stack = Stack("open")
    stack.clock = ManualClock(FULL_NS[what] // PERIOD_NS * PERIOD_NS - 60 * PERIOD_NS)
    with stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving, within_s=3.0)
        stack.forward(3.0)
        assert stack.clock.now_ns() > FULL_NS[what]
        stack.until(stack.reached, within_s=60.0)
        stack.assert_near(stack.world.goal.x_m, stack.world.goal.y_m)
