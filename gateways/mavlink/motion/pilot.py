"""Requests of clients to the robot: change the mode, start the mission, drive to a position."""

import asyncio
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from gateways.mavlink.ardupilot import RTL
from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.operator_control import name_of
from gateways.mavlink.robot_port import Answered
from ground.client.goal import Destination
from ground.client.outcomes import Accepted, Answer, Operation, Outcome, Refused
from ground.client.requests import GaveUp
from ground.commands.goto import Goto
from ground.commands.hold import Hold
from ground.commands.mission import StartMission
from ground.commands.mode import SetMode
from ground.commands.rtl import ReturnHome
from ground.robot import Robot
from protocol.topics import COMMAND
from protocol.wire.enums import Command, MissionState, Mode
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_S

NO_LIMIT: Final = -2.0
"""The speed of DO_CHANGE_SPEED that ends a limit."""
FROM_CURRENT: Final = 0
"""The item of `StartMission` that means the current one."""
PATIENCE_NS: Final = NS_PER_S
"""Time for the operator's first heartbeat to reach the robot."""
MISSION_UNDER_WAY: Final = (MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED)


@dataclass(frozen=True, slots=True)
class DriveBegun(Accepted):
    """The robot follows speeds; `drive_id` names the drive."""

    drive_id: int = 0


@dataclass(frozen=True, slots=True)
class DriveOver:
    """The drive was over before: by an operator, or by the robot itself."""

    ok: ClassVar[bool] = False
    text: ClassVar[str] = "the drive is over"

    def as_json(self, verb: str, robot: str) -> dict[str, object]:
        """Return the outcome as a row."""
        return {"verb": verb, "robot": robot, "ok": False, "reason": self.text}


@dataclass(frozen=True, slots=True)
class BeginDrive:
    """Choose MANUAL for speeds."""

    verb: ClassVar[str] = "mode"
    moves: ClassVar[bool] = True

    async def perform(self, robot: Robot) -> Answer:
        """Set the mode; the request names the drive."""
        request = robot.request(Command.DO_SET_MODE, 1.0, float(Mode.MANUAL))
        answer = await robot.ask(request)
        if isinstance(answer, Accepted):
            return DriveBegun(answer.took_ns, request.request_id)
        return answer


@dataclass(frozen=True, slots=True)
class EndDrive:
    """End a drive in HOLD or GUIDED. One that is over stays so, whatever has followed it."""

    verb: ClassVar[str] = "mode"
    moves: ClassVar[bool] = True
    drive_id: int
    mode: Mode

    async def perform(self, robot: Robot) -> Outcome:
        """Hold, if the drive is the present one; then set the mode."""
        request = robot.request(Command.DO_PAUSE_CONTINUE, 0.0)
        answer = await robot.end(request, self.drive_id)
        if answer is None:
            return DriveOver()
        if isinstance(answer, GaveUp):
            raise await robot.unanswered(answer, COMMAND)
        if self.mode is Mode.HOLD or not answer.ok:
            return answer
        return await robot.set_mode(self.mode)


@dataclass(frozen=True, slots=True)
class LimitDrive:
    """Limit the speed of the present drive; None ends the limit.

    Without `for_goal` the limit is in GUIDED for all goals until the mode changes.
    """

    verb: ClassVar[str] = "speed"
    moves: ClassVar[bool] = True
    speed_m_s: float | None
    for_goal: bool = False

    async def perform(self, robot: Robot) -> Answer:
        """Send the command."""
        speed_m_s = NO_LIMIT if self.speed_m_s is None else self.speed_m_s
        request = robot.request(Command.DO_CHANGE_SPEED, float(self.for_goal), speed_m_s)
        return await robot.ask(request)


@dataclass(frozen=True, slots=True)
class EnterGuided:
    """Drop the goal or mission, like ArduPilot at the change to GUIDED, and wait for a goal."""

    verb: ClassVar[str] = "mode"
    moves: ClassVar[bool] = True

    async def perform(self, robot: Robot) -> Answer:
        """Set the mode, and abort (a robot without a goal refuses it); a refusal ends nothing."""
        answer = await robot.set_mode(Mode.GUIDED)
        if answer.ok:
            await robot.abort()
        return answer


