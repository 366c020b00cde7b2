"""Bad links over the whole stack in simulated time: late frames are ignored."""

import pytest

from protocol.bus.link_faults import LinkFaults
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.harness import Stack

STOPPING_S = 0.40


def under_way(stack: Stack) -> None:
    stack.forward(0.5)
    stack.arm()
    stack.goto_goal()
    stack.until(stack.driving)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    "trouble",
    [
        LinkFaults(loss=0.05),
        LinkFaults(loss=0.01),
        LinkFaults(reorder=0.3),
        LinkFaults(duplicate=0.3),
        LinkFaults(delay_ms=50),
    ],
    ids=["5 % lost", "1 % lost", "30 % swapped", "30 % doubled", "50 ms late"],
)
def test_a_slightly_bad_link_does_not_keep_it_from_its_goal(trouble: LinkFaults) -> None:
    with Stack("box", noise="default") as stack:
        under_way(stack)
        for name in ("robot", "plant"):
            stack.buses[name].faults.disturb(trouble)
        stack.until(stack.reached)
        stack.assert_near(5.4, 2.0, within_m=0.2)
        assert stack.truth.contact == 0


@each("delay_ms", [300, 500])
def test_very_late_sensor_frames_count_as_lost(delay_ms: int) -> None:
    with Stack("corridor", noise="default") as stack:
        under_way(stack)
        stack.buses["robot"].faults.disturb(LinkFaults(delay_ms=delay_ms, paths=("sense/",)))
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=1.0)
        assert noticed_s <= 0.25 + 1e-9
        assert stack.why == Reason.TICKS_LOST
        stack.forward(STOPPING_S)
        assert stack.standing()


def test_reordered_scan_does_not_replace_a_newer_one() -> None:
    with Stack("open") as stack:
        under_way(stack)
        stack.buses["robot"].faults.disturb(LinkFaults(jitter_ms=140, paths=("sense/",)))
        stack.forward(0.05)
        heard = []
        for _ in range(60):
            stack.forward(0.05)
            heard.append(stack.senses_used)
        assert heard == sorted(heard), "it never goes back to what it knew before"


def test_late_or_repeated_commands_do_not_keep_wheels_turning() -> None:
    with Stack("open") as stack:
        under_way(stack)
        late = LinkFaults(delay_ms=100, duplicate=1.0, jitter_ms=100)
        stack.buses["plant"].faults.disturb(late)
        stack.forward(0.5)
        stack.kill("robot")
        assert stack.until(stack.standing, within_s=1.0) <= 0.2 + 1e-9
