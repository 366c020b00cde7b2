"""Commands about the robot as a device: its version, its home, and a restart of its process."""

from types import MappingProxyType
from typing import Final

from gateways.mavlink import ardupilot
from gateways.mavlink.commands.call import Call
from gateways.mavlink.commands.results import ACCEPTED, DENIED, LATER, UNSUPPORTED_FRAME
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import mavlink
from gateways.mavlink.frames.ned import knows_place
from gateways.mavlink.motion.setpoints import NO_POSE, SetpointError, destination, place_goal
from gateways.mavlink.port import NO_TELEMETRY, Answered
from gateways.mavlink.traffic import EVERYONE
from gateways.mavlink.vehicle import Vehicle
from ground.client.goal import Destination
from ground.client.operations import Restart
from protocol.wire.enums import Severity
from protocol.wire.enums import Vehicle as VehicleState

HOME: Final = mavlink.MAVLINK_MSG_ID_HOME_POSITION
RESTART: Final = 1.0
ARMED: Final = "no restart while the robot is armed: disarm first"
NO_HOME: Final = "the home is too far from the origin"
ONLY_RESTART: Final = "parameter 1 must be 1: only a restart is supported"


class UpkeepCommands:
    """The handlers for one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType(
            {
                mavlink.MAV_CMD_DO_SEND_BANNER: Row(self._send_banner, reads=True),
                mavlink.MAV_CMD_GET_HOME_POSITION: Row(self._get_home, reads=True),
                mavlink.MAV_CMD_DO_SET_HOME: Row(self._set_home, outlasts=True),
                mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: Row(self._restart, outlasts=True),
            }
        )

    def _send_banner(self, call: Call, reply: Reply) -> None:
        vehicle = self._vehicle
        for line in ardupilot.banner(vehicle.port.name, vehicle.commit):
            vehicle.refusals.say(line, call.sender.client, call.now_ns, Severity.INFO)
        reply.result(ACCEPTED)

    def _get_home(self, call: Call, reply: Reply) -> None:
        is_sent = self._tell_home(call.sender.client, call.now_ns)
        reply.result(ACCEPTED if is_sent else LATER, "" if is_sent else NO_HOME)

    def _set_home(self, call: Call, reply: Reply) -> None:
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

    def _wanted_home(self, call: Call) -> Destination:
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
        source = self._vehicle.catalogue.find(HOME)
        messages = () if source is None else source.build(now_ns)
        for message in messages:
            self._vehicle.outbox.send(message, client)
        return bool(messages)

    def _restart(self, call: Call, reply: Reply) -> None:
        status = self._vehicle.snapshot.status
        if call.param1 != RESTART:
            reply.result(DENIED, ONLY_RESTART)
        elif status is None:
            reply.result(LATER, NO_TELEMETRY)
        elif status.vehicle == VehicleState.ACTIVE:
            reply.result(DENIED, ARMED)
        else:
            self._vehicle.perform(call.sender, Restart(), reply.ended)
