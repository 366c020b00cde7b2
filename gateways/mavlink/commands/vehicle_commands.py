"""What clients ask of the robot as a device: arm, stop, its version, home, origin and signing key.

Disarming and the emergency stop need no control. DO_FLIGHTTERMINATION with parameter 1 = 0 clears
the stop, and so does forced arming; both need control.

SET_GPS_GLOBAL_ORIGIN and DO_SET_GLOBAL_ORIGIN move the origin, GPS_GLOBAL_ORIGIN reports it. The
robot's local metres do not change; their positions on Earth move with the origin. A change is
refused while the robot is armed, and while another client is in control.

SETUP_SIGNING sets the key, or ends signing with a key of zeros: only while the robot is disarmed,
and only from this machine or signed with the present key. The message holds the secret: it is never
recorded, logged or forwarded.
"""

from math import isfinite
from types import MappingProxyType
from typing import Final

from gateways.mavlink import ardupilot
from gateways.mavlink.ardupilot import FORCE
from gateways.mavlink.commands.command_protocol import (
    ACCEPTED,
    DENIED,
    LATER,
    UNSUPPORTED_FRAME,
    CommandAnswer,
    CommandCall,
    CommandRow,
    CommandTable,
    Handled,
    answer_to,
    result_of,
)
from gateways.mavlink.coordinates import GlobalPlace, home_at, knows_place, place_of
from gateways.mavlink.mav_service import EVERYONE, MavService, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import RESULT_NOT_IN_CONTROL, MavMessage, mavlink
from gateways.mavlink.motion.setpoints import NO_POSE, SetpointError, destination, place_goal
from gateways.mavlink.robot_port import NO_TELEMETRY, Answered, arming_faults
from gateways.mavlink.signing import SigningGuard
from gateways.mavlink.telemetry_messages import altitude_mm, gps_origin, home_position
from ground.client.goal import Destination
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.restart import Restart
from ground.commands.stop import ClearEmergencyStop
from ground.user.mavlink_keys import NO_KEY
from protocol.wire.enums import Severity
from protocol.wire.enums import Vehicle as VehicleState
from runtime.errors import UserError
from runtime.units import MM_PER_M

PREARM: Final = "PreArm: "
"""The prefix by which clients recognise why a robot cannot be armed."""
NO_STOP: Final = CommandAnswer(LATER, "no status of the robot has named an emergency stop yet")


