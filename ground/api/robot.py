"""The Python API: an asyncio client of one robot.

    async with sidestep.connect() as robot:
        outcome = await robot.goto(5.4, 2.0)

All values are checked before a request is sent: UserError names one that is out of range. A refusal
is a value (`Refused`), not an exception; `sidestep.agreed(outcome)` raises it as RefusedError.
UnansweredError, a RemoteError, names the process that is missing.

The event loop sends the operator's heartbeat. A program that blocks its event loop sends none, so
the robot stops by itself after its `op_lost_ms`, by default 1.5 s.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from inspect import iscoroutinefunction
from pathlib import Path
from typing import Any, Final, TypeVar

from ground import robot as client
from ground.api.services import Fences, Leases, Missions
from ground.client.connection import Common, common
from ground.client.lease_holder import operator_name
from ground.client.link import Link, UnansweredError, open_link
from ground.client.outcomes import Outcome, Refused
from ground.client.robot_link import finish
from ground.client.session import Operation, Session
from ground.client.vocabulary import PYTHON
from ground.commands.goto import Goto
from ground.commands.mission import JumpTo
from protocol.bus.bus import Bus

Out = TypeVar("Out", bound=Outcome)
BEGINNINGS: Final = (Goto, JumpTo)
"""Operations that begin a drive, and have not moved to the robot yet."""


@asynccontextmanager
async def connect(
    endpoint: str | None = None,
    *,
    robot: str | None = None,
    config: str | Path | None = None,
    name: str | None = None,
) -> AsyncIterator["Robot"]:
    """Connect to a robot; give its lease back when the context ends.

    `endpoint` is where the robot or its router listens (that of the only `sidestep up` that runs
    here, else tcp/127.0.0.1:7447), `robot` its name (r1),
    `config` a file as for `--config`, `name` the name shown to other operators (user@host:tty).

    Raises UserError for an invalid value, UnansweredError if no process listens at the endpoint.
    """
    where, operator = common(endpoint, robot, config, remedies=PYTHON), operator_name(name)
    async with AsyncExitStack() as stack:
        link_opened = open_link(where)
        try:
            link = await asyncio.to_thread(link_opened.__enter__)
        except UnansweredError as error:  # its text says all: no traceback of threads and the bus
            raise error.with_traceback(None) from None
        stack.push_async_callback(asyncio.to_thread, link_opened.__exit__, None, None, None)
        client = Robot(link.bus, where, operator)
        try:
            await client.open()
            yield client
        finally:
            await finish(client.close())


class Robot(client.Robot):
    """One robot, with this program as its operator; created by `connect`.

    Operations that can move the robot take its lease first. If another person holds it they return
    `Refused` with that operator's name. All programs of one user on one computer share the lease;
    each sends its own heartbeat. The robot takes it back when nothing has been driven for 30 s, and
    the next operation takes it again.

    At the end of the context the drives of this program end: the robot stops. Then every method
    raises ClosedError.
    """

    def __init__(self, bus: Bus, common: Common, operator: str) -> None:
        super().__init__(bus, common, operator)
        self.mission = Missions(self)
        self.fence = Fences(self)
        self.lease = Leases(self)

    async def perform(self, operation: Operation[Out]) -> Out | Refused:
        """Carry out any operation of `sidestep.operations`; take the lease first if it moves.

        Cancelling this does not withdraw a request that was sent.
        """
        on: Any = self
        if iscoroutinefunction(operation.perform):
            found: Out | Refused = await operation.perform(on)
            return found
        if operation.moves and (refused := await self.ensure_lease()) is not None:
            return refused
        self.check_open()
        on = Session(Link(self.bus, self._common, self.clock), attended=True)
        job = partial(self.in_own_thread, partial(operation.perform, on))
        gate = self._turn if isinstance(operation, BEGINNINGS) else self._slots
        performed: Any = await self._uninterrupted(gate, job)
        done: Out = performed
        return done
