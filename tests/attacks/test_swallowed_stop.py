"""Attacks on the emergency stop: it is not lost, not delayed, and not acknowledged falsely.

The operator presses the stop of the app, `EmergencyStop`, while an attacker floods the robot.
"""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from ground.client.emergency_stop import EmergencyStop, StopOutcome
from protocol.topics import COMMAND, COMMANDED, LEASE_SERVICE, STOP, STOP_SERVICE
from protocol.wire.enums import Command, LeaseAction, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, LeaseRequest
from protocol.wire.reasons import Reason
from robot.process import MAX_WAITING
from runtime.clock import WallClock
from tests.support.attacks.attacker import EVE, Attacker, Reply, answered, attacked, order
from tests.support.harness import Stack
from tests.support.until import PATIENCE_S, until

STANDS_S = 0.2
GIVE_UP_NS = 60_000_000_000
OWN = "open/fedcba9876543210"
GOOD_NS = 5_000_000_000


def drives(stack: Stack) -> None:
    stack.arm()
    stack.goto_goal()
    stack.until(stack.driving)


def press(stack: Stack) -> StopOutcome:
    """Press the stop as the app does, in a thread, while the robot's loop runs."""
    publisher = stack.ground.publisher(STOP)
    assert stack.ground.await_matched([publisher], PATIENCE_S) == []
    stop = EmergencyStop(
        stack.ground,
        publisher,
        "r1",
        WallClock(),
        lambda: (stack.status, WallClock().now_ns()),
    )
    with ThreadPoolExecutor(1) as pool:
        pressed: Future[StopOutcome] = pool.submit(stop.run, give_up_ns=GIVE_UP_NS)
        until(lambda: stack.robot is not None and stop.tries > 0)
        while not pressed.done():
            stack.cycle()
        return pressed.result()


def stopped(stack: Stack) -> bool:
    return stack.state == Vehicle.EMERGENCY_STOP


def ids_in(heard: Sequence[Message]) -> list[int]:
    return [one.request_id for one in heard if isinstance(one, CommandRequest)]


def armed_again(stack: Stack) -> bool:
    """Repeat a command: the subscription of the attacker may have come after the first ones."""
    stack.arm()
    return False


def test_stop_with_the_id_of_an_answered_command_stops() -> None:
    """A1: the stop got the answer of another operator's request, or of another request."""
    with attacked() as (stack, attacker):
        heard = attacker.listen(COMMANDED)
        drives(stack)
        until(lambda: ids_in(heard) or armed_again(stack))
        newest = ids_in(heard)[-1]
        good_ns = stack.clock.now_ns() + GOOD_NS
        occupied = range(newest, newest + 6)
        replies = [
            attacker.ask(order(number, Command.DO_PAUSE_CONTINUE, 1.0), good_ns)
            for number in occupied
        ]
        answered(stack, *replies)
        stop = attacker.ask(order(newest + 1, Command.DO_FLIGHTTERMINATION, 1.0), good_ns)
        answered(stack, stop)
        assert stop.reason == Reason.NONE
        assert stopped(stack)
        assert stack.until(stack.standing, within_s=2.0) <= STANDS_S


def test_stop_of_the_app_gets_its_own_answer() -> None:
    """A1 with the app: its request has an id that no other sender can have used before."""
    with attacked() as (stack, attacker):
        heard = attacker.listen(COMMANDED)
        drives(stack)
        until(lambda: ids_in(heard) or armed_again(stack))
        good_ns = stack.clock.now_ns() + GOOD_NS
        occupied = {number + ahead for number in ids_in(heard) for ahead in range(1, 9)}
        replies = [
            attacker.ask(order(number, Command.DO_PAUSE_CONTINUE, 1.0), good_ns)
            for number in occupied
        ]
        answered(stack, *replies)
        assert press(stack).acknowledged
        assert stopped(stack)


def test_other_request_with_a_known_id_is_refused() -> None:
    """A1: answers are bound to operator and request."""
    with attacked() as (stack, attacker):
        good_ns = stack.clock.now_ns() + GOOD_NS
        first = attacker.ask(order(7, Command.COMPONENT_ARM_DISARM, 1.0), good_ns)
        answered(stack, first)
        other = attacker.ask(order(7, Command.COMPONENT_ARM_DISARM, 0.0), good_ns)
        same = attacker.ask(order(7, Command.COMPONENT_ARM_DISARM, 1.0), good_ns)
        anothers = attacker.ask(order(7, Command.DO_PAUSE_CONTINUE, 0.0), good_ns, name=OWN)
        answered(stack, other, same, anothers)
        assert (first.reason, other.reason, same.reason) == (
            Reason.NONE,
            Reason.ID_REUSED,
            Reason.NONE,
        )
        assert anothers.reason != Reason.ID_REUSED
        assert stack.state == Vehicle.ACTIVE


def flooded(attacker: Attacker, stack: Stack) -> list[Reply]:
    """Send more of everything than any queue holds."""
    good_ns = stack.clock.now_ns() + GOOD_NS
    replies = []
    for number in range(2 * MAX_WAITING):
        request = order(number, Command.DO_PAUSE_CONTINUE, 1.0)
        replies += [attacker.ask(request, good_ns, name=name) for name in (EVE, OWN)]
        take = LeaseRequest(request_id=number, action=LeaseAction.TAKE, name="eve")
        replies.append(attacker.ask(take, good_ns, LEASE_SERVICE))
    return replies


def test_stop_of_the_app_is_acknowledged_with_full_queues() -> None:
    """A2: one answer "too many requests" ended the operator's stop."""
    with attacked() as (stack, attacker):
        drives(stack)
        flooded(attacker, stack)
        outcome = press(stack)
        assert outcome.acknowledged, outcome
        assert stopped(stack)
        assert stack.until(stack.standing, within_s=2.0) <= STANDS_S


def test_stop_of_the_app_is_acknowledged_in_a_flood_of_stops() -> None:
    """A2: frames that were no stops could fill the queue of stops."""
    with attacked() as (stack, attacker):
        drives(stack)
        for number in range(2 * MAX_WAITING):
            stop = order(number % 5, Command.DO_FLIGHTTERMINATION, 1.0)
            for service in (STOP_SERVICE, COMMAND):
                attacker.ask(stop, None, service)
            attacker.put(STOP, stop)
            attacker.put(STOP, b"no stop at all")
        outcome = press(stack)
        assert outcome.acknowledged, outcome
        assert stopped(stack)
        assert stack.until(stack.standing, within_s=2.0) <= STANDS_S


def test_every_stop_request_is_accepted_and_stops_the_robot() -> None:
    """A2: neither a refusal of an executed stop, nor an acknowledgement without a stop."""
    with attacked() as (stack, attacker):
        drives(stack)
        stop = order(1, Command.DO_FLIGHTTERMINATION, 1.0)
        replies = [attacker.ask(stop, None, STOP_SERVICE) for _ in range(5)]
        answered(stack, *replies)
        assert {reply.reason for reply in replies} == {Reason.NONE}
        assert stopped(stack)
