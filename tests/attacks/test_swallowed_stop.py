"""Attacks on the emergency stop: it is neither swallowed nor crowded out, nor acknowledged falsely.

The operator presses the stop of the app, `EmergencyStop`, while somebody else floods the robot.
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
GIVE_UP_NS = 10_000_000_000
OWN = "open/fedcba9876543210"
GOOD_NS = 5_000_000_000


def drives(stack: Stack) -> None:
    stack.arm()
    stack.goto_goal()
    stack.until(stack.driving)


def press(stack: Stack) -> StopOutcome:
    """As the app does, in a thread, while the robot's loop goes round."""
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


def test_a_stop_under_the_id_of_a_command_that_was_answered_stops() -> None:
    """A1: the answer to another's request, or to another request, was the answer to the stop."""
    with attacked() as (stack, attacker):
        heard = attacker.listen(COMMANDED)
        drives(stack)
        until(lambda: ids_in(heard))
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


def test_the_apps_stop_is_not_answered_with_what_another_asked() -> None:
    """A1, by the app: its request has an id that nobody can have used before."""
    with attacked() as (stack, attacker):
        heard = attacker.listen(COMMANDED)
        drives(stack)
        until(lambda: ids_in(heard))
        good_ns = stack.clock.now_ns() + GOOD_NS
        occupied = {number + ahead for number in ids_in(heard) for ahead in range(1, 9)}
        replies = [
            attacker.ask(order(number, Command.DO_PAUSE_CONTINUE, 1.0), good_ns)
            for number in occupied
        ]
        answered(stack, *replies)
        assert press(stack).acknowledged
        assert stopped(stack)


def test_another_request_under_a_known_id_is_refused_and_not_answered_as_the_first() -> None:
    """A1: replies are bound to who asked, and to what."""
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
    """More of everything than any line holds."""
    good_ns = stack.clock.now_ns() + GOOD_NS
    replies = []
    for number in range(2 * MAX_WAITING):
        request = order(number, Command.DO_PAUSE_CONTINUE, 1.0)
        replies += [attacker.ask(request, good_ns, name=name) for name in (EVE, OWN)]
        take = LeaseRequest(request_id=number, action=LeaseAction.TAKE, name="eve")
        replies.append(attacker.ask(take, good_ns, LEASE_SERVICE))
    return replies


def test_the_apps_stop_is_acknowledged_while_all_lines_are_full() -> None:
    """A2: one "too many requests" was the end of the operator's stop."""
    with attacked() as (stack, attacker):
        drives(stack)
        flooded(attacker, stack)
        outcome = press(stack)
        assert outcome.acknowledged, outcome
        assert stopped(stack)
        assert stack.until(stack.standing, within_s=2.0) <= STANDS_S


def test_the_apps_stop_is_acknowledged_in_a_flood_of_stops() -> None:
    """A2: the line of stops could be filled with stops that were none."""
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


def test_whoever_asks_for_a_stop_is_told_yes_and_the_robot_stands() -> None:
    """A2: told no and done yes, or told yes and not done: neither."""
    with attacked() as (stack, attacker):
        drives(stack)
        stop = order(1, Command.DO_FLIGHTTERMINATION, 1.0)
        replies = [attacker.ask(stop, None, STOP_SERVICE) for _ in range(5)]
        answered(stack, *replies)
        assert {reply.reason for reply in replies} == {Reason.NONE}
        assert stopped(stack)
