"""Containers paused, killed and cut off while the robot drives: its wheels stop, and stay so.

What is seen is seen at the router, by its address on the network of the containers.
"""

from collections.abc import Iterator
from contextlib import suppress
from math import hypot
from time import monotonic_ns

import pytest

from protocol.topics import COMMAND
from protocol.wire.enums import Command, GoalState, Mode, Vehicle
from protocol.wire.goal import wire_goal
from protocol.wire.messages import CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from runtime.errors import NoAnswerError
from tests.support.compose.compose import Compose, docker
from tests.support.stack.processes import Witness, moved_not
from tests.support.until import until

pytestmark = pytest.mark.compose

MS = 1_000_000
PERIOD_MS = 50
SILENCE_MS = 500
PLACES = ((5.4, 3.2), (0.6, 2.0))
FAST_M_S = 0.25
LIVING = range(GoalState.ACCEPTED, GoalState.ALIGNING + 1)
LOST = (Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.BUDGET)


@pytest.fixture
def witness(stack: Compose) -> Iterator[Witness]:
    """Observe a robot that drives without an operator, so that only the fault stops it."""
    networks = stack.inspected("router")["NetworkSettings"]["Networks"]
    address = networks[stack.network()]["IPAddress"]
    with Witness(f"tcp/{address}:7447") as found:
        until(lambda: found.truths and found.statuses, what="what plant and robot say")
        set_off(found)
        yield found


def set_off(witness: Witness) -> None:
    """Armed, in AUTO, fast, to the place that is farther away: again and again, for a busy machine
    may stop it with a failsafe."""
    here = witness.truth
    x_m, y_m = max(PLACES, key=lambda place: hypot(place[0] - here.x_m, place[1] - here.y_m))
    goal = wire_goal(x_m, y_m, None, 0.1, 0.1)._asdict()

    def under_way() -> bool:
        if not drives(witness.status.vehicle) or witness.status.goal not in LIVING:
            number = monotonic_ns()
            for request in (
                *commands(number, witness),
                GoalRequest(request_id=number + 2, mode=Mode.AUTO, **goal),
            ):
                with suppress(NoAnswerError):
                    witness.bus.ask(COMMAND, request)
        return witness.truth.speed_m_s > FAST_M_S

    until(under_way, 60.0, "driving")


def commands(number: int, witness: Witness) -> tuple[CommandRequest, CommandRequest]:
    """Return the true pose, which a robot that was restarted has lost, and the order to arm."""
    true = witness.truth
    return (
        CommandRequest(
            request_id=number,
            param1=true.x_m,
            param2=true.y_m,
            param3=true.heading_rad,
            command=Command.SIDESTEP_SET_POSE,
        ),
        CommandRequest(
            request_id=number + 1, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM
        ),
    )


def stood_in_time(witness: Witness) -> None:
    """Count from the last command to move: when exactly docker acts is unknown."""
    until(witness.standing, what="standing")
    assert witness.rolled_on_ms() <= 200 + PERIOD_MS


def drives(vehicle: int) -> bool:
    return vehicle == Vehicle.ACTIVE


def stays(witness: Witness, *reasons: Reason) -> None:
    """Require that the robot stays stopped and gives the reason after the failed part is back."""
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
    until(lambda: monotonic_ns() - witness.truths[-1][1] > SILENCE_MS * MS, what="silence")
    docker("unpause", stack.container("router"))
    until(lambda: not drives(witness.status.vehicle) and witness.standing(), 30.0, "standing")
    stays(witness, *LOST)
