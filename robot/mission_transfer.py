"""MAVLink's mission protocol: items are uploaded one by one and accepted as a whole.

Sans-I/O. Each request gets one frame as its answer. A client that receives no answer repeats its
request; the repeated request is answered again but acted on once.

Restore fence and mission after a restart by replaying their upload.

A fence that cannot be restored forbids arming until an operator clears it or uploads another. A
restored mission never starts by itself.

Store mission and fence items in one JSON file each, to survive a restart.
"""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple, Protocol, TypeAlias

import msgspec

from protocol.wire.enums import MissionType, Severity
from protocol.wire.message import check
from protocol.wire.messages import (
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionVerdict,
)
from protocol.wire.reasons import reason_text
from robot.core import reasons
from robot.core.safety import fence as fences
from robot.file_writer import Directory, StateFile, Ticket, sealed, text_in, unsealed
from robot.hosting import Core
from robot.mission import Mission
from runtime.errors import LocalError

NAMES: Final[Mapping[int, str]] = MappingProxyType(
    {MissionType.FENCE: "fence", MissionType.MISSION: "mission"}
)
"""The stored kinds in the order of their restoration: a mission must lie within the fence."""

Items = tuple[MissionItemInt, ...]


class UnreadableItemsError(Exception):
    """The stored items cannot be used; the text contains the file and the reason."""


class MissionStore:
    """The item files of a directory; without a path nothing is stored."""

    def __init__(self, directory: Directory) -> None:
        self._files: dict[int, StateFile | None] = {
            kind: directory.file(name) for kind, name in NAMES.items()
        }

    def ticket(self, kind: int) -> Ticket | None:
        """Return the ticket of the newest write, or None if nothing is stored."""
        file = self._files.get(kind)
        return None if file is None else file.ticket

    def keep(self, kind: int, items: Items) -> None:
        """Store these items instead of the former ones; without items remove the file."""
        file = self._files.get(kind)
        if file is not None:
            file.put(sealed(text_of(items)) if items else None)

    def found(self, kind: int) -> Items:
        """Return the items of an earlier run; raise UnreadableItemsError if they cannot be read."""
        file = self._files.get(kind)
        if file is None:
            return ()
        try:
            text = text_in(file.path)
            items = tuple(item_of(row) for row in unsealed(text))
            if not items:
                raise ValueError("it contains no items")
        except FileNotFoundError:
            file.found(None)
            return ()
        except (OSError, ValueError, TypeError, RecursionError, LocalError) as error:
            raise UnreadableItemsError(f"{file.path}: {error}") from error
        file.found(text)
        return items


def text_of(items: Items) -> str:
    """Return JSON with one item per line, in which NaN is written as Python does."""
    rows = ",\n".join(json.dumps(msgspec.structs.asdict(item)) for item in items)
    return f"[\n{rows}\n]"


def item_of(row: object) -> MissionItemInt:
    """Return the item in a JSON object with exactly its fields.

    Raises ValueError, TypeError or LocalError.
    """
    names = MissionItemInt.__struct_fields__
    if not isinstance(row, dict) or row.keys() != set(names):
        raise ValueError(f"not an item of this version, which has {', '.join(names)}")
    try:
        item = msgspec.convert(row, MissionItemInt)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None
    check(item)
    return item


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


Exchange: TypeAlias = tuple[Request, Reply]


class Restored(NamedTuple):
    """The replayed requests with their answers, and texts for the operators."""

    exchange: list[Exchange]
    words: list[tuple[Severity, str]]


def restored(kept: MissionStore, transfers: Transfers, core: Core) -> Restored:
    """Restore fence and mission, in this order."""
    done = Restored([], [])
    for kind in NAMES:
        try:
            items = kept.found(kind)
        except UnreadableItemsError as error:
            done.words.append((Severity.ERROR, lost(kind, core, str(error))))
            continue
        if items:
            exchange = replay(transfers, kind, items)
            done.words.append(outcome(kind, items, exchange[-1][1], core))
            done.exchange.extend(exchange)
    return done


def replay(transfers: Transfers, kind: int, items: Items) -> list[Exchange]:
    """Replay an upload until the verdict that ends it."""
    exchange: list[Exchange] = []
    requests: list[Request] = [MissionCount(count=len(items), mission_type=kind), *items]
    for request in requests:
        exchange.append((request, transfers.receive(request)))
        if isinstance(exchange[-1][1], MissionVerdict):
            break
    return exchange


def outcome(kind: int, items: Items, answer: Reply, core: Core) -> tuple[Severity, str]:
    """Return the severity and text for the result of a replayed upload."""
    why = refusal(answer)
    if why:
        return Severity.ERROR, lost(kind, core, why)
    if kind == MissionType.MISSION:
        count = f"{len(items)} item{'' if len(items) == 1 else 's'}"
        return Severity.INFO, f"mission restored, {count}, not started"
    fence, pose = core.state.machine.fence, core.state.odometry.pose
    if fence is not None and not fences.inside(fence, pose.x_m, pose.y_m):
        return Severity.WARNING, "fence restored, robot OUTSIDE of it: lift it to arm"
    return Severity.INFO, "fence restored"


def lost(kind: int, core: Core, why: str) -> str:
    """Return the text for items that cannot be restored; for a fence, forbid arming."""
    if kind != MissionType.FENCE:
        return f"saved {NAMES[kind]} NOT restored: {why}"
    core.lose_fence()
    return f"saved fence LOST: arming is refused until `fence off` or a new fence: {why}"


def refusal(answer: Reply) -> str:
    """Return why the items were refused; empty if they were accepted."""
    if not isinstance(answer, MissionVerdict):
        return "an item is stored twice"
    if answer.reason == reasons.OK:
        return ""
    item = "" if answer.item == NO_ITEM else f"item {answer.item + 1}: "
    return item + reason_text(answer.reason)
