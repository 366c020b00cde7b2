"""Missions and fences of a fake vehicle."""

from dataclasses import dataclass, field
from typing import Any

from tests.support.vehicle_check.core import Peer, mavlink
from tests.support.vehicle_check.files import Files
from tests.support.vehicle_check.streams import LAT, LON
from vehicle_check.mavlink_frames import MISSION_ACK, MISSION_COUNT, ExtraMessage

RETRY_NS = 500_000_000
GIVE_UP_NS = 4_000_000_000
OK, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE, INVALID_LAT, DENIED, CANCELLED = (
    0,
    2,
    3,
    4,
    10,
    14,
    15,
)
KNOWN = {0: {16}, 1: {5001, 5003}, 2: set()}


@dataclass
class Upload:
    """An upload that is going on."""

    peer: Peer
    kind: int
    begin: int
    end: int
    base: list[Any]
    items: dict[int, Any] = field(default_factory=dict)
    asked_ns: int = 0
    heard_ns: int = 0

    @property
    def next(self) -> int:
        """The item to ask for."""
        return self.begin + len(self.items)


class Plans(Files):
    """Takes and gives plans."""

    def __init__(self) -> None:
        super().__init__()
        self.plans: dict[int, list[Any]] = {0: [], 1: [], 2: []}
        self.upload: Upload | None = None
        self.last: tuple[int, int, int] = (-1, -1, OK)

    def due(self, now_ns: int) -> None:
        """Ask again, and give up."""
        super().due(now_ns)
        upload = self.upload
        if upload is None:
            return
        if now_ns - upload.heard_ns >= GIVE_UP_NS:
            self.end_upload(CANCELLED)
        elif now_ns - upload.asked_ns >= RETRY_NS:
            self.ask()

    def ask(self) -> None:
        """Ask for the next item."""
        assert self.upload is not None
        self.upload.asked_ns = self.now_ns
        peer, seq = self.upload.peer, self.upload.next
        self.send(
            mavlink.MAVLink_mission_request_message(
                peer.system, peer.component, seq, self.upload.kind
            ),
            peer,
        )

    def ack(self, peer: Peer, kind: int, result: int) -> None:
        """Send MISSION_ACK."""
        ids = self.plan_ids[kind] if result == OK else 0
        self.send(
            ExtraMessage(
                MISSION_ACK, target_system=peer.system, target_component=peer.component,
                type=result, mission_type=kind, opaque_id=ids,
            ),
            peer,
        )  # fmt: skip

    def end_upload(self, result: int) -> None:
        """End the upload; take the plan if it is whole."""
        upload, self.upload = self.upload, None
        assert upload is not None
        if result == OK:
            plan = upload.base
            plan[upload.begin : upload.end] = [upload.items[one] for one in sorted(upload.items)]
            self.plans[upload.kind] = plan
            self.plan_ids[upload.kind] += 7
            if upload.kind == 0:
                self.current, self.total, self.mission_state = 0, len(plan), 2
        self.last = upload.kind, upload.next - (result == OK), result
        self.ack(upload.peer, upload.kind, result)

    def on_mission_count(self, message: Any, peer: Peer) -> None:
        if self.upload is not None and self.upload.peer is not peer:
            self.ack(peer, message.mission_type, DENIED)
        elif message.count > 100:
            self.text(f"mission of {message.count} items: 100 at most", peer)
            self.ack(peer, message.mission_type, NO_SPACE)
        else:
            now = self.now_ns
            self.upload = Upload(
                peer, message.mission_type, 0, message.count, [], heard_ns=now, asked_ns=now
            )
            self.end_upload(OK) if message.count == 0 else self.ask()

    def on_mission_write_partial_list(self, message: Any, peer: Peer) -> None:
        plan, end = list(self.plans[message.mission_type]), message.end_index + 1
        now = self.now_ns
        self.upload = Upload(
            peer, message.mission_type, message.start_index, end, plan, heard_ns=now
        )
        self.ask()

    def on_mission_item_int(self, message: Any, peer: Peer) -> None:
        self.take(message, peer, message.x, message.y)

    def on_mission_item(self, message: Any, peer: Peer) -> None:
        self.take(message, peer, round(message.x * 1e7), round(message.y * 1e7))

    def take(self, one: Any, peer: Peer, x: int, y: int) -> None:
        """Take an item."""
        upload = self.upload
        if one.current == 2:
            self.guided(one, peer, x, y)
            return
        if upload is None or upload.peer is not peer:
            if (one.mission_type, one.seq) == self.last[:2]:
                self.ack(peer, one.mission_type, self.last[2])
            return
        upload.heard_ns = self.now_ns
        if one.seq != upload.next:
            return
        fault = self.fault(one, x, upload.kind)
        if fault:
            self.text(f"item {one.seq}: refused", peer)
            self.end_upload(fault)
            return
        place = (LAT, LON) if upload.kind == 0 and one.seq == 0 else (x, y)
        values = (one.frame, one.command, 0, 1, one.param1, one.param2, one.param3, one.param4)
        upload.items[one.seq] = (values, place, one.z)
        self.end_upload(OK) if upload.next == upload.end else self.ask()

    def fault(self, one: Any, x: int, kind: int) -> int:
        """Return why an item is refused, 0 for none."""
        if one.command not in KNOWN[kind]:
            return UNSUPPORTED
        if one.frame not in (0, 3, 5, 6):
            return UNSUPPORTED_FRAME
        return INVALID_LAT if abs(x) > 900_000_000 else 0

    def guided(self, one: Any, peer: Peer, x: int, y: int) -> None:
        """Take a guided item; overridden by driving."""

    def on_mission_request_list(self, message: Any, peer: Peer) -> None:
        kind = message.mission_type
        if self.upload is not None:
            self.ack(peer, kind, DENIED)
            return
        self.send(
            ExtraMessage(
                MISSION_COUNT, target_system=peer.system, target_component=peer.component,
                count=len(self.plans[kind]), mission_type=kind, opaque_id=self.plan_ids[kind],
            ),
            peer,
        )  # fmt: skip

    def on_mission_request(self, message: Any, peer: Peer) -> None:
        self.give(message, peer, as_float=True)

    def on_mission_request_int(self, message: Any, peer: Peer) -> None:
        self.give(message, peer, as_float=False)

    def give(self, message: Any, peer: Peer, *, as_float: bool) -> None:
        """Send an item."""
        values, (x, y), z = self.plans[message.mission_type][message.seq]
        head = (peer.system, peer.component, message.seq, *values)
        if as_float:
            item = mavlink.MAVLink_mission_item_message(
                *head, x / 1e7, y / 1e7, z, message.mission_type
            )
        else:
            item = mavlink.MAVLink_mission_item_int_message(*head, x, y, z, message.mission_type)
        self.send(item, peer)

    def on_mission_clear_all(self, message: Any, peer: Peer) -> None:
        self.plans[message.mission_type] = []
        self.ack(peer, message.mission_type, OK)

    def on_mission_set_current(self, message: Any, peer: Peer) -> None:
        self.current = message.seq
        self.stream("MISSION_CURRENT", None)