class Pilot(MavService):
    """Executes requests that change the mode, and updates `vehicle.modes`."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._rounds: list[asyncio.Future[None]] = []
        """Of those that wait for the next round."""
        self._mission_waits: Sender | None = None
        self._now_ns = 0

    async def set_mode(self, mode: Mode, number: int, sender: Sender) -> Answered:
        """Change the mode; AUTO starts or continues the mission once the robot is armed."""
        if mode is Mode.AUTO:
            return await self._enter_auto(sender)
        if mode is Mode.GUIDED and self._vehicle.modes.number == Mode.GUIDED:
            return await self._vehicle.control.ensure(sender)
        if mode is Mode.GUIDED:
            return await self._try(sender, EnterGuided(), mode)
        if mode is Mode.SMART_RTL:
            return await self.return_home(number, sender)
        if mode is Mode.HOLD:
            return await self.hold(sender)
        return await self._try(sender, SetMode(mode=mode), mode)

    async def hold(self, sender: Sender) -> Answered:
        """Stop and keep goal and mission."""
        return await self._try(sender, Hold(), Mode.HOLD)

    async def return_home(self, number: int, sender: Sender) -> Answered:
        """Drive back along the trail, by RTL to the home that a client has chosen, if any.

        Clients receive the mode RTL or SMART_RTL, by `number`.
        """
        if number != RTL:
            return await self._try(sender, ReturnHome(), Mode.SMART_RTL)
        if self._vehicle.is_home_chosen:
            x_m, y_m = self._vehicle.home
            home = Destination(x_m=x_m, y_m=y_m, heading_rad=None)
            return await self._try(sender, Goto(goal=home, wait=False, arms=False), Mode.AUTO, RTL)
        return await self._try(sender, ReturnHome(), Mode.SMART_RTL, RTL)

    async def goto(self, goal: Destination, sender: Sender) -> Answered:
        """Drive to a position in GUIDED; an unarmed robot refuses."""
        return await self._try(sender, Goto(goal=goal, arms=False), Mode.GUIDED)

    async def start_mission(self, sender: Sender) -> Answered:
        """Start the mission at its current item, or continue it; an unarmed robot refuses."""
        mission = self._vehicle.snapshot.mission
        state = MissionState.NONE if mission is None else mission.state
        if state in MISSION_UNDER_WAY and self._vehicle.modes.mode in (Mode.AUTO, Mode.HOLD):
            return await self._try(sender, SetMode(mode=Mode.AUTO), Mode.AUTO)
        item = None if state == MissionState.DONE else FROM_CURRENT
        return await self._try(sender, StartMission(item=item, arms=False), Mode.AUTO)

    async def velocity(self, sender: Sender) -> Answered:
        """Choose MANUAL for the speeds of a client in GUIDED; clients receive GUIDED."""
        return await self._try(sender, BeginDrive(), Mode.MANUAL, int(Mode.GUIDED))

    async def await_goal(self, drive_id: int, sender: Sender) -> Answered:
        """Choose GUIDED without a goal, after the speeds of a client; clients still receive it."""
        self._vehicle.modes.show(Mode.HOLD, Mode.GUIDED)
        return await self._try(sender, EndDrive(drive_id, Mode.GUIDED), Mode.GUIDED)

    def hold_drive(self, drive_id: int, sender: Sender) -> None:
        """End speeds of a client in HOLD, without control."""
        self._vehicle.modes.show_own()
        self._vehicle.start(self._end_drive(drive_id, sender))

    async def _end_drive(self, drive_id: int, sender: Sender) -> None:
        await self._vehicle.port.perform(EndDrive(drive_id, Mode.HOLD), name_of(sender))

    def due(self, now_ns: int) -> None:
        """Repeat what waits for the heartbeat; start the mission that waits for arming."""
        self._now_ns = now_ns
        rounds, self._rounds = self._rounds, []
        for begun in rounds:
            begun.set_result(None)
        waiting, status = self._mission_waits, self._vehicle.snapshot.status
        if waiting is None or status is None:
            return
        if not self._vehicle.control.holds(waiting):
            self._mission_waits = None
        elif status.vehicle == VehicleState.ACTIVE and status.mode == Mode.AUTO:
            self._mission_waits = None
            self._vehicle.start(self._start_waiting(waiting))

    def forget(self, client: int) -> None:
        """Do nothing: the loss of control ends the wait of a client that has disconnected."""

    async def _enter_auto(self, sender: Sender) -> Answered:
        status, mission = self._vehicle.snapshot.status, self._vehicle.snapshot.mission
        has_mission = mission is not None and mission.state != MissionState.NONE
        if not has_mission or status is None or status.vehicle == VehicleState.ACTIVE:
            return await self.start_mission(sender)
        answered = await self._try(sender, SetMode(mode=Mode.AUTO), Mode.AUTO)
        if answered.ok:
            self._mission_waits = sender
        return answered

    async def _start_waiting(self, sender: Sender) -> None:
        answered = await self.start_mission(sender)
        if not answered.ok:
            words = f"mission not started: {answered.why}"
            self._vehicle.refusals.say(words, sender.client, self._now_ns)

    async def _try(
        self, sender: Sender, operation: Operation[Any], mode: Mode, number: int | None = None
    ) -> Answered:
        """Perform an operation, again until the robot has received the operator's heartbeat."""
        self._mission_waits = None
        until_ns = self._now_ns + PATIENCE_NS

        async def is_early(answered: Answered) -> bool:
            if not lacks_heartbeat(answered) or self._now_ns >= until_ns:
                return False
            begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._rounds.append(begun)
            await begun
            return True

        answered = await self._vehicle.control.perform(sender, operation, is_early)
        if answered.ok:
            self._vehicle.modes.accepted(mode, number)
        return answered


def lacks_heartbeat(answered: Answered) -> bool:
    """Return whether the robot has not received the operator's heartbeat yet."""
    outcome = answered.outcome
    return isinstance(outcome, Refused) and outcome.reason == Reason.NO_OPERATOR
