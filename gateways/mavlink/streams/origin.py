"""The origin: SET_GPS_GLOBAL_ORIGIN and DO_SET_GLOBAL_ORIGIN move it, GPS_GLOBAL_ORIGIN reports it.

The robot's local metres do not change; their positions on Earth move with the origin. A change is
refused while the robot is armed, and while another client is in control.
"""

from math import isfinite
from types import MappingProxyType
from typing import Final

from gateways.mavlink.commands.call import Call
from gateways.mavlink.commands.results import ACCEPTED, DENIED, LATER
from gateways.mavlink.commands.service import CommandTable, Reply, Row
from gateways.mavlink.dialect import RESULT_NOT_IN_CONTROL, MavMessage, mavlink
from gateways.mavlink.frames.globe import Place, home_at, place_of
from gateways.mavlink.frames.ned import MM_PER_M
from gateways.mavlink.streams.position import altitude_mm, gps_origin, home_position
from gateways.mavlink.traffic import EVERYONE, Sender
from gateways.mavlink.vehicle import Vehicle
from protocol.wire.enums import Severity
from protocol.wire.enums import Vehicle as VehicleState

SET_GLOBAL_ORIGIN: Final = 611
"""MAV_CMD_DO_SET_GLOBAL_ORIGIN, which is missing in pymavlink 2.4.50."""
MAX_ALTITUDE_MM: Final = 20_000_000
NO_PLACE: Final = "origin: latitude -85 to 85, longitude -180 to 180, not both 0"
ARMED: Final = "origin: it moves only while the robot is disarmed"
UNKNOWN: Final = "origin: it moves only while the robot is seen to be disarmed"
Refusal = tuple[int, str]


class OriginService:
    """Moves the origin for clients."""

    handles = (mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN,)

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    @property
    def table(self) -> CommandTable:
        """The commands by their numbers."""
        return MappingProxyType({SET_GLOBAL_ORIGIN: Row(self._command, outlasts=True)})

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Move the origin, and send it also if it was not moved."""
        place = Place(message.latitude, message.longitude)
        _, words = self._move(place, message.altitude, sender)
        if words:
            self._vehicle.refusals.say(words, sender.client, now_ns, Severity.WARNING)
        self._tell(sender.client if words else EVERYONE, now_ns)

    def due(self, now_ns: int) -> None:
        """Do nothing: no state of this service depends on time."""

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

    def _command(self, call: Call, reply: Reply) -> None:
        if not all(map(isfinite, (call.latitude_deg, call.longitude_deg, call.z))):
            reply.result(DENIED, NO_PLACE)
            return
        place = place_of(call.latitude_deg, call.longitude_deg)
        result, words = self._move(place, round(call.z * MM_PER_M), call.sender)
        reply.result(result, words)
        self._tell(call.sender.client if words else EVERYONE, call.now_ns)

    def _move(self, place: Place, height_mm: int, sender: Sender) -> Refusal:
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
                return LATER, UNKNOWN if status is None else ARMED
            vehicle.origin, vehicle.origin_altitude_m = home, height_mm / MM_PER_M
        return ACCEPTED, ""

    def _tell(self, client: int | None, now_ns: int) -> None:
        messages = [*gps_origin(self._vehicle, now_ns)]
        if client is EVERYONE:
            messages += home_position(self._vehicle, now_ns)
        for message in messages:
            self._vehicle.outbox.send(message, client)
