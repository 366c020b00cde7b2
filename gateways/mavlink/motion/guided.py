"""What clients send in GUIDED: setpoints, speeds and guided mission items.

For speeds the robot is in MANUAL, where it accepts them, and clients receive GUIDED. That ends with
the time-out of the last speed (GUID_TIMEOUT), another mode, a goal, or the loss of control. After a
time-out the robot stops and is in GUIDED, like ArduPilot's Rover. A guided item, a waypoint with
`current` = 2, is a goal at once, not part of a mission.
"""

from enum import Enum, auto
from typing import Final

from gateways.mavlink.coordinates import PER_DEG
from gateways.mavlink.mav_service import EVERYONE, MavService, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.motion.pilot import MISSION_UNDER_WAY, DriveBegun, Pilot
from gateways.mavlink.motion.setpoints import (
    GLOBAL_FRAMES,
    LIFE_NS,
    REPEAT_NS,
    SPEED,
    SetpointError,
    Velocity,
    attitude_of,
    place_goal,
    setpoint_of,
)
from gateways.mavlink.robot_port import Answered
from ground.client.goal import Destination
from ground.client.outcomes import Refused
from protocol.wire.enums import GoalState, Mode
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_MS, NS_PER_S

BRAKING_NS: Final = 200 * NS_PER_MS
"""After a time-out the robot keeps its mode for so long: in MANUAL its wheels brake, in GUIDED they
would run out."""


class Stage(Enum):
    """The state of the change between the robot's own modes."""

    IDLE = auto()
    ENTERING = auto()
    DRIVING = auto()
    LEAVING = auto()


class GuidedDrive:
    """Repeats the newest speeds of a client to the robot until they time out."""

    def __init__(self, vehicle: MavVehicle, pilot: Pilot) -> None:
        self._vehicle = vehicle
        self._pilot = pilot
        self._stage = Stage.IDLE
        self._velocity = Velocity()
        self._sender: Sender | None = None
        self._until_ns = self._leave_ns = self._sent_ns = self._now_ns = 0
        self._drive_id = 0

    def follow(self, velocity: Velocity, sender: Sender, now_ns: int) -> None:
        """Drive with these speeds until newer ones arrive or they time out."""
        self._note(velocity, sender, now_ns)
        if self._stage is Stage.IDLE:
            self._vehicle.start(self._enter(sender))
        elif self._stage is Stage.DRIVING:
            self._drive()

    async def begin(self, velocity: Velocity, sender: Sender, now_ns: int) -> Answered:
        """Drive with these speeds; return why the robot does not, if it refuses."""
        if self._stage is Stage.IDLE:
            self._note(velocity, sender, now_ns)
            return await self._begin(sender)
        answered = await self._vehicle.control.ensure(sender)
        if answered.ok:
            self.follow(velocity, sender, now_ns)
        return answered

    def _note(self, velocity: Velocity, sender: Sender, now_ns: int) -> None:
        self._velocity, self._sender, self._now_ns = velocity, sender, now_ns
        self._until_ns = now_ns + round(self._vehicle.guided_timeout_s * NS_PER_S)
        self._leave_ns = self._until_ns + BRAKING_NS

    @property
    def is_active(self) -> bool:
        """True while the robot follows speeds."""
        return self._stage is not Stage.IDLE

    def end(self) -> None:
        """Stop following speeds, because a goal follows."""
        self._until_ns = self._leave_ns = 0
        if self._stage is Stage.DRIVING:
            self._stop()

    def due(self, now_ns: int) -> None:
        """Repeat the speeds, or end the drive."""
        self._now_ns = now_ns
        modes, sender = self._vehicle.modes, self._sender
        if self._stage is not Stage.DRIVING or sender is None:
            return
        if modes.mode is not Mode.MANUAL or modes.number != Mode.GUIDED:
            self._stage = Stage.IDLE
            if modes.mode is Mode.MANUAL:
                self._stop()
        elif not self._vehicle.control.holds(sender):
            self._stop()
            self._stage = Stage.IDLE
            self._pilot.hold_drive(self._drive_id, sender)
        elif now_ns >= self._leave_ns:
            self._vehicle.start(self._leave(sender))
        elif now_ns - self._sent_ns >= REPEAT_NS and self._is_valid():
            self._drive()

    def _is_valid(self) -> bool:
        return self._now_ns <= self._until_ns - LIFE_NS

    async def _begin(self, sender: Sender) -> Answered:
        self._stage = Stage.ENTERING
        answered = await self._pilot.velocity(sender)
        self._stage = Stage.DRIVING if answered.ok else Stage.IDLE
        if answered.ok:
            begun = answered.outcome
            self._drive_id = begun.drive_id if isinstance(begun, DriveBegun) else 0
            if self._is_valid():  # the answer may have been late
                self._drive()
        return answered

    async def _enter(self, sender: Sender) -> None:
        answered = await self._begin(sender)
        if not answered.ok and self._sender is not None:
            words = f"speeds not followed: {answered.why}"
            self._vehicle.refusals.say(words, self._sender.client, self._now_ns)

    async def _leave(self, sender: Sender) -> None:
        self._stage = Stage.LEAVING
        answered = await self._pilot.await_goal(self._drive_id, sender)
        self._stage = Stage.IDLE
        if not answered.ok:
            self._pilot.hold_drive(self._drive_id, sender)
        elif self._now_ns < self._until_ns and self._sender is not None:
            await self._enter(self._sender)

    def _drive(self) -> None:
        odometry = self._vehicle.snapshot.odometry
        heading_rad = None if odometry is None else odometry.heading_rad
        self._sent_ns = self._now_ns
        self._vehicle.port.drive(*self._velocity.twist(heading_rad))

    def _stop(self) -> None:
        self._vehicle.port.drive(0.0, 0.0)


