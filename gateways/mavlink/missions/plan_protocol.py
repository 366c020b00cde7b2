"""The mission protocol: each message goes to its kind of plan, for uploads, downloads, deletion."""

from typing import Any, Final

from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from gateways.mavlink.missions.plan_answers import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    ERROR,
    SEQUENCE,
    UNSUPPORTED,
    Answers,
    ClientKey,
    Refusal,
    key_of,
    refusal_of,
)
from gateways.mavlink.missions.plan_items import item_message
from gateways.mavlink.missions.plan_kinds import HOME, ItemKind, MissionKind
from gateways.mavlink.missions.plan_uploads import Uploads
from runtime.errors import RemoteError

MAX_WAITING: Final = 16
"""Requests of all clients that wait for the robot."""


class Downloads:
    """Sends items, unless another client uploads."""

    def __init__(
        self, vehicle: MavVehicle, kind: ItemKind[Any, Any], uploads: Uploads, answers: Answers
    ) -> None:
        self._vehicle = vehicle
        self._kind = kind
        self._uploads = uploads
        self._answers = answers
        self._waiting: set[tuple[ClientKey, int | None]] = set()

    def read(
        self, number: int | None, sender: Sender, now_ns: int, *, is_int: bool = False
    ) -> None:
        """Send an item in the form that was asked for; for None the number of items."""
        if not self._may_read(sender, now_ns):
            return
        waiting = (key_of(sender), number)
        if waiting not in self._waiting and len(self._waiting) < MAX_WAITING:
            self._waiting.add(waiting)
            self._vehicle.start(self._answer(number, sender, now_ns, is_int=is_int))

    async def _answer(
        self, number: int | None, sender: Sender, now_ns: int, *, is_int: bool
    ) -> None:
        """Answer a request: for the number of items as the robot has them now."""
        kind, values, why = self._kind, None, ""
        try:
            values = await (kind.copy.latest(now_ns) if number is None else kind.copy.known(now_ns))
        except RemoteError as error:
            why = str(error)
        self._waiting.discard((key_of(sender), number))
        items = [] if values is None else list(kind.items(values))
        if number == HOME and not items and isinstance(kind, MissionKind):
            items = [kind.home]  # which DroneKit asks for without a mission, too
        if number is not None and number < len(items):
            message = item_message(items[number], kind.number, sender, is_int=is_int)
            self._vehicle.answer(message, sender.client)
        elif values is None:
            self._refuse(sender, ERROR, why)
        elif number is None:
            fields = sender.system, sender.component, len(items), kind.number, kind.id_of(values)
            self._vehicle.answer(MissionCount(*fields), sender.client)
        else:
            self._refuse(sender, SEQUENCE, f"there is no item {number}")

    def forget(self, client: int) -> None:
        """Drop the waiting requests of a client that has disconnected."""
        self._waiting = {one for one in self._waiting if one[0][0] != client}

    def _may_read(self, sender: Sender, now_ns: int) -> bool:
        """Return whether to answer; ignore requests that are older than the client's own upload."""
        if self._uploads.is_of_other(sender):
            self._uploads.deny(sender)
            return False
        if self._uploads.is_active(sender, now_ns):
            return False
        self._uploads.cancel(sender)
        return True

    def _refuse(self, sender: Sender, result: int, why: str) -> None:
        refusal = Refusal(result, f"{self._kind.name}: {why}")
        self._answers.refuse(sender, self._kind.number, refusal)


RALLY: Final = mavlink.MAV_MISSION_TYPE_RALLY
ALL: Final = mavlink.MAV_MISSION_TYPE_ALL
NO_RALLY: Final = Refusal(UNSUPPORTED, "rally points are not supported")
MAX_CLEARING: Final = 8
"""Deletions that wait for the robot."""

COUNT: Final = mavlink.MAVLINK_MSG_ID_MISSION_COUNT
ITEM: Final = mavlink.MAVLINK_MSG_ID_MISSION_ITEM
ITEM_INT: Final = mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
REQUEST_LIST: Final = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST
REQUEST: Final = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST
REQUEST_INT: Final = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT
REQUEST_PARTIAL: Final = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_PARTIAL_LIST
WRITE_PARTIAL: Final = mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST
CLEAR: Final = mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL
ACK: Final = mavlink.MAVLINK_MSG_ID_MISSION_ACK
CHANGING: Final = (COUNT, WRITE_PARTIAL, CLEAR)


