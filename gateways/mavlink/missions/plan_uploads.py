"""Uploads of one kind: the vehicle requests the items one after another.

Items are asked for by MISSION_REQUEST, which all clients answer, some with MISSION_ITEM and others
with MISSION_ITEM_INT. Only a complete upload is sent to the robot.

The result is sent once, also on a lossy line: a client takes a copy for the result of its next
upload. If it is lost, a client that repeats the last item gets it again; any other client reports a
failure, and its user repeats the upload.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final, NamedTuple

from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.missions.plan_answers import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    ERROR,
    PART_RESULTS,
    SEQUENCE,
    Answers,
    ClientKey,
    Refusal,
    key_of,
    refusal_of,
)
from gateways.mavlink.missions.plan_items import item_in
from gateways.mavlink.missions.plan_kinds import ItemKind
from gateways.mavlink.robot_port import Answered
from ground.client.missions import TransferOutcome
from ground.commands.mission import AnnounceItems
from ground.missions.qgroundcontrol import UnsupportedItemError
from protocol.wire.enums import Severity
from runtime.units import NS_PER_MS, NS_PER_S

RETRY_NS: Final = 400 * NS_PER_MS
TIMEOUT_NS: Final = 8 * NS_PER_S
"""An upload ends if no item arrives for this time; ArduPilot waits equally long."""
RECENT_NS: Final = 10 * NS_PER_S
"""Items that arrive within this time after the end of their upload are copies or repetitions."""
LAST_REQUESTS: Final = 8
"""On a lossy line."""
MAX_PENDING: Final = 4
"""Announcements that wait for the robot, of uploads that their clients have cancelled."""
ACTIVE_NS: Final = NS_PER_S
GUIDED_ITEMS: Final = (2, 3)
"""Values of `current` of items that belong to no upload."""
ROUGH: Final = "the places of MISSION_ITEM are exact to about 1 m only: use MISSION_ITEM_INT"


class Phase(Enum):
    """The event that an upload waits for."""

    ANNOUNCED = 1  # The robot's answer whether it accepts this number of items.
    RECEIVING = 2  # The client's next item.
    STORING = 3  # The robot's verdict.


@dataclass(slots=True, eq=False)
class PlanUpload:
    """A running upload of the items `first` to `last`; `before` and `after` do not change."""

    sender: Sender
    first: int
    last: int
    before: list[Any] = field(default_factory=list)
    after: list[Any] = field(default_factory=list)
    parts: list[Any] = field(default_factory=list)
    phase: Phase = Phase.ANNOUNCED
    asked_ns: int = 0
    heard_ns: int = 0
    notes: set[str] = field(default_factory=set)
    is_float: bool = False

    @property
    def expected(self) -> int:
        """The number of the next item."""
        return self.first + len(self.parts)

    @property
    def count(self) -> int:
        """The number of all items when the upload is complete."""
        return len(self.before) + self.last - self.first + 1 + len(self.after)


class Finished(NamedTuple):
    """The end of the last upload, which is acknowledged again when its last item arrives again."""

    client: ClientKey
    item: int
    result: int
    opaque_id: int
    at_ns: int


class Uploads:
    """Receives items, from one client at a time."""

    def __init__(self, vehicle: MavVehicle, kind: ItemKind[Any, Any], answers: Answers) -> None:
        self._vehicle = vehicle
        self._kind = kind
        self._answers = answers
        self._upload: PlanUpload | None = None
        self._finished: Finished | None = None
        self._pending = 0

    def is_of_other(self, sender: Sender) -> bool:
        """Return whether another client uploads now."""
        upload = self._upload
        return upload is not None and key_of(upload.sender) != key_of(sender)

    def is_active(self, sender: Sender, now_ns: int) -> bool:
        """Return whether items of this client have arrived recently, or are being stored."""
        upload = self._upload
        if upload is None or self.is_of_other(sender):
            return False
        is_receiving = upload.phase is Phase.RECEIVING
        return not is_receiving or (bool(upload.parts) and now_ns - upload.heard_ns < ACTIVE_NS)

    def drop(self) -> None:
        """End the upload without an answer."""
        self._upload = None

    def deny(self, sender: Sender) -> None:
        """Refuse a request while another client uploads."""
        other = self._upload.sender.system if self._upload else 0
        words = f"{self._kind.name}: MAVLink {other} is uploading one now"
        self._answers.refuse(sender, self._kind.number, Refusal(DENIED, words))

    def begin(self, count: int, sender: Sender, now_ns: int) -> None:
        """Begin an upload of `count` items, or begin it again."""
        if self.is_of_other(sender):
            self.deny(sender)
            return
        upload = self._upload
        if upload is not None and upload.phase is Phase.STORING:
            return
        if upload is not None and upload.phase is Phase.ANNOUNCED:
            upload.first, upload.last, upload.before, upload.after = 0, count - 1, [], []
            return
        self._announce(PlanUpload(sender, 0, count - 1, heard_ns=now_ns))

    def begin_partly(
        self, first: int, last: int, parts: Sequence[Any], sender: Sender, now_ns: int
    ) -> None:
        """Begin to replace some items; `parts` are those that the robot has.

        A range that ends one item after the last one is shortened: MAVProxy sends such a range for
        the last item.
        """
        if self.is_of_other(sender) or self._upload is not None:
            self.deny(sender)
            return
        size = len(parts)
        if not 0 <= first <= last <= size or first >= size:
            words = f"{self._kind.name}: there are no items {first} to {last}"
            self._answers.refuse(sender, self._kind.number, Refusal(ERROR, words))
            return
        last = min(last, size - 1)
        before, after = list(parts[:first]), list(parts[last + 1 :])
        self._announce(PlanUpload(sender, first, last, before, after, heard_ns=now_ns))

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Receive an item."""
        upload = self._upload
        if message.current in GUIDED_ITEMS:
            return
        if upload is None:
            self._take_late(message, sender, now_ns)
        elif self.is_of_other(sender):
            self.deny(sender)
        elif upload.phase is Phase.RECEIVING and message.seq == upload.expected:
            self._take(upload, message, now_ns)

    def cancel(self, sender: Sender) -> None:
        """End an upload that its client has cancelled."""
        if not self.is_of_other(sender):
            self._upload = None

    def due(self, now_ns: int) -> None:
        """Request a missing item again, or end the upload."""
        upload = self._upload
        if upload is None or upload.phase is not Phase.RECEIVING:
            return
        if now_ns - upload.heard_ns >= TIMEOUT_NS:
            words = f"{self._kind.name} upload: item {upload.expected} has not arrived"
            self._refuse(upload, Refusal(CANCELLED, words))
        elif now_ns - upload.asked_ns >= RETRY_NS:
            self._ask(upload, now_ns)

    def forget(self, client: int) -> None:
        """End the upload of a client that has disconnected."""
        if self._upload is not None and self._upload.sender.client == client:
            self._upload = None
        if self._finished is not None and self._finished.client[0] == client:
            self._finished = None

    def _announce(self, upload: PlanUpload) -> None:
        if self._pending >= MAX_PENDING:
            self._refuse(upload, Refusal(ERROR, f"{self._kind.name}: too many requests at once"))
        else:
            self._upload = upload
            self._pending += 1
            self._vehicle.start(self._await_announced(upload))

    async def _await_announced(self, upload: PlanUpload) -> None:
        """Ask whether the robot takes so many items; the client may change the number meanwhile.

        An upload without any asks nothing: what it removes takes control when it is stored.
        """
        vehicle, sender, count = self._vehicle, upload.sender, -1
        answered = Answered(None)
        while self._upload is upload and upload.count != count:
            count = upload.count
            robots = count - self._kind.home_items
            if robots > 0:
                question = AnnounceItems(kind=self._kind.type, count=robots)
                answered = await vehicle.control.perform(sender, question)
            else:
                answered = vehicle.control.admission(sender)
            if not answered.ok:
                break
        self._pending -= 1
        if self._upload is not upload:
            return
        if answered.ok:
            now_ns = vehicle.snapshot.now_ns
            upload.phase, upload.heard_ns = Phase.RECEIVING, now_ns
            self._go_on(upload, now_ns)
        else:
            self._refuse(upload, self._refusal(answered))

    def _ask(self, upload: PlanUpload, now_ns: int) -> None:
        upload.asked_ns = now_ns
        sender = upload.sender
        request = mavlink.MAVLink_mission_request_message(
            sender.system, sender.component, upload.expected, self._kind.number
        )
        # DroneKit forgets its upload 0.1 s after it has answered the last request.
        is_last_chance = upload.is_float and upload.expected == upload.last
        is_last_chance &= sender.client in self._vehicle.lossy
        for _ in range(LAST_REQUESTS if is_last_chance else 1):
            self._vehicle.outbox.send(request, sender.client)

    def _take(self, upload: PlanUpload, message: MavMessage, now_ns: int) -> None:
        item = item_in(message)
        try:
            part = self._kind.part_of(item, upload.count)
        except UnsupportedItemError as error:
            words = f"{self._kind.name} item {item.number}: {error}"
            upload.parts.append(None)
            self._refuse(upload, Refusal(PART_RESULTS[error.part], words))
            return
        upload.parts.append(part)
        upload.heard_ns = now_ns
        upload.is_float = message.get_msgId() == mavlink.MAVLINK_MSG_ID_MISSION_ITEM
        rough = f"{self._kind.name}: {ROUGH}"
        is_rough = upload.is_float and item.number >= self._kind.home_items
        upload.notes |= {self._kind.note_on(item), rough if is_rough else ""}
        self._go_on(upload, now_ns)

    def _go_on(self, upload: PlanUpload, now_ns: int) -> None:
        if upload.expected > upload.last:
            upload.phase = Phase.STORING
            self._vehicle.start(self._store(upload))
        else:
            self._ask(upload, now_ns)

    async def _store(self, upload: PlanUpload) -> None:
        try:
            change = self._kind.change_to([*upload.before, *upload.parts, *upload.after])
        except UnsupportedItemError as error:
            refusal = Refusal(PART_RESULTS[error.part], f"{self._kind.name}: {error}")
            self._refuse(upload, refusal)
            return
        answered = await self._vehicle.control.perform(upload.sender, change.operation)
        kind, now_ns, outcome = self._kind, self._vehicle.snapshot.now_ns, answered.outcome
        is_kept = isinstance(outcome, TransferOutcome) and outcome.verdict.in_force
        in_force = answered.ok or is_kept
        if in_force:
            kind.accepted(change.values, answered, now_ns)
        if self._upload is not upload:
            return
        if not in_force:
            self._refuse(upload, self._refusal(answered))
            return
        if not answered.ok:
            self._answers.say(upload.sender, self._refusal(answered).words)
        for note in sorted(upload.notes - {""}):
            self._answers.say(upload.sender, note, Severity.INFO)
        self._end(upload, ACCEPTED, kind.id_of(change.values))

    def _refusal(self, answered: Answered) -> Refusal:
        return refusal_of(answered, self._kind.name, self._kind.home_items)

    def _refuse(self, upload: PlanUpload, refusal: Refusal) -> None:
        self._answers.say(upload.sender, refusal.words)
        self._end(upload, refusal.result, 0)

    def _end(self, upload: PlanUpload, result: int, opaque_id: int) -> None:
        self._upload = None
        now_ns = self._vehicle.snapshot.now_ns
        client = key_of(upload.sender)
        self._finished = Finished(client, upload.expected - 1, result, opaque_id, now_ns)
        self._answers.acknowledge(upload.sender, self._kind.number, result, opaque_id)

    def _take_late(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Acknowledge the last item again; refuse an item that belongs to no upload."""
        last = self._finished
        is_late = last is not None and last.client == key_of(sender)
        if last is None or not is_late or now_ns - last.at_ns >= RECENT_NS:
            words = f"{self._kind.name}: announce items by MISSION_COUNT first"
            self._answers.refuse(sender, self._kind.number, Refusal(SEQUENCE, words))
        elif message.seq == last.item:
            number, opaque_id = self._kind.number, last.opaque_id
            self._answers.acknowledge(sender, number, last.result, opaque_id)
