"""Carries out the operation of a parsed verb, until a signal ends it, and prints its outcome."""

import argparse
import asyncio
import signal
from collections.abc import Callable, Coroutine
from functools import partial
from types import FrameType
from typing import Any, Protocol, TypeVar, runtime_checkable

from ground.cli.options import common_of
from ground.client.connection import Common
from ground.client.floor import floor_of
from ground.client.lease_holder import operator_name
from ground.client.leases import Leasing
from ground.client.outcomes import Accepted, Operation, Outcome, Progress, Refused, RefusedError
from ground.client.robot_link import RobotLink, UnansweredError, call_soon, open_link
from ground.client.vocabulary import SHELL, Remedies
from ground.commands.command import OperatorCommand, Reach, command_in, parsed
from ground.robot import Robot
from ground.text.output import Output

T = TypeVar("T")


def run_until_signal(work: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine to its end; the first signal cancels it, and further ones are ignored.

    A handler that raises would interrupt the event loop itself. When all clean-up has ended, the
    signal goes to the handler from before, which raises.
    """
    received: list[int] = []
    cancel: Callable[[], object] = lambda: None  # noqa: E731

    async def program() -> T:
        nonlocal cancel
        task = asyncio.current_task()
        assert task is not None, "a loop runs coroutines in tasks"
        cancel = partial(call_soon, asyncio.get_running_loop(), task.cancel)
        if received:
            raise asyncio.CancelledError
        return await work()

    def note(number: int, _: FrameType | None) -> None:
        received.append(number)
        if len(received) == 1:
            cancel()

    kinds = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, note) for number in kinds}
    try:
        return asyncio.run(program())
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


Out = TypeVar("Out", bound=Outcome)


@runtime_checkable
class StopsAlone(Protocol):
    """A command that opens no session before it acts."""

    def perform_alone(self, common: Common) -> Outcome:
        """Carry it out by every way there is."""


class OnFiles(Protocol):
    """A command that needs no robot."""

    def run(self, progress: Progress) -> Outcome:
        """Carry it out."""


@runtime_checkable
class FromFile(Protocol):
    """A command whose values are in a file."""

    def read(self) -> Operation[Outcome]:
        """Read the file; UserError if its values are invalid."""


@runtime_checkable
class HasRecording(Protocol):
    """A command that can look at a recording instead."""

    def without_robot(self, reach: Reach) -> OnFiles | None:
        """Return the same for the newest recording, if no robot was named."""


@runtime_checkable
class ExplainsSilence(Protocol):
    """A command whose outcome says why nobody answers."""

    def not_connected(self, error: UnansweredError, endpoint: str) -> Outcome:
        """Return the outcome for a connection that failed."""


def run(options: argparse.Namespace, output: Output) -> int:
    """Carry out a verb; return 0 for success, 1 for failure.

    Values are checked before the program connects to a robot.
    """
    operation: Any = command_in(options)
    reach, verb = parsed(Reach, options), operation.verb
    if getattr(operation, "is_live", False) and not reach.json:
        from ground.cli.observe.live_line import follow

        return follow(common_of(reach, output))
    if operation.is_offline:
        return print_outcome(output, verb, "", operation.run(output))
    if isinstance(operation, FromFile):
        operation = operation.read()
    common = common_of(reach, output)
    if isinstance(operation, StopsAlone):
        return print_outcome(output, verb, common.robot, operation.perform_alone(common))
    try:
        with open_link(common) as link:
            robot = robot_of(link, output)
            outcome = run_until_signal(lambda: perform(operation, robot, seizes=reach.seize))
            effect = effect_of(operation, outcome, robot.remedies)
            return print_outcome(output, verb, robot.name, outcome, effect)
    except UnansweredError as error:
        if isinstance(operation, HasRecording) and (instead := operation.without_robot(reach)):
            output.note(f"no robot answers at {common.endpoint}: this is the newest recording")
            return print_outcome(output, verb, "", instead.run(output))
        if not isinstance(operation, ExplainsSilence):
            raise
        return print_outcome(
            output, verb, common.robot, operation.not_connected(error, common.endpoint)
        )


def robot_of(link: RobotLink, progress: Progress) -> Robot:
    """Return a robot that this program drives, and whose drives it follows."""
    return Robot(
        link.bus,
        link.common,
        operator_name(None),
        clock=link.clock,
        leasing=Leasing.DRIVES,
        progress=progress,
        floor=partial(floor_of, link.bus, link.name),
    )


async def perform(operation: Operation[Out], robot: Robot, *, seizes: bool = False) -> Out:
    """Carry out an operation; with `seizes` take the lease from another operator first.

    What is refused nevertheless leaves the lease: nothing came of it.
    """
    if not seizes:
        return await operation.perform(robot)
    seized = await robot.lease.seize()
    if not seized.ok:
        raise RefusedError(seized.text)
    outcome = await operation.perform(robot)
    if isinstance(outcome, Refused):
        await robot.lease.leave()
    return outcome


def effect_of(operation: object, outcome: Outcome, remedies: Remedies = SHELL) -> str:
    """Return what is so after an accepted command, such as `: motors armed`."""
    is_done = type(outcome) is Accepted and not (outcome.note or outcome.cause)
    if is_done and isinstance(operation, OperatorCommand) and operation.effect:
        return f": {remedies.addressed(operation.effect)}"
    return ""


def print_outcome(output: Output, verb: str, robot: str, outcome: Outcome, effect: str = "") -> int:
    """Print the outcome; a table that went to standard output is the result already.

    `effect` is added to the text for people.
    """
    if getattr(outcome, "is_printed", False):
        output.note(outcome.text)
    else:
        output.result(outcome.as_json(verb, robot), outcome.text + effect)
    return 0 if outcome.ok else 1