class KindTransfers:
    """Uploads, downloads and deletions of one kind."""

    def __init__(self, vehicle: MavVehicle, kind: ItemKind[Any, Any], answers: Answers) -> None:
        self.kind = kind
        self.uploads = Uploads(vehicle, kind, answers)
        self.downloads = Downloads(vehicle, kind, self.uploads, answers)
        self._vehicle = vehicle
        self._answers = answers

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Process a message about this kind."""
        number = message.get_msgId()
        if number == COUNT:
            self.uploads.begin(message.count, sender, now_ns)
        elif number in (ITEM, ITEM_INT):
            self.uploads.receive(message, sender, now_ns)
        elif number == REQUEST_LIST:
            self.downloads.read(None, sender, now_ns)
        elif number in (REQUEST, REQUEST_INT):
            is_int = number == REQUEST_INT
            self.downloads.read(message.seq, sender, now_ns, is_int=is_int)
        elif number == WRITE_PARTIAL:
            self._begin_partly(message.start_index, message.end_index, sender, now_ns)
        elif number == REQUEST_PARTIAL:
            words = f"{self.kind.name}: ask for the whole list"
            self._answers.refuse(sender, self.kind.number, Refusal(UNSUPPORTED, words))
        elif message.type == CANCELLED:
            self.uploads.cancel(sender)

    def due(self, now_ns: int) -> None:
        """Do what is due."""
        self.kind.copy.due(now_ns)
        self.uploads.due(now_ns)

    def forget(self, client: int) -> None:
        """Drop the state of a client that has disconnected."""
        self.uploads.forget(client)
        self.downloads.forget(client)

    def _begin_partly(self, first: int, last: int, sender: Sender, now_ns: int) -> None:
        if self.uploads.is_of_other(sender):
            self.uploads.deny(sender)
        elif not self.uploads.is_active(sender, now_ns):
            self.uploads.cancel(sender)
            self._vehicle.start(self._change_partly(first, last, sender, now_ns))

    async def _change_partly(self, first: int, last: int, sender: Sender, now_ns: int) -> None:
        try:
            parts = self.kind.parts(await self.kind.copy.latest(now_ns))
        except RemoteError as error:
            words = f"{self.kind.name}: {error}"
            self._answers.refuse(sender, self.kind.number, Refusal(ERROR, words))
        else:
            self.uploads.begin_partly(first, last, parts, sender, now_ns)


class MissionProtocol(MavService):
    """Missions and fences of one vehicle; there are no rally points."""

    handles = (
        *(COUNT, ITEM, ITEM_INT, REQUEST_LIST, REQUEST, REQUEST_INT),
        *(REQUEST_PARTIAL, WRITE_PARTIAL, CLEAR, ACK),
    )

    def __init__(self, vehicle: MavVehicle, *kinds: ItemKind[Any, Any]) -> None:
        self._vehicle = vehicle
        self._answers = Answers(vehicle)
        self._kinds = {kind.number: KindTransfers(vehicle, kind, self._answers) for kind in kinds}
        self._clearing: set[tuple[ClientKey, int]] = set()

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Process a message of the mission protocol."""
        number, found = message.mission_type, self._kinds.get(message.mission_type)
        if message.get_msgId() in CHANGING and not sender.may_command:
            self._answers.refuse(sender, number, Refusal(DENIED, sender.barred))
        elif message.get_msgId() == CLEAR:
            self._clear(number, sender, now_ns)
        elif found is not None:
            found.receive(message, sender, now_ns)
        else:
            self._refuse_kind(message, number, sender)

    def due(self, now_ns: int) -> None:
        """Do what is due."""
        for transfers in self._kinds.values():
            transfers.due(now_ns)

    def forget(self, client: int) -> None:
        """Drop the state of a client that has disconnected."""
        for transfers in self._kinds.values():
            transfers.forget(client)

    def _refuse_kind(self, message: MavMessage, number: int, sender: Sender) -> None:
        """Answer about rally points, of which there are none, or about an unknown kind."""
        asked, is_rally = message.get_msgId(), number == RALLY
        if asked == ACK:
            return
        if asked == REQUEST_LIST and is_rally:
            count = mavlink.MAVLink_mission_count_message(sender.system, sender.component, 0, RALLY)
            self._vehicle.outbox.send(count, sender.client)
        elif asked == COUNT and is_rally and message.count == 0:
            self._answers.acknowledge(sender, RALLY)
        elif asked in (REQUEST, REQUEST_INT) and is_rally:
            self._answers.acknowledge(sender, RALLY, SEQUENCE)
        else:
            unknown = Refusal(UNSUPPORTED, f"there is no mission type {number}")
            self._answers.refuse(sender, number, NO_RALLY if is_rally else unknown)

    def _clear(self, number: int, sender: Sender, now_ns: int) -> None:
        """Delete all items of a kind, or of all kinds.

        A deletion that arrives during the client's own upload is a copy of an earlier one.
        """
        chosen = [one for key, one in self._kinds.items() if number in (key, ALL)]
        denying = [one for one in chosen if one.uploads.is_of_other(sender)]
        waiting = (key_of(sender), number)
        if denying:
            denying[0].uploads.deny(sender)
        elif number == RALLY:
            self._answers.acknowledge(sender, RALLY)
        elif not chosen:
            words = f"there is no mission type {number}"
            self._answers.refuse(sender, number, Refusal(UNSUPPORTED, words))
        elif len(self._clearing) >= MAX_CLEARING:
            self._answers.refuse(sender, number, Refusal(ERROR, "too many requests at once"))
        elif waiting not in self._clearing and not any(
            one.uploads.is_active(sender, now_ns) for one in chosen
        ):
            self._clearing.add(waiting)
            self._vehicle.start(self._clear_all(chosen, number, sender))

    async def _clear_all(self, kinds: list[KindTransfers], number: int, sender: Sender) -> None:
        refusal = None
        for transfers in kinds:
            kind = transfers.kind
            transfers.uploads.cancel(sender)
            answered = await self._vehicle.control.perform(sender, kind.clearing())
            if not answered.ok:
                refusal = refusal_of(answered, kind.name, kind.home_items)
                break
            kind.accepted((), answered, self._vehicle.snapshot.now_ns)
        self._clearing.discard((key_of(sender), number))
        if refusal is None:
            self._answers.acknowledge(sender, number, ACCEPTED)
        else:
            self._answers.refuse(sender, number, refusal)
