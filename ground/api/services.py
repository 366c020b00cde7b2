"""Parts of the asyncio client: parameters, missions, the fence and the lease of one robot."""

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from ground.client.outcomes import Answer, LeaseShown, Outcome, Refused
from ground.client.requests import SILENCE_NS, Asker
from ground.client.session import Operation
from ground.client.streams import TopicStreams
from ground.commands.fence import ClearFence, FenceShown, SetFence, ShowFence
from ground.commands.mission import (
    STATUS_NS,
    ClearMission,
    FetchMission,
    JumpTo,
    MissionEnded,
    MissionFetched,
    MissionProgress,
    ShowMissionStatus,
    TransferOutcome,
    UploadMission,
)
from ground.missions import files
from ground.missions.mission import Fence, Mission
from ground.robot import CURRENT, Drive
from protocol.topics import MISSION
from protocol.wire.enums import Command, LeaseAction, MissionState
from protocol.wire.messages import CommandRequest, MissionStatus
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

Out = TypeVar("Out", bound=Outcome)
T = TypeVar("T")
FLT_MAX: Final = 3.4e38
TICK_S: Final = 0.05
BEGUN_NS: Final = 1_000_000_000
"""Time after which a mission that is still not running counts as ended."""
UNDER_WAY: Final = (MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED)


class OperationRunner(Asker, Protocol):
    """The client of a robot, as its parts use it."""

    @property
    def streams(self) -> TopicStreams:
        """The telemetry streams of the robot."""

    async def perform(self, operation: Operation[Out]) -> Out | Refused:
        """Carry out an operation; take the lease first if it moves."""

    def check_open(self) -> None:
        """Raise ClosedError after the end of `connect`."""

    async def drive_until(
        self,
        begin: Callable[[Drive], Coroutine[Any, Any, Answer]],
        follow: Callable[[Drive], Coroutine[Any, Any, T]],
        ending: Callable[[], CommandRequest],
    ) -> T | Refused:
        """Begin a drive and follow it; end it, and no other, if this is cancelled or raises."""

    async def change_lease(self, action: LeaseAction) -> Answer:
        """Take, seize or release the lease."""

    async def show_lease(self) -> LeaseShown:
        """Return the lease."""

    async def hold(self) -> Answer:
        """Stop and keep the goal."""

    async def resume(self) -> Answer:
        """Continue to the goal."""

    def request(self, command: Command, param1: float = 0.0) -> CommandRequest:
        """Return a request with an id of its own."""


