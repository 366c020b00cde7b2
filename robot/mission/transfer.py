"""MAVLink's mission protocol: items are uploaded one by one and accepted as a whole.

Sans-I/O. Each request gets one frame as its answer. A client that receives no answer repeats its
request; the repeated request is answered again but acted on once.
"""

from typing import Final, Protocol, TypeAlias

from protocol.wire.enums import MissionType
from protocol.wire.messages import (
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
)
from robot.core import reasons
from robot.mission.mission import Mission
from robot.mission.persistence import MissionStore

NO_ITEM: Final = 65_535

Request: TypeAlias = (
    MissionCount | MissionItemInt | MissionRequestList | MissionRequestInt | MissionClearAll
)
Reply: TypeAlias = MissionCount | MissionRequestInt | MissionItemInt | MissionVerdict


class ItemStore(Protocol):
    """A receiver of uploaded items, which accepts them as a whole or not at all."""

    max_items: int
    items: tuple[MissionItemInt, ...]

    def put(self, items: tuple[MissionItemInt, ...]) -> tuple[int | None, int]:
        """Replace the items; return the index of a bad item, if any, and a reason, 0 if done."""

    def clear(self) -> int:
        """Remove all items and return a reason, 0 if done."""


class ReceivedItems:
    """A running upload of one operator; `verdict` is set once all items have arrived."""

    def __init__(self, count: int, operator: str) -> None:
        self.count = count
        self.operator = operator
        self.items: list[MissionItemInt] = []
        self.verdict: MissionVerdict | None = None


class Transfers:
    """Answers the frames of all transfers of one robot."""

    def __init__(self, mission: Mission, fence: ItemStore, kept: MissionStore) -> None:
        self._mission = mission
        self._kept = kept
        self._held: dict[int, ItemStore] = {MissionType.MISSION: mission, MissionType.FENCE: fence}
        self._uploads: dict[int, ReceivedItems] = {}

    def receive(self, request: Request, operator: str = "") -> Reply:
        """Return the next frame of the transfer, or the verdict that ends it."""
        kind = request.mission_type
        held = self._held.get(kind)
        if held is None:
            return self.verdict(kind, reasons.UNKNOWN_COMMAND)
        if isinstance(request, MissionItemInt):
            return self._collect(request, held, operator)
        if isinstance(request, MissionCount):
            return self._begin(request, held, operator)
        if isinstance(request, MissionRequestInt):
            if request.seq < len(held.items):
                return held.items[request.seq]
            return self.verdict(kind, reasons.MISSION_ITEM_BAD, request.seq)
        if isinstance(request, MissionRequestList):
            return MissionCount(count=len(held.items), mission_type=kind)
        self._uploads.pop(kind, None)
        reason = held.clear()
        if reason == reasons.OK:
            self._kept.keep(kind, held.items)
        return self.verdict(kind, reason)

    def verdict(self, kind: int, reason: int, item: int | None = None) -> MissionVerdict:
        """Return a verdict about the items of a kind; `item` is the index of a bad one."""
        return MissionVerdict(
            mission_id=self._mission.number if self._mission.items else 0,
            item=NO_ITEM if item is None else item,
            reason=reason,
            mission_type=kind,
        )

    def _begin(self, request: MissionCount, held: ItemStore, operator: str) -> Reply:
        kind = request.mission_type
        if request.count == 0:
            return self.verdict(kind, reasons.MISSION_EMPTY)
        if request.count > held.max_items:
            return self.verdict(kind, reasons.MISSION_TOO_LONG, held.max_items)
        self._uploads[kind] = ReceivedItems(request.count, operator)
        return MissionRequestInt(seq=0, mission_type=kind)

    def _collect(self, item: MissionItemInt, held: ItemStore, operator: str) -> Reply:
        kind = item.mission_type
        upload = self._uploads.get(kind)
        if upload is None or upload.operator != operator:
            return self.verdict(kind, reasons.MISSION_ITEM_BAD, item.seq)
        if not repeated(item, upload.items):
            if item.seq != len(upload.items) or upload.verdict is not None:
                return self.verdict(kind, reasons.MISSION_ITEM_BAD, item.seq)
            upload.items.append(item)
            if len(upload.items) == upload.count:
                bad, reason = held.put(tuple(upload.items))
                if reason == reasons.OK:
                    self._kept.keep(kind, held.items)
                upload.verdict = self.verdict(kind, reason, bad)
        return upload.verdict or MissionRequestInt(seq=len(upload.items), mission_type=kind)


def repeated(item: MissionItemInt, items: list[MissionItemInt]) -> bool:
    """Return whether an item repeats the last one; compared as text, so that NaN equals NaN."""
    return bool(items) and repr(items[-1]) == repr(item)
