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
    CommandCall,
    CommandReply,
    CommandRow,
    CommandTable,
    result_of,
)
from gateways.mavlink.coordinates import GlobalPlace, home_at, knows_place, place_of
from gateways.mavlink.mav_service import EVERYONE, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import RESULT_NOT_IN_CONTROL, MavMessage, mavlink
from gateways.mavlink.motion.setpoints import NO_POSE, SetpointError, destination, place_goal
from gateways.mavlink.robot_port import NO_TELEMETRY, Answered, Done, arming_faults
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
REFUSED: Final = "refused: "


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

    def _arm_disarm(self, call: CommandCall, reply: CommandReply) -> None:
        is_forced = call.param2 in FORCE
        if call.param1 == 1.0:
            self._arm(call, reply, is_forced=is_forced)
        elif call.param1 == 0.0:
            self._vehicle.perform(call.sender, Disarm(), reply.ended)
        else:
            reply.result(DENIED, "parameter 1 must be 1 to arm or 0 to disarm")

    def _arm(self, call: CommandCall, reply: CommandReply, *, is_forced: bool) -> None:
        def ended(answered: Answered) -> None:
            words = "" if answered.ok else f"{PREARM}{answered.text.removeprefix(REFUSED)}"
            reply.result(result_of(answered), words, Severity.CRITICAL)

        def arm(answered: Answered) -> None:
            if answered.ok:
                self._vehicle.perform(call.sender, Arm(), ended)
            else:
                ended(answered)

        status = self._vehicle.snapshot.status
        is_stopped = status is not None and status.vehicle == VehicleState.EMERGENCY_STOP
        if is_forced and is_stopped:
            self._clear(call, reply, arm)
        else:
            self._vehicle.perform(call.sender, Arm(), ended)

    def _clear(self, call: CommandCall, reply: CommandReply, done: Done) -> None:
        """Release the newest stop seen now: the request waits for those before.

        A stop that a client has just pressed may be acknowledged before the status shows it.
        """
        known = (self._vehicle.stop_id, self._pressed_id)
        stop_ids = tuple(one for one in known if one is not None)
        if not stop_ids:
            reply.result(LATER, "no status of the robot has named an emergency stop yet")
        else:
            self._vehicle.perform(call.sender, ClearEmergencyStop(stop_ids=stop_ids), done)

    def _stop(self, reply: CommandReply) -> None:
        self._pressed_id = self._vehicle.port.stop(reply.ended)

    def _check(self, call: CommandCall, reply: CommandReply) -> None:
        status = self._vehicle.snapshot.status
        if status is not None and status.vehicle == VehicleState.ACTIVE:
            reply.result(LATER, "already armed")
            return
        for fault in arming_faults(self._vehicle.snapshot):
            words, client = f"{PREARM}{fault}", call.sender.client
            self._vehicle.refusals.say(words, client, call.now_ns, Severity.CRITICAL)
        reply.result(ACCEPTED)

    def _terminate(self, call: CommandCall, reply: CommandReply) -> None:
        if is_termination(call):
            self._stop(reply)
        elif call.param1 == 0.0:
            self._clear(call, reply, reply.ended)
        else:
            reply.result(DENIED, "parameter 1 must be 1 to stop or 0 to clear the emergency stop")


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

    def _send_banner(self, call: CommandCall, reply: CommandReply) -> None:
        vehicle = self._vehicle
        for line in ardupilot.banner(vehicle.port.name, vehicle.commit):
            vehicle.refusals.say(line, call.sender.client, call.now_ns, Severity.INFO)
        reply.result(ACCEPTED)

    def _get_home(self, call: CommandCall, reply: CommandReply) -> None:
        is_sent = self._tell_home(call.sender.client, call.now_ns)
        reply.result(ACCEPTED if is_sent else LATER, "" if is_sent else NO_HOME)

    def _set_home(self, call: CommandCall, reply: CommandReply) -> None:
        try:
            home = self._wanted_home(call)
        except SetpointError as error:
            reply.result(DENIED, str(error))
            return
        if not call.is_global:
            reply.result(UNSUPPORTED_FRAME, f"frame {call.frame} is not global")
            return

        def ensured(answered: Answered) -> None:
            if answered.ok:
                self._vehicle.home = home.x_m, home.y_m
                self._vehicle.is_home_chosen = True
                self._tell_home(EVERYONE, self._vehicle.snapshot.now_ns)
            reply.ended(answered)

        self._vehicle.control.ensure(call.sender, ensured)

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

    def _restart(self, call: CommandCall, reply: CommandReply) -> None:
        status = self._vehicle.snapshot.status
        if call.param1 != RESTART:
            reply.result(DENIED, ONLY_RESTART)
        elif status is None:
            reply.result(LATER, NO_TELEMETRY)
        elif status.vehicle == VehicleState.ACTIVE:
            reply.result(DENIED, NO_RESTART_ARMED)
        else:
            self._vehicle.perform(call.sender, Restart(), reply.ended)


SET_GLOBAL_ORIGIN: Final = 611
"""MAV_CMD_DO_SET_GLOBAL_ORIGIN, which is missing in pymavlink 2.4.50."""
MAX_ALTITUDE_MM: Final = 20_000_000
NO_PLACE: Final = "origin: latitude -85 to 85, longitude -180 to 180, not both 0"
ORIGIN_ARMED: Final = "origin: it moves only while the robot is disarmed"
ORIGIN_UNSEEN: Final = "origin: it moves only while the robot is seen to be disarmed"
Refusal = tuple[int, str]


class OriginService:
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

    def due(self, now_ns: int) -> None:
        """Do nothing: no state of this service depends on time."""

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

    def _command(self, call: CommandCall, reply: CommandReply) -> None:
        if not all(map(isfinite, (call.latitude_deg, call.longitude_deg, call.z))):
            reply.result(DENIED, NO_PLACE)
            return
        place = place_of(call.latitude_deg, call.longitude_deg)
        result, words = self._move(place, round(call.z * MM_PER_M), call.sender)
        reply.result(result, words)
        self._tell(call.sender.client if words else EVERYONE, call.now_ns)

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


class SigningSetup:
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

    def due(self, now_ns: int) -> None:
        """Do nothing: no state of this service depends on time."""

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

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