class Missions:
    """The robot's mission: waypoints in metres, in its own frame, headings in degrees."""

    def __init__(self, robot: OperationRunner) -> None:
        self._robot = robot

    async def upload(self, mission: Mission | str | Path) -> TransferOutcome | Refused:
        """Upload a mission or a mission file, whole or not at all, with its fence if it has one.

        MissionError names all faults of a file.
        """
        if not isinstance(mission, Mission):
            mission = files.read(Path(mission)).mission
        return await self._robot.perform(UploadMission(mission=mission))

    async def fetch(self) -> Mission | None:
        """Return the robot's mission; None if it has none.

        Raises RemoteError if the robot does not send it.
        """
        found = await self._robot.perform(FetchMission())
        if isinstance(found, MissionFetched):
            return found.mission
        if isinstance(found, TransferOutcome) and found.is_none:
            return None
        raise RemoteError(found.text)

    async def start(self, item: int | None = None) -> Answer:
        """Drive the mission from an item (from 1) on, in AUTO; arm a robot in standby."""
        if (refused := await self._robot.ensure_lease()) is not None:
            return refused
        return await self._robot.in_turn(partial(self._start, item, Drive()))

    async def run(self, item: int | None = None) -> MissionEnded | Refused:
        """Start the mission and wait for its end, which is `ok` if all items were reached.

        Cancelling this pauses the mission: the robot stops, unless another request drives it.
        """
        began_ns = self._robot.clock.now_ns()

        async def follow(_: Drive) -> MissionEnded:
            return MissionEnded(await self._ended(began_ns))

        return await self._robot.drive_until(
            partial(self._start, item),
            follow,
            lambda: self._robot.request(Command.DO_PAUSE_CONTINUE, 0.0),
        )

    async def _start(self, item: int | None, drive: Drive) -> Answer:
        """Start the mission; without an item at the current one, or again if it is complete."""
        first = CURRENT if item is None else item - 1
        if item is None:
            newest = await self._robot.newest(MISSION, STATUS_NS)
            if newest is not None and newest.state == MissionState.DONE:
                first = 0

        def request() -> CommandRequest:
            return drive.begun_by(self._robot.request(Command.MISSION_START, float(first)))

        answer, _ = await self._robot.accepted(request, beats=False)
        return answer

    async def pause(self) -> Answer:
        """Stop; `resume` continues."""
        return await self._robot.hold()

    async def resume(self) -> Answer:
        """Continue after a pause."""
        return await self._robot.resume()

    async def jump(self, item: int) -> Answer:
        """Continue with another item, from 1."""
        return await self._robot.perform(JumpTo(item=item))

    async def clear(self) -> TransferOutcome | Refused:
        """Delete the mission from the robot."""
        return await self._robot.perform(ClearMission())

    async def status(self) -> MissionProgress:
        """Return the progress; RemoteError if the robot publishes no mission status."""
        return accepted(await self._robot.perform(ShowMissionStatus()))

    async def _ended(self, began_ns: int) -> MissionStatus:
        """Wait until a mission that was running has ended."""
        seen = False
        while True:
            self._robot.check_open()
            newest, now_ns = self._robot.streams.latest(MISSION), self._robot.clock.now_ns()
            late = now_ns - began_ns > BEGUN_NS
            silent_ns = now_ns - max(began_ns, 0 if newest is None else newest[1])
            if silent_ns >= SILENCE_NS:
                raise RemoteError(
                    f"no mission status from the robot for {silent_ns / NS_PER_S:.1f} s"
                )
            if newest is not None and newest[1] > began_ns:
                if newest[0].state in UNDER_WAY:
                    seen = True
                elif seen or late:
                    return newest[0]
            await asyncio.sleep(TICK_S)


class Fences:
    """The circle or polygon that the robot does not leave."""

    def __init__(self, robot: OperationRunner) -> None:
        self._robot = robot

    async def set(self, fence: Fence) -> TransferOutcome | Refused:
        """Keep the robot inside a `Circle` or `Polygon` (metres, in its own frame)."""
        return await self._robot.perform(SetFence(fence=fence))

    async def clear(self) -> TransferOutcome | Refused:
        """Remove the fence."""
        return await self._robot.perform(ClearFence())

    async def get(self) -> Fence | None:
        """Return the robot's fence, None if it has none; RemoteError if it is not sent."""
        found = await self._robot.perform(ShowFence())
        if isinstance(found, FenceShown):
            return found.fence
        raise RemoteError(found.text)


class Leases:
    """The right of one person to command the robot."""

    def __init__(self, robot: OperationRunner) -> None:
        self._robot = robot

    async def take(self) -> Answer:
        """Become the robot's operator; refused while another person holds the lease."""
        return await self._robot.change_lease(LeaseAction.TAKE)

    async def seize(self) -> Answer:
        """Become the robot's operator in place of another one."""
        return await self._robot.change_lease(LeaseAction.SEIZE)

    async def give_back(self) -> Answer:
        """Release the lease, for all programs of this person.

        A robot that one of them drives in GUIDED or MANUAL then stops by itself.
        """
        return await self._robot.change_lease(LeaseAction.RELEASE)

    async def show(self) -> LeaseShown:
        """Return the lease; RemoteError if the robot publishes no lease status."""
        return await self._robot.show_lease()


def accepted(outcome: Out | Refused) -> Out:
    """Return the outcome of an operation that moves nothing, and so is never refused the lease."""
    if isinstance(outcome, Refused):
        raise RemoteError(outcome.text)
    return outcome
