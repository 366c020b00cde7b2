"""The mission and the fence of a robot: sent to it, read from it, driven."""

from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from ground.client.leases import Asker
from ground.client.lost_drive import LostMission, NothingToResume, Resumed
from ground.client.outcomes import Accepted, Answer, GoalEnded, Refused, Success, refusal_words
from ground.client.requests import SILENCE_NS
from ground.client.robot_link import Drive
from ground.client.streams import TopicStreams
from ground.client.vocabulary import SHELL, Remedies
from ground.missions.mission import Fence, Mission
from ground.missions.transfer import (
    Announcement,
    Clear,
    Download,
    Downloaded,
    Transfer,
    Upload,
    Verdict,
    fence_items_of,
    fence_of,
    items_of,
    waypoints_of,
)
from protocol.outcome import mission_state, reason_words
from protocol.topics import MISSION, MISSION_SERVICE
from protocol.wire.enums import Command, MissionState, MissionType
from protocol.wire.messages import CommandRequest, MissionStatus
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

T = TypeVar("T")
STATUS_NS: Final = 1_500 * NS_PER_MS
TICK_NS: Final = 50 * NS_PER_MS
BEGUN_NS: Final = NS_PER_S
"""Time after which a mission that is still not running counts as ended."""
UNDER_WAY: Final = (MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED)
CURRENT: Final = -1
"""Starts a mission at its current item."""
NO_MISSION: Final = Verdict(Reason.NO_MISSION, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferOutcome:
    """The robot's verdict on a mission or a fence; `done` is the text of a success.

    `what` names what the verdict is about.
    """

    verdict: Verdict
    done: str
    what: str = ""
    holder: str = ""
    remedies: Remedies = field(default=SHELL, compare=False, repr=False)

    @property
    def ok(self) -> bool:
        """True if the robot accepted it."""
        return self.verdict.ok

    @property
    def reason(self) -> int:
        """The `Reason` of the verdict."""
        return self.verdict.reason

    @property
    def item(self) -> int | None:
        """The item that is wrong, from 1; None if the verdict is not about one item."""
        return self.verdict.item

    @property
    def is_none(self) -> bool:
        """True if the robot has no mission."""
        return self.reason == Reason.NO_MISSION

    @property
    def text(self) -> str:
        """The text of a success, or the refusal with its remedy."""
        if self.ok:
            return self.done
        reason = f"{self.what}{self.verdict.text}"
        no = "not saved" if self.verdict.in_force else "refused"
        hints = self.remedies.refusals
        return f"{no}: {refusal_words(reason, self.verdict.reason, self.holder, hints)}"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the verdict as a row."""
        return {
            "verb": verb,
            "robot": robot,
            "ok": self.ok,
            "reason": f"{self.what}{self.verdict.text}",
            "reason_code": self.verdict.reason,
            "item": self.verdict.item,
        }


@dataclass(frozen=True, slots=True)
class MissionProgress(Success):
    """The robot's mission status."""

    status: MissionStatus

    @property
    def text(self) -> str:
        """One line such as `holding, item 3 of 5, 3.2 s left`."""
        status = self.status
        if status.state == MissionState.NONE:
            return "no mission"
        left = f", {status.hold_left_ms / 1000:.1f} s left" if status.hold_left_ms else ""
        where = f"item {status.current + 1} of {status.count}"
        reason = f": {self._reason}" if status.reason else ""
        return f"{mission_state(status.state, status.reason).lower()}, {where}{left}{reason}"

    @property
    def _reason(self) -> str:
        """The reason of the state, with the name of another person who has stopped it."""
        return reason_words(self.status.reason, self.status.stopped_by)

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the status as a row; items count from 1."""
        status = self.status
        return {
            "robot": robot,
            "ok": True,
            "state": mission_state(status.state, status.reason).lower(),
            "items": status.count,
            "current": status.current + 1 if status.count else None,
            "hold_left_s": status.hold_left_ms / 1000,
            "reason": self._reason if status.reason else None,
        }


@dataclass(frozen=True, slots=True)
class MissionEnded(MissionProgress):
    """The end of a mission; `ok` if all items were reached."""

    @property
    def ok(self) -> bool:
        """True if all items were reached."""
        return self.status.state == MissionState.DONE


@dataclass(frozen=True, slots=True)
class MissionPaused(Accepted):
    """The robot accepted to hold; `status` is that of the mission afterwards."""

    status: MissionStatus

    @property
    def text(self) -> str:
        """The item at which the mission is paused, and the duration."""
        status = self.status
        what = "holding, no mission is under way"
        if status.state in UNDER_WAY:
            what = f"mission paused at item {status.current + 1} of {status.count}"
        return f"ok {self.took_ns / NS_PER_MS:.0f} ms: {what}"


class MissionDriver(Asker, Protocol):
    """The client of a robot, as its mission uses it."""

    @property
    def streams(self) -> TopicStreams:
        """The telemetry streams of the robot."""

    def check_open(self) -> None:
        """Raise ClosedError after the end of `connect`."""

    async def drive_until(
        self,
        begin: Callable[[Drive], Coroutine[Any, Any, Answer]],
        follow: Callable[[Drive], Coroutine[Any, Any, T]],
        ending: Callable[[], CommandRequest],
        /,
    ) -> T | Refused:
        """Begin a drive and follow it; end it, and no other, if this is cancelled or raises."""

    async def hold(self) -> Answer:
        """Stop and keep the goal."""

    async def resume(self) -> Answer | GoalEnded:
        """Continue to the goal."""

    def request(self, command: Command, param1: float = 0.0, /) -> CommandRequest:
        """Return a request with an id of its own."""

    async def command(self, request: CommandRequest, /, *, begins: bool) -> Answer:
        """Send a command and return the robot's answer."""

    async def sleep_until(self, deadline_ns: int, /) -> None:
        """Wait until the clock has reached the deadline."""


class Missions:
    """The robot's mission: waypoints in metres, in its own frame, headings in degrees."""

    def __init__(self, robot: MissionDriver) -> None:
        self._robot = robot

    async def upload(self, mission: Mission | str | Path) -> TransferOutcome | Refused:
        """Upload a mission or a mission file, whole or not at all, with its fence if it has one.

        The fence goes first, so that the robot checks the mission against it. MissionError names
        all faults of a file.
        """
        if not isinstance(mission, Mission):
            from ground.missions import files  # slow to import, and needed only for a file

            mission = files.read(Path(mission)).mission
        robot = self._robot
        if (refused := await robot.lease.ensure()) is not None:
            return refused
        if mission.fence is not None:
            verdict = await send_fence(robot, mission.fence)
            if not verdict.in_force:
                return await judged(robot, verdict, "", "the fence: ")
            if not verdict.ok:
                robot.progress.note(f"the fence: {verdict.text}")
        items = items_of(mission.waypoints)
        verdict = await send(robot, Upload(items, MissionType.MISSION, robot.clock.now_ns()))
        return await judged(robot, verdict, f"ok, the robot has {mission}")

    async def announce(self, kind: MissionType, count: int) -> TransferOutcome | Refused:
        """Ask whether the robot accepts this number of items now; nothing is changed.

        For too many items the verdict names the first item beyond the limit.
        """
        robot = self._robot
        if (refused := await robot.lease.ensure()) is not None:
            return refused
        verdict = await send(robot, Announcement(count, kind, robot.clock.now_ns()))
        return await judged(robot, verdict, "ok, the robot takes them")

    async def fetch(self) -> Mission | None:
        """Return the robot's mission; None if it has none.

        Raises RemoteError if the robot does not send it.
        """
        found = await self.download()
        if isinstance(found, Mission):
            return found
        if found.is_none:
            return None
        raise RemoteError(found.text)

    async def download(self) -> Mission | TransferOutcome:
        """Return the mission with the fence; a verdict if there is none or it is not sent."""
        robot = self._robot
        found = await fetch(robot, MissionType.MISSION)
        fence = await fetch(robot, MissionType.FENCE)
        if isinstance(found, Verdict):
            return await judged(robot, found, "")
        if not found.items:
            return await judged(robot, NO_MISSION, "")
        corners = fence.items if isinstance(fence, Downloaded) else ()
        return Mission(waypoints=waypoints_of(found.items), fence=fence_of(corners))

    async def start(self, item: int | None = None, *, arms: bool = True) -> Answer:
        """Drive the mission from an item (from 1) on, in AUTO; arm a robot in standby."""
        if (refused := await self._robot.lease.ensure()) is not None:
            return refused
        return await self._robot.in_turn(partial(self._start, item, arms, Drive()))

    async def run(self, item: int | None = None) -> MissionEnded | Refused:
        """Start the mission and wait for its end, which is `ok` if all items were reached.

        Cancelling this pauses the mission: the robot stops, unless another request drives it.
        """
        began_ns = self._robot.clock.now_ns()

        async def follow(_: Drive) -> MissionEnded:
            return MissionEnded(await self._ended(began_ns))

        return await self._robot.drive_until(
            partial(self._start, item, True),
            follow,
            lambda: self._robot.request(Command.DO_PAUSE_CONTINUE, 0.0),
        )

    async def _start(self, item: int | None, arms: bool, drive: Drive) -> Answer:
        """Start the mission; without an item at the current one, or again if it is complete."""
        first = CURRENT if item is None else item - 1
        if item is None:
            newest = await self._robot.newest(MISSION, STATUS_NS)
            if newest is not None and newest.state == MissionState.DONE:
                first = 0

        def request() -> CommandRequest:
            return drive.begun_by(self._robot.request(Command.MISSION_START, float(first)))

        answer, _ = await self._robot.accepted(request, beats=False, arms=arms)
        return answer

    async def pause(self) -> Answer:
        """Stop; `resume` continues."""
        answer = await self._robot.hold()
        if isinstance(answer, Refused):
            return answer
        status = await self._robot.newest(MISSION, STATUS_NS)
        return answer if status is None else MissionPaused(answer.took_ns, status)

    async def resume(self) -> Answer | GoalEnded:
        """Continue the mission, also one that was ended early, whatever was driven since.

        Refused if it has not begun, or is done.
        """
        newest = await self._robot.newest(MISSION, STATUS_NS)
        if newest is None or newest.state in UNDER_WAY:
            return await self._robot.resume()
        if newest.state != MissionState.FAILED:
            remedies = self._robot.remedies
            if newest.state == MissionState.NONE:
                return Refused(Reason.NO_MISSION, 0, remedies=remedies)
            return NothingToResume(Reason.NO_GOAL, 0, remedies=remedies, mission=newest)
        request = self._robot.request(Command.MISSION_START, float(CURRENT))
        answer = await self._robot.command(request, begins=True)
        lost = LostMission(newest.current, newest.count)
        return Resumed(answer.took_ns, lost) if isinstance(answer, Accepted) else answer

    async def jump(self, item: int) -> Answer:
        """Continue with another item, from 1."""
        request = self._robot.request(Command.DO_SET_MISSION_CURRENT, float(item - 1))
        return await self._robot.command(request, begins=True)

    async def clear(self) -> TransferOutcome | Refused:
        """Delete the mission from the robot."""
        robot = self._robot
        if (refused := await robot.lease.ensure()) is not None:
            return refused
        verdict = await send(robot, Clear(MissionType.MISSION, robot.clock.now_ns()))
        return await judged(robot, verdict, "ok, the robot has no mission")

    async def status(self) -> MissionProgress:
        """Return the progress; RemoteError if the robot publishes no mission status."""
        newest = await self._robot.newest(MISSION, STATUS_NS)
        if newest is None:
            why = await self._robot.diagnosis()
            raise RemoteError(f"the robot publishes no mission status: {why}")
        return MissionProgress(newest)

    async def _ended(self, began_ns: int) -> MissionStatus:
        """Wait until a mission that was running has ended."""
        seen = False
        while True:
            self._robot.check_open()
            newest, now_ns = self._robot.streams.latest(MISSION), self._robot.clock.now_ns()
            late = now_ns - began_ns > BEGUN_NS
            silent_ns = now_ns - max(began_ns, 0 if newest is None else newest[1])
            if silent_ns >= SILENCE_NS:
                silence = f"no mission status from the robot for {silent_ns / NS_PER_S:.1f} s"
                raise RemoteError(await self._robot.standstill() or silence)
            if newest is not None and newest[1] > began_ns:
                if newest[0].state in UNDER_WAY:
                    seen = True
                elif seen or late:
                    return newest[0]
            await self._robot.sleep_until(now_ns + TICK_NS)


class Fences:
    """The circle or polygon that the robot does not leave."""

    def __init__(self, robot: Asker) -> None:
        self._robot = robot

    async def set(self, fence: Fence) -> TransferOutcome | Refused:
        """Keep the robot inside a `Circle` or `Polygon` (metres, in its own frame)."""
        if (refused := await self._robot.lease.ensure()) is not None:
            return refused
        return await judged(self._robot, await send_fence(self._robot, fence), f"ok, {fence}")

    async def clear(self) -> TransferOutcome | Refused:
        """Remove the fence."""
        robot = self._robot
        if (refused := await robot.lease.ensure()) is not None:
            return refused
        verdict = await send(robot, Clear(MissionType.FENCE, robot.clock.now_ns()))
        return await judged(robot, verdict, "ok, there is no fence")

    async def get(self) -> Fence | None:
        """Return the robot's fence, None if it has none; RemoteError if it is not sent."""
        found = await self.download()
        if isinstance(found, TransferOutcome):
            raise RemoteError(found.text)
        return found

    async def download(self) -> Fence | TransferOutcome | None:
        """Return the fence, None without one; a verdict if the robot does not send it."""
        found = await fetch(self._robot, MissionType.FENCE)
        if isinstance(found, Verdict):
            return await judged(self._robot, found, "no fence")
        return fence_of(found.items)


async def send(robot: Asker, transfer: Transfer) -> Verdict:
    """Return the robot's verdict on an upload or a deletion."""
    outcome = await robot.exchange(transfer, MISSION_SERVICE)
    if not isinstance(outcome, Verdict):
        raise RemoteError("the robot sent a mission instead of a verdict")
    return outcome


async def send_fence(robot: Asker, fence: Fence) -> Verdict:
    """Upload a fence and return the robot's verdict."""
    items = fence_items_of(fence)
    return await send(robot, Upload(items, MissionType.FENCE, robot.clock.now_ns()))


async def fetch(robot: Asker, kind: MissionType) -> Downloaded | Verdict:
    """Download items from the robot; a verdict if it does not send them."""
    return await robot.exchange(Download(kind, robot.clock.now_ns()), MISSION_SERVICE)


async def judged(robot: Asker, verdict: Verdict, done: str, what: str = "") -> TransferOutcome:
    """Return a verdict, with the lease holder's name if the lease is the reason."""
    return TransferOutcome(
        verdict=verdict,
        done=done,
        what=what,
        holder=await robot.refusing_holder(verdict.reason),
        remedies=robot.remedies,
    )
