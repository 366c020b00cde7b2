"""An operator for programs that wait by blocking: the one client of a robot, on its own loop."""

import asyncio
from collections.abc import Coroutine
from threading import Thread
from typing import Any, Self, TypeVar

from ground.client.connection import Common
from ground.client.goal import Destination
from ground.client.leases import Leasing
from ground.client.outcomes import Answer, Operation, Outcome
from ground.robot import Robot
from protocol.bus.bus import Bus
from protocol.bus.network import Network
from protocol.wire.enums import Mode

T = TypeVar("T")
Out = TypeVar("Out", bound=Outcome)


class ThreadedOperator:
    """Commands a robot from the thread of the caller; its heartbeat comes from a thread of its own.

    It takes the lease only when it is told to: `wait(operator.robot.lease.take())`.
    """

    def __init__(self, bus: Bus, robot: str, name: str = "bench") -> None:
        where = Common(network=Network(), robot=robot)
        self.robot = Robot(bus, where, name, leasing=Leasing.NEVER)
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self.wait(self.robot.open())
        return self

    def __exit__(self, *_: object) -> None:
        self.wait(self.robot.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def wait(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine on the operator's loop to its end."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def send_goal(self, goal: Destination) -> Answer:
        """Send a goal in GUIDED to an armed robot, without a wait for its end."""
        answer, _ = await self.robot.send_goal(goal, Mode.GUIDED, arms=False)
        return answer

    def perform(self, command: Operation[Out]) -> Out:
        """Carry out a command; raises what it raises without an outcome."""
        return self.wait(self.robot.perform(command))
