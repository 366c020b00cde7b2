"""Setpoints that a client streams in GUIDED: SET_POSITION_TARGET_* and SET_ATTITUDE_TARGET."""

from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.motion.guided_drive import GuidedDrive
from gateways.mavlink.motion.pilot import Pilot
from gateways.mavlink.motion.setpoints import SetpointError, attitude_of, setpoint_of
from gateways.mavlink.motion.velocity import SPEED, Velocity
from gateways.mavlink.port import Answered
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from ground.client.goal import Destination
from protocol.wire.enums import Mode
from protocol.wire.enums import Vehicle as VehicleState
from runtime.units import NS_PER_S

SAME_NS: Final = NS_PER_S
"""A position that is repeated within this time is the same request, and is not sent again. It is
sent again after this time to a robot that is not armed.
"""

Target = tuple[object, ...]


class SetpointStream:
    """Executes the setpoints of the client in control; ignores them outside GUIDED."""

    handles = (
        mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
    )

    def __init__(self, vehicle: Vehicle, pilot: Pilot, drive: GuidedDrive) -> None:
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
            self._refuse(message, refusal.text, sender, now_ns)
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
            self._go(setpoint, sender)

    def _go(self, goal: Destination, sender: Sender) -> None:
        """Send a goal; while one is being sent, store only the newest."""
        if self._is_asking:
            self._next = goal, sender
            return
        self._is_asking = True
        self._pilot.goto(goal, sender, lambda answered: self._gone(sender, answered))

    def _gone(self, sender: Sender, answered: Answered) -> None:
        self._is_asking = False
        if not answered.ok:
            words = f"goal refused: {answered.text}"
            now_ns = self._vehicle.snapshot.now_ns
            self._vehicle.refusals.say(words, sender.client, now_ns)
        following, self._next = self._next, None
        is_guided = self._vehicle.modes.number == Mode.GUIDED
        if following is not None and is_guided and not self._vehicle.control.is_stopping:
            self._go(*following)

    def _refuse(self, message: MavMessage, why: str, sender: Sender, now_ns: int) -> None:
        words = f"{message.get_type()} ignored: {why}"
        self._vehicle.refusals.say(words, sender.client, now_ns)


def target_in(message: MavMessage, sender: Sender) -> Target:
    """Return the fields that identify a request: all but the time stamp, NaN equal to NaN."""
    names = (name for name in message.get_fieldnames() if name != "time_boot_ms")
    return sender, *(repr(getattr(message, name)) for name in names)
