"""Answers to the client of a transfer: the MAV_MISSION_RESULT of each refusal, with its text."""

from types import MappingProxyType
from typing import Final, NamedTuple

from gateways.mavlink.mav_service import NEWCOMER, WATCHER, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MissionAck, mavlink
from gateways.mavlink.robot_port import Answered
from ground.client.missions import TransferOutcome
from ground.missions.qgroundcontrol import ItemPart
from protocol.wire.enums import Severity
from protocol.wire.reasons import Reason, reason_text

ACCEPTED: Final = mavlink.MAV_MISSION_ACCEPTED
ERROR: Final = mavlink.MAV_MISSION_ERROR
"""No mission is taken right now."""
UNSUPPORTED: Final = mavlink.MAV_MISSION_UNSUPPORTED
NO_SPACE: Final = mavlink.MAV_MISSION_NO_SPACE
INVALID: Final = mavlink.MAV_MISSION_INVALID
SEQUENCE: Final = mavlink.MAV_MISSION_INVALID_SEQUENCE
DENIED: Final = mavlink.MAV_MISSION_DENIED
"""No mission is taken from this client."""
CANCELLED: Final = mavlink.MAV_MISSION_OPERATION_CANCELLED

PART_RESULTS: Final = MappingProxyType(
    {
        ItemPart.COMMAND: UNSUPPORTED,
        ItemPart.PARAM1: mavlink.MAV_MISSION_INVALID_PARAM1,
        ItemPart.PARAM2: mavlink.MAV_MISSION_INVALID_PARAM2,
        ItemPart.PARAM3: mavlink.MAV_MISSION_INVALID_PARAM3,
        ItemPart.PARAM4: mavlink.MAV_MISSION_INVALID_PARAM4,
        ItemPart.PARAM5: mavlink.MAV_MISSION_INVALID_PARAM5_X,
        ItemPart.PARAM6: mavlink.MAV_MISSION_INVALID_PARAM6_Y,
        ItemPart.PARAM7: mavlink.MAV_MISSION_INVALID_PARAM7,
        ItemPart.FRAME: mavlink.MAV_MISSION_UNSUPPORTED_FRAME,
        ItemPart.SHAPE: INVALID,
    }
)
REASON_RESULTS: Final = MappingProxyType(
    {
        Reason.LEASE_HELD: DENIED,
        Reason.NO_IDENTITY: DENIED,
        Reason.GOAL_OUT_OF_RANGE: INVALID,
        Reason.OUTSIDE_FENCE: INVALID,
        Reason.TOLERANCE_OUT_OF_RANGE: mavlink.MAV_MISSION_INVALID_PARAM2,
        Reason.HOLD_OUT_OF_RANGE: mavlink.MAV_MISSION_INVALID_PARAM1,
        Reason.PARAMETER_OUT_OF_RANGE: INVALID,
        Reason.UNKNOWN_FRAME: mavlink.MAV_MISSION_UNSUPPORTED_FRAME,
        Reason.UNKNOWN_COMMAND: UNSUPPORTED,
        Reason.MISSION_ITEM_BAD: SEQUENCE,
        Reason.MISSION_EMPTY: INVALID,
        Reason.MISSION_TOO_LONG: NO_SPACE,
        Reason.FENCE_NOT_SIMPLE: INVALID,
        Reason.FENCE_LEAVES_ROBOT_OUT: INVALID,
        Reason.MALFORMED: INVALID,
    }
)
"""The results of reasons; that of all others is ERROR."""


class Refusal(NamedTuple):
    """A result that is not ACCEPTED, with its reason."""

    result: int
    words: str


def refusal_of(answered: Answered, name: str, home_items: int) -> Refusal:
    """Return the refusal of a request about a `name`, whose items follow `home_items` others."""
    outcome = answered.outcome
    number = getattr(outcome, "reason", None)
    if not isinstance(number, int):
        is_watcher = answered.error in (WATCHER, NEWCOMER)
        return Refusal(DENIED if is_watcher else ERROR, f"{name}: {answered.text}")
    item = outcome.item if isinstance(outcome, TransferOutcome) else None
    if number == Reason.MISSION_TOO_LONG and item is not None:
        return Refusal(NO_SPACE, f"{name}: the robot takes at most {item - 1} items")
    where = name if item is None else f"{name} item {item - 1 + home_items}"
    holder = getattr(outcome, "holder", "")
    words = f"{where}: {reason_text(number)}{f': {holder}' if holder else ''}"
    known = number in REASON_RESULTS
    return Refusal(REASON_RESULTS[Reason(number)] if known else ERROR, words)


ClientKey = tuple[int, int, int, bool]


def key_of(sender: Sender) -> ClientKey:
    """Return the key of a client. A peer with and without the right to command has two keys."""
    return sender.client, sender.system, sender.component, sender.may_command


class Answers:
    """Sends the result of a transfer, and the reason of a refusal."""

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle

    def acknowledge(
        self, sender: Sender, kind: int, result: int = ACCEPTED, opaque_id: int = 0
    ) -> None:
        """Send a MISSION_ACK."""
        ack = MissionAck(sender.system, sender.component, result, kind, opaque_id)
        self._vehicle.outbox.send(ack, sender.client)

    def refuse(self, sender: Sender, kind: int, refusal: Refusal) -> None:
        """Send a MISSION_ACK with a result, and a STATUSTEXT with the reason."""
        self.say(sender, refusal.words)
        self.acknowledge(sender, kind, refusal.result)

    def say(self, sender: Sender, words: str, severity: Severity = Severity.WARNING) -> None:
        """Send a STATUSTEXT to a client."""
        vehicle = self._vehicle
        vehicle.refusals.say(words, sender.client, vehicle.snapshot.now_ns, severity)