class ArmingCommands:
    """The handlers for one vehicle."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._pressed_id: int | None = None

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_COMPONENT_ARM_DISARM: CommandRow(self._arm_disarm, stops=is_disarm),
                mavlink.MAV_CMD_RUN_PREARM_CHECKS: CommandRow(self._check, reads=True),
                mavlink.MAV_CMD_DO_FLIGHTTERMINATION: CommandRow(
                    self._terminate, stops=is_termination, is_unlimited=True
                ),
            }
        )

    def _arm_disarm(self, call: CommandCall) -> Handled:
        if call.param1 == 1.0:
            return self._arm(call)
        if call.param1 == 0.0:
            return self._vehicle.control.perform(call.sender, Disarm())
        return CommandAnswer(DENIED, "parameter 1 must be 1 to arm or 0 to disarm")

    async def _arm(self, call: CommandCall) -> CommandAnswer:
        status = self._vehicle.snapshot.status
        is_stopped = status is not None and status.vehicle == VehicleState.EMERGENCY_STOP
        answered = None
        if call.param2 in FORCE and is_stopped:
            answered = await self._clear(call.sender)
            if answered is None:
                return NO_STOP
        if answered is None or answered.ok:
            answered = await self._vehicle.control.perform(call.sender, Arm())
        words = "" if answered.ok else f"{PREARM}{answered.why}"
        return CommandAnswer(result_of(answered), words, Severity.CRITICAL)

    async def _clear(self, sender: Sender) -> Answered | None:
        """Release the newest stop seen now: the request waits for those before.

        A stop that a client has just pressed may be acknowledged before the status shows it. None
        if none has been seen.
        """
        known = (self._vehicle.stop_id, self._pressed_id)
        stop_ids = tuple(one for one in known if one is not None)
        if not stop_ids:
            return None
        return await self._vehicle.control.perform(sender, ClearEmergencyStop(stop_ids=stop_ids))

    async def _clear_stop(self, sender: Sender) -> CommandAnswer:
        answered = await self._clear(sender)
        return NO_STOP if answered is None else answer_to(answered)

    def _check(self, call: CommandCall) -> CommandAnswer:
        status = self._vehicle.snapshot.status
        if status is not None and status.vehicle == VehicleState.ACTIVE:
            return CommandAnswer(LATER, "already armed")
        for fault in arming_faults(self._vehicle.snapshot):
            words, client = f"{PREARM}{fault}", call.sender.client
            self._vehicle.refusals.say(words, client, call.now_ns, Severity.CRITICAL)
        return CommandAnswer(ACCEPTED)

    def _terminate(self, call: CommandCall) -> Handled | None:
        if is_termination(call):
            self._pressed_id, ended = self._vehicle.port.stop()
            return ended
        if call.param1 == 0.0:
            return self._clear_stop(call.sender)
        words = "parameter 1 must be 1 to stop or 0 to clear the emergency stop"
        return CommandAnswer(DENIED, words)


def is_disarm(call: CommandCall) -> bool:
    """Return whether a COMPONENT_ARM_DISARM only stops the robot."""
    return call.param1 == 0.0


def is_termination(call: CommandCall) -> bool:
    """Return whether a DO_FLIGHTTERMINATION stops the robot, as more than 0.5 does."""
    return call.param1 > 0.5


HOME_POSITION: Final = mavlink.MAVLINK_MSG_ID_HOME_POSITION
RESTART: Final = 1.0
NO_RESTART_ARMED: Final = "no restart while the robot is armed: disarm first"
NO_HOME: Final = "the home is too far from the origin"
ONLY_RESTART: Final = "parameter 1 must be 1: only a restart is supported"


class UpkeepCommands:
    """The handlers for one vehicle."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_DO_SEND_BANNER: CommandRow(self._send_banner, reads=True),
                mavlink.MAV_CMD_GET_HOME_POSITION: CommandRow(self._get_home, reads=True),
                mavlink.MAV_CMD_DO_SET_HOME: CommandRow(self._set_home, outlasts=True),
                mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: CommandRow(self._restart, outlasts=True),
            }
        )

    def _send_banner(self, call: CommandCall) -> CommandAnswer:
        vehicle = self._vehicle
        for line in ardupilot.banner(vehicle.port.name, vehicle.commit):
            vehicle.refusals.say(line, call.sender.client, call.now_ns, Severity.INFO)
        return CommandAnswer(ACCEPTED)

    def _get_home(self, call: CommandCall) -> CommandAnswer:
        is_sent = self._tell_home(call.sender.client, call.now_ns)
        return CommandAnswer(ACCEPTED) if is_sent else CommandAnswer(LATER, NO_HOME)

    def _set_home(self, call: CommandCall) -> Handled:
        try:
            home = self._wanted_home(call)
        except SetpointError as error:
            return CommandAnswer(DENIED, str(error))
        if not call.is_global:
            return CommandAnswer(UNSUPPORTED_FRAME, f"frame {call.frame} is not global")
        return self._choose_home(home, call.sender)

    async def _choose_home(self, home: Destination, sender: Sender) -> Answered:
        answered = await self._vehicle.control.ensure(sender)
        if answered.ok:
            self._vehicle.home = home.x_m, home.y_m
            self._vehicle.is_home_chosen = True
            self._tell_home(EVERYONE, self._vehicle.snapshot.now_ns)
        return answered

    def _wanted_home(self, call: CommandCall) -> Destination:
        """Return the robot's position for parameter 1 = 1, otherwise the given position."""
        if call.param1 != 1.0:
            origin = self._vehicle.origin
            return place_goal(origin, call.latitude_deg, call.longitude_deg, None)
        odometry = self._vehicle.snapshot.odometry
        if odometry is None or not knows_place(odometry):
            raise SetpointError(NO_POSE)
        return destination(odometry.x_m, odometry.y_m, None)

    def _tell_home(self, client: int | None, now_ns: int) -> bool:
        """Send HOME_POSITION as it is now; return whether it could be built."""
        source = self._vehicle.catalogue.find(HOME_POSITION)
        messages = () if source is None else source.build(now_ns)
        for message in messages:
            self._vehicle.outbox.send(message, client)
        return bool(messages)

    def _restart(self, call: CommandCall) -> Handled:
        status = self._vehicle.snapshot.status
        if call.param1 != RESTART:
            return CommandAnswer(DENIED, ONLY_RESTART)
        if status is None:
            return CommandAnswer(LATER, NO_TELEMETRY)
        if status.vehicle == VehicleState.ACTIVE:
            return CommandAnswer(DENIED, NO_RESTART_ARMED)
        return self._vehicle.control.perform(call.sender, Restart())


