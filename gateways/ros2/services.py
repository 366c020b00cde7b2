"""The services of a robot: emergency stop, clear, arm, disarm, hold, resume, and its lifecycle.

Each Trigger returns success, or the reason why the robot has refused. The emergency stop waits for
nothing: it is sent when its request is read, needs no lease, and is served in read-only mode, too.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

from gateways.ros2.interfaces import Interfaces
from gateways.ros2.node import RosNode
from gateways.ros2.wire import Attachment
from ground.client.outcomes import Outcome, Refused, Stopped
from ground.robot import Robot
from runtime.errors import LocalError, RemoteError

TRIGGER: Final = "std_srvs/srv/Trigger"
GET_STATE: Final = "lifecycle_msgs/srv/GetState"
ACTIVE: Final = (3, "active")
INACTIVE: Final = (2, "inactive")
NAVIGATOR: Final = "bt_navigator"
"""The node of Nav2 that clients of its actions wait for."""


class RobotServices:
    """Serves what moves no goal. With `read_only` only the emergency stop."""

    def __init__(
        self,
        node: RosNode,
        robot: Robot,
        is_ready: Callable[[], bool],
        *,
        read_only: bool = False,
    ) -> None:
        self._robot, self._is_ready = robot, is_ready
        self._interfaces: Interfaces = node.session.interfaces
        self._stopping: asyncio.Future[Stopped] | None = None
        node.serve("emergency_stop", TRIGGER, self._stop)
        node.serve(f"{NAVIGATOR}/get_state", GET_STATE, self._get_state)
        if not read_only:
            for name, ask in self._requests().items():
                node.serve(name, TRIGGER, self._triggering(ask))

    def _requests(self) -> Mapping[str, Callable[[], Awaitable[Outcome]]]:
        robot = self._robot
        return {
            "clear": self._clear,
            "arm": robot.arm,
            "disarm": robot.disarm,
            "hold": robot.hold,
            "resume": robot.resume,
        }

    async def _clear(self) -> Outcome:
        return await self._robot.clear_emergency_stop(*self._robot.stops_known)

    async def _stop(self, _request: Any, _attachment: Attachment) -> Any:
        """Stop at once. While a stop is repeated, another request shares its end."""
        if self._stopping is None or self._stopping.done():
            self._stopping = self._robot.press_stop()
        return self._answer(await asyncio.shield(self._stopping))

    def _triggering(
        self, ask: Callable[[], Awaitable[Outcome]]
    ) -> Callable[[Any, Attachment], Awaitable[Any]]:
        async def serve(_request: Any, _attachment: Attachment) -> Any:
            try:
                return self._answer(await ask())
            except (LocalError, RemoteError) as error:
                return self._interfaces.make(f"{TRIGGER}_Response", False, str(error))

        return serve

    def _answer(self, outcome: Outcome) -> Any:
        text = outcome.words if isinstance(outcome, Refused) else outcome.text
        return self._interfaces.make(f"{TRIGGER}_Response", outcome.ok, text)

    async def _get_state(self, _request: Any, _attachment: Attachment) -> Any:
        number, label = ACTIVE if self._is_ready() else INACTIVE
        state = self._interfaces.make("lifecycle_msgs/msg/State", number, label)
        return self._interfaces.make(f"{GET_STATE}_Response", state)
