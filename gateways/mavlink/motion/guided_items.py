"""Guided mission items: a waypoint with `current` = 2 is a goal at once, not part of a mission."""

from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.frames.globe import PER_DEG
from gateways.mavlink.motion.pilot import Pilot
from gateways.mavlink.motion.setpoints import GLOBAL_FRAMES, SetpointError, place_goal
from gateways.mavlink.port import Answered
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle
from ground.client.results import Refused
from protocol.wire.enums import Mode
from protocol.wire.reasons import Reason

GUIDED: Final = 2
ALTITUDE: Final = 3
"""Values of `current`; a change of the altitude is refused."""
NOT_IN_CONTROL: Final = (Reason.LEASE_HELD, Reason.NO_IDENTITY)


class GuidedItems:
    """Executes guided items for one vehicle and acknowledges them."""

    handles = (mavlink.MAVLINK_MSG_ID_MISSION_ITEM, mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT)

    def __init__(self, vehicle: Vehicle, pilot: Pilot) -> None:
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
            return

        def ended(answered: Answered) -> None:
            self._answer(sender, *result_of(answered), self._vehicle.snapshot.now_ns)

        self._pilot.goto(goal, sender, ended)

    def due(self, now_ns: int) -> None:
        """Do nothing: no state of this service depends on time."""

    def forget(self, client: int) -> None:
        """Keep nothing for a client."""

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