SET_GLOBAL_ORIGIN: Final = 611
"""MAV_CMD_DO_SET_GLOBAL_ORIGIN, which is missing in pymavlink 2.4.50."""
MAX_ALTITUDE_MM: Final = 20_000_000
NO_PLACE: Final = "origin: latitude -85 to 85, longitude -180 to 180, not both 0"
ORIGIN_ARMED: Final = "origin: it moves only while the robot is disarmed"
ORIGIN_UNSEEN: Final = "origin: it moves only while the robot is seen to be disarmed"
Refusal = tuple[int, str]


class OriginService(MavService):
    """Moves the origin for clients."""

    handles = (mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN,)

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType({SET_GLOBAL_ORIGIN: CommandRow(self._command, outlasts=True)})

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Move the origin, and send it also if it was not moved."""
        place = GlobalPlace(message.latitude, message.longitude)
        _, words = self._move(place, message.altitude, sender)
        if words:
            self._vehicle.refusals.say(words, sender.client, now_ns, Severity.WARNING)
        self._tell(sender.client if words else EVERYONE, now_ns)

    def _command(self, call: CommandCall) -> CommandAnswer:
        if not all(map(isfinite, (call.latitude_deg, call.longitude_deg, call.z))):
            return CommandAnswer(DENIED, NO_PLACE)
        place = place_of(call.latitude_deg, call.longitude_deg)
        result, words = self._move(place, round(call.z * MM_PER_M), call.sender)
        self._tell(call.sender.client if words else EVERYONE, call.now_ns)
        return CommandAnswer(result, words)

    def _move(self, place: GlobalPlace, height_mm: int, sender: Sender) -> Refusal:
        """Return the result and, for a refusal, the reason."""
        vehicle = self._vehicle
        home, refusal = home_at(place), vehicle.control.refusal(sender)
        if not sender.may_command:
            return DENIED, sender.barred
        if refusal is not None:
            return RESULT_NOT_IN_CONTROL, refusal.text
        if home is None or abs(height_mm) > MAX_ALTITUDE_MM:
            return DENIED, NO_PLACE
        here = place_of(vehicle.origin.latitude_deg, vehicle.origin.longitude_deg)
        if (place, height_mm) != (here, altitude_mm(vehicle)):
            status = vehicle.snapshot.status
            if status is None or status.vehicle == VehicleState.ACTIVE:
                return LATER, ORIGIN_UNSEEN if status is None else ORIGIN_ARMED
            vehicle.origin, vehicle.origin_altitude_m = home, height_mm / MM_PER_M
        return ACCEPTED, ""

    def _tell(self, client: int | None, now_ns: int) -> None:
        messages = [*gps_origin(self._vehicle, now_ns)]
        if client is EVERYONE:
            messages += home_position(self._vehicle, now_ns)
        for message in messages:
            self._vehicle.outbox.send(message, client)


KEY_ARMED: Final = (
    "signing: the key changes only while all robots are disarmed, and this one is seen to be"
)
KEY_STRANGER: Final = (
    "signing: the key changes only from this machine, or signed with the present key"
)
KEY_NEEDED: Final = "signing: an endpoint requires it, so it cannot be ended here"


class SigningSetup(MavService):
    """Changes the key of the gateway for clients of one vehicle."""

    handles = (mavlink.MAVLINK_MSG_ID_SETUP_SIGNING,)

    def __init__(self, vehicle: MavVehicle, guard: SigningGuard) -> None:
        self._vehicle = vehicle
        self._guard = guard
        guard.watch(lambda: vehicle.is_armed)

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Change the key, or refuse with a text; a repetition changes nothing."""
        secret = bytes(message.secret_key)
        wanted = None if secret == NO_KEY else secret
        words = self._refusal(sender, wanted)
        if not words and not self._is_in_force(wanted):
            try:
                self._guard.replace_key(wanted)
            except UserError as error:
                words = f"signing: {error}"
        if words:
            self._vehicle.refusals.say(words, sender.client, now_ns, Severity.ERROR)

    def _is_in_force(self, wanted: bytes | None) -> bool:
        return not self._guard.is_signing if wanted is None else self._guard.is_current(wanted)

    def _refusal(self, sender: Sender, wanted: bytes | None) -> str:
        is_local = sender.is_loopback and sender.may_command
        if not (sender.is_signed or is_local):
            return KEY_STRANGER
        if self._vehicle.snapshot.status is None or self._guard.is_any_armed:
            return KEY_ARMED
        if wanted is None and self._guard.is_required:
            return KEY_NEEDED
        return ""