GUIDED: Final = 2
ALTITUDE: Final = 3
"""Values of `current`; a change of the altitude is refused."""
NOT_IN_CONTROL: Final = (Reason.LEASE_HELD, Reason.NO_IDENTITY)


class GuidedItems(MavService):
    """Executes guided items for one vehicle and acknowledges them."""

    handles = (mavlink.MAVLINK_MSG_ID_MISSION_ITEM, mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT)

    def __init__(self, vehicle: MavVehicle, pilot: Pilot) -> None:
        self._vehicle = vehicle
        self._pilot = pilot

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Drive to a guided item; leave other items to the mission protocol."""
        if message.current not in (GUIDED, ALTITUDE):
            return
        result, words = self._problem(message)
        if result != mavlink.MAV_MISSION_ACCEPTED:
            self._answer(sender, result, words, now_ns)
            return
        is_int = message.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
        scale = PER_DEG if is_int else 1
        try:
            place = message.x / scale, message.y / scale
            goal = place_goal(self._vehicle.origin, *place, None)
        except SetpointError as error:
            result = mavlink.MAV_MISSION_INVALID_PARAM5_X
            self._answer(sender, result, str(error), now_ns)
        else:
            self._vehicle.start(self._go(goal, sender))

    async def _go(self, goal: Destination, sender: Sender) -> None:
        result = result_of(await self._pilot.goto(goal, sender))
        self._answer(sender, *result, self._vehicle.snapshot.now_ns)

    def _problem(self, message: MavMessage) -> tuple[int, str]:
        if message.current == ALTITUDE or message.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            return mavlink.MAV_MISSION_UNSUPPORTED, "a guided item must be a waypoint"
        if message.frame not in GLOBAL_FRAMES:
            words = f"frame {message.frame} is not global"
            return mavlink.MAV_MISSION_UNSUPPORTED_FRAME, words
        if self._vehicle.modes.number != Mode.GUIDED:
            return mavlink.MAV_MISSION_ERROR, "guided items are taken only in mode GUIDED"
        return mavlink.MAV_MISSION_ACCEPTED, ""

    def _answer(self, sender: Sender, result: int, words: str, now_ns: int) -> None:
        if words:
            self._vehicle.refusals.say(words, sender.client, now_ns)
        ack = mavlink.MAVLink_mission_ack_message(sender.system, sender.component, result)
        self._vehicle.outbox.send(ack, sender.client)


def result_of(answered: Answered) -> tuple[int, str]:
    """Return the MAV_MISSION_RESULT of the end of a request, and why it failed."""
    if answered.ok:
        return mavlink.MAV_MISSION_ACCEPTED, ""
    outcome = answered.outcome
    is_denied = not isinstance(outcome, Refused) or outcome.reason in NOT_IN_CONTROL
    result = mavlink.MAV_MISSION_DENIED if is_denied else mavlink.MAV_MISSION_ERROR
    return result, answered.text


class ReachedGoals(MavService):
    """Sends MISSION_ITEM_REACHED 0 when a goal in GUIDED is reached, like ArduPilot's Rover.

    The goals of a mission have items of their own.
    """

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._goal_id: int | None = None
        self._is_over = False

    def due(self, now_ns: int) -> None:
        """Find a goal that has been reached; on a lossy line send the message twice."""
        status, mission = self._vehicle.snapshot.status, self._vehicle.snapshot.mission
        if status is None:
            return
        is_reached = status.goal == GoalState.REACHED and status.mode == Mode.GUIDED
        if status.goal_id != self._goal_id:
            self._is_over = is_reached and self._goal_id is None  # before the gateway began
            self._goal_id = status.goal_id
        self._is_over |= mission is not None and mission.state in MISSION_UNDER_WAY
        if is_reached and not self._is_over:
            self._is_over = True
            reached = mavlink.MAVLink_mission_item_reached_message(0)
            for client in (EVERYONE, *self._vehicle.lossy):
                self._vehicle.outbox.send(reached, client)


SAME_NS: Final = NS_PER_S
"""A position that is repeated within this time is the same request, and is not sent again. It is
sent again after this time to a robot that is not armed.
"""

Target = tuple[object, ...]


class SetpointStream(MavService):
    """Executes the setpoints of the client in control; ignores them outside GUIDED."""

    handles = (
        mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    )

    def __init__(self, vehicle: MavVehicle, pilot: Pilot, drive: GuidedDrive) -> None:
        self._vehicle = vehicle
        self._pilot = pilot
        self._drive = drive
        self._target: Target = ()
        self._seen_ns = 0
        self._is_asking = False
        self._next: tuple[Destination, Sender] | None = None

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Execute a setpoint in GUIDED."""
        if self._vehicle.modes.number != Mode.GUIDED or self._vehicle.control.is_stopping:
            self._target, self._next = (), None
            return
        refusal = self._vehicle.control.refusal(sender)
        if not sender.may_command:
            self._refuse(message, sender.barred, sender, now_ns)
        elif refusal is not None:
            self._refuse(message, refusal.why, sender, now_ns)
        else:
            try:
                self._follow(message, sender, now_ns)
            except SetpointError as error:
                self._refuse(message, str(error), sender, now_ns)

    def due(self, now_ns: int) -> None:
        """Repeat speeds, or end them."""
        self._drive.due(now_ns)

    def forget(self, client: int) -> None:
        """Do nothing: the speeds of a client that has disconnected time out."""

    def _follow(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        if message.get_msgId() == mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
            velocity = attitude_of(message, self._vehicle.parameters.get(SPEED))
            self._drive.follow(velocity, sender, now_ns)
            return
        vehicle = self._vehicle
        target = target_in(message, sender)
        is_same = target == self._target and now_ns - self._seen_ns < SAME_NS
        if is_same and not self._drive.is_active:
            status = vehicle.snapshot.status
            if status is not None and status.vehicle == VehicleState.ACTIVE:
                self._seen_ns = now_ns
            return
        setpoint = setpoint_of(message, vehicle.snapshot.odometry, vehicle.origin)
        if isinstance(setpoint, Velocity):
            self._target = ()
            self._drive.follow(setpoint, sender, now_ns)
        else:
            self._target, self._seen_ns = target, now_ns
            self._drive.end()
            self._next = setpoint, sender
            if not self._is_asking:
                self._vehicle.start(self._go())

    async def _go(self) -> None:
        """Send goals one after another, of those that wait only the newest."""
        self._is_asking = True
        while self._next is not None:
            (goal, sender), self._next = self._next, None
            answered = await self._pilot.goto(goal, sender)
            if not answered.ok:
                words = f"goal refused: {answered.why}"
                now_ns = self._vehicle.snapshot.now_ns
                self._vehicle.refusals.say(words, sender.client, now_ns)
            is_guided = self._vehicle.modes.number == Mode.GUIDED
            if not is_guided or self._vehicle.control.is_stopping:
                self._next = None
        self._is_asking = False

    def _refuse(self, message: MavMessage, why: str, sender: Sender, now_ns: int) -> None:
        words = f"{message.get_type()} ignored: {why}"
        self._vehicle.refusals.say(words, sender.client, now_ns)


def target_in(message: MavMessage, sender: Sender) -> Target:
    """Return the fields that identify a request: all but the time stamp, NaN equal to NaN."""
    names = (name for name in message.get_fieldnames() if name != "time_boot_ms")
    return sender, *(repr(getattr(message, name)) for name in names)
