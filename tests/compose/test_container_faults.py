"""Containers paused, killed and cut off while the robot drives: its wheels stop, and stay so.

What is seen is seen at the router, by its address on the network of the containers.
"""

from collections.abc import Iterator
from itertools import cycle

import pytest

from protocol.enums import GoalState, Vehicle
from protocol.reasons import Reason
from tests.compose.compose import Compose, docker
from tests.stack.processes import Witness, moved_not, until

pytestmark = pytest.mark.compose

MS = 1_000_000
PERIOD_MS = 50
PLACES = cycle((("5.4", "3.0"), ("0.6", "2.0")))
LOST = (Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.BUDGET)


@pytest.fixture
def witness(stack: Compose) -> Iterator[Witness]:
    """The robot is on its way, without an operator: nobody but the fault stops it."""
    networks = stack.inspected("router")["NetworkSettings"]["Networks"]
    address = networks[stack.network()]["IPAddress"]
    with Witness(f"tcp/{address}:7447") as found:
        done = stack.verb("goto", *next(PLACES), "--no-wait")
        assert done.code == 0, done.said
        found.driving()
        yield found


def stood_in_time(witness: Witness) -> None:
    """Counted from the last that was heard of the robot: when exactly docker acts is not known."""
    until(witness.standing, what="standing")
    heard_ns = max(at_ns for status, at_ns in tuple(witness.statuses) if drives(status.vehicle))
    before_ns, still_ns = witness.stopped_at_ns(heard_ns)
    assert (still_ns - before_ns) / MS <= 200 + 2 * PERIOD_MS


def drives(vehicle: int) -> bool:
    return vehicle == Vehicle.ACTIVE


def stays(witness: Witness, *reasons: Reason) -> None:
    """What had failed is back: the robot stands on and says why; BOOT is one that began anew."""
    told, heard = len(witness.statuses), len(witness.truths)
    until(lambda: len(witness.statuses) > told + 20 and len(witness.truths) > heard + 20, 30.0)
    assert not drives(witness.status.vehicle)
    assert witness.status.goal in (GoalState.ABORTED, GoalState.NONE)
    if reasons:
        assert Reason(witness.status.vehicle_reason) in reasons
    assert all(moved_not(truth) for truth, _ in tuple(witness.truths)[-10:])


def test_a_robot_that_is_paused(stack: Compose, witness: Witness) -> None:
    docker("pause", stack.container("robot"))
    stood_in_time(witness)
    docker("unpause", stack.container("robot"))
    stays(witness, *LOST)


def test_a_robot_whose_network_is_cut(stack: Compose, witness: Witness) -> None:
    docker("network", "disconnect", stack.network(), stack.container("robot"))
    stood_in_time(witness)
    docker("network", "connect", "--alias", "robot", stack.network(), stack.container("robot"))
    stays(witness, *LOST)


def test_a_robot_that_is_killed(stack: Compose, witness: Witness) -> None:
    docker("kill", stack.container("robot"))
    stood_in_time(witness)
    docker("start", stack.container("robot"))
    stays(witness)
    assert witness.status.vehicle == Vehicle.STANDBY


def test_a_plant_whose_network_is_cut(stack: Compose, witness: Witness) -> None:
    docker("network", "disconnect", stack.network(), stack.container("plant"))
    until(lambda: witness.status.vehicle == Vehicle.FAILSAFE, what="FAILSAFE")
    assert Reason(witness.status.vehicle_reason) in LOST
    docker("network", "connect", "--alias", "plant", stack.network(), stack.container("plant"))
    stays(witness, *LOST)


def test_a_router_that_is_paused(stack: Compose, witness: Witness) -> None:
    docker("pause", stack.container("router"))
    docker("unpause", stack.container("router"))
    until(lambda: not drives(witness.status.vehicle) and witness.standing(), 30.0, "standing")
    stays(witness, *LOST)
