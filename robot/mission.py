"""Mission and fence: their upload, their files, and the drive from one stop to the next.

All of it is sans-I/O but the files: one of JSON for the mission, one for the fence.

- A mission sets one goal at a time in the core and checks it each tick, without an operator. A goal
  that ends before it is reached ends the mission with the same reason. It starts in AUTO and keeps
  a mode that is chosen later, also over a pause. In GUIDED it continues only while an operator
  sends heartbeats; losing the operator ends it, driving or waiting. Only a command leads from
  GUIDED back to AUTO.
- By MAVLink's mission protocol, items are uploaded one by one and accepted as a whole. Each request
  gets one frame as its answer. A client that receives no answer repeats its request; the repeated
  request is answered again but acted on once.
- After a restart the uploads are replayed. A fence that cannot be restored forbids arming until an
  operator clears it or uploads another. A restored mission never starts by itself.
"""

import json
from collections.abc import Mapping
from math import isnan, radians
from types import MappingProxyType
from typing import Final, NamedTuple, Protocol, TypeAlias

import msgspec

from protocol.outcome import BY_PERSONS
from protocol.wire.enums import FRAME_LOCAL_FLU, Command, MissionState, MissionType, Severity
from protocol.wire.limits import NO_ITEM, PLACES_PER_M
from protocol.wire.message import check
from protocol.wire.messages import (
    CommandRequest,
    MissionClearAll,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    MissionStatus,
    MissionVerdict,
)
from protocol.wire.reasons import reason_text
from robot.core import modes, reasons, states
from robot.core.modes import Machine
from robot.core.safety import fence as fences
from robot.core.safety.fence import MAX_CORNERS, Fence
from robot.core.values import Goal
from robot.file_writer import Directory, StateFile, Ticket, sealed, text_in, unsealed
from robot.hosting import Core
from runtime.errors import LocalError
from runtime.units import UINT32

MAX_HOLD_S: Final = 3600.0


class MissionStop(NamedTuple):
    """A goal, and the time to wait there."""

    goal: Goal
    hold_ms: int


def stop_of(item: MissionItemInt) -> MissionStop:
    """Return the stop that an item describes; the item need not be valid."""
    heading_rad = None if isnan(item.param4) else radians(item.param4)
    place_m = item.x / PLACES_PER_M, item.y / PLACES_PER_M
    goal = Goal(*place_m, heading_rad, tidy(item.param2), radians(item.param3))
    return MissionStop(goal, round(1000.0 * item.param1))


def stop_problem_of(item: MissionItemInt, machine: Machine) -> int:
    """Return why the robot cannot drive to this item, or 0; NaN fails every comparison."""
    if item.command != Command.SIDESTEP_NAV_POSE:
        return reasons.UNKNOWN_COMMAND
    if item.frame != FRAME_LOCAL_FLU:
        return reasons.UNKNOWN_FRAME
    if not 0.0 <= item.param1 <= MAX_HOLD_S:
        return reasons.HOLD_OUT_OF_RANGE
    return modes.goal_problem(machine, stop_of(item).goal)


def tidy(value: float) -> float:
    """Undo the rounding of a decimal number to float32, such as 0.005."""
    return float(f"{value:.7g}")


MAX_ITEMS: Final = 200
CURRENT: Final = -1
"""Item number that stands for the current item."""
ACTIVE: Final = (MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED)


class Stoppers(NamedTuple):
    """Who stopped what another person had begun: programs, or their names; empty otherwise."""

    goal: str = ""
    """It ended the goal."""
    hold: str = ""
    """It holds the robot."""
    mission: str = ""
    """It ended the mission, or took it over."""


NOBODY: Final = Stoppers()


class MissionExecutor:
    """`items` are the uploaded ones; `number` counts missions; `current` is an index from 0."""

    max_items = MAX_ITEMS

    def __init__(self, core: Core) -> None:
        self.items: tuple[MissionItemInt, ...] = ()
        self.number = 0
        self.current = 0
        self.state = MissionState.NONE
        self.reason: int = reasons.OK
        self._core = core
        self._machine = core.state.machine
        self._stops: tuple[MissionStop, ...] = ()
        self._serial = 0  # serial number of the mission's own goal
        self._under_way = False  # whether that goal belongs to the current item
        self._left_ms: int | None = None  # left of the hold time; None before arrival
        self._last_ms = 0

    @property
    def active(self) -> bool:
        """True while the mission is started and has not ended."""
        return self.state in ACTIVE

    # Upload: all items are checked before any is accepted.

    def put(self, items: tuple[MissionItemInt, ...]) -> tuple[int | None, int]:
        """Replace the items; return the index of a bad item, if any, and a reason, 0 if done."""
        if self.active:
            return None, reasons.DRIVING
        for index, item in enumerate(items):
            reason = stop_problem_of(item, self._machine)
            if reason != reasons.OK:
                return index, reason
        self.items = items
        self._stops = tuple(stop_of(item) for item in items)
        self.number = self.number % UINT32 + 1  # 0 means no mission
        self._rest(MissionState.READY)
        return None, reasons.OK

    def clear(self) -> int:
        """Remove all items and return a reason, 0 if done."""
        if self.active:
            return reasons.DRIVING
        self.items = self._stops = ()
        self._rest(MissionState.NONE)
        return reasons.OK

    # Requests of operators.

    def start(self, first: int, now_ms: int) -> int:
        """Start driving to an item now; CURRENT means the current item."""
        index = self.current if first == CURRENT else first
        refusal = self._missing(index)
        return self._set_off(index, states.AUTO, now_ms) if refusal == reasons.OK else refusal

    def jump(self, index: int, now_ms: int) -> int:
        """Make an item the current one: at once if active, else at the next start."""
        refusal = self._missing(index)
        if refusal != reasons.OK:
            return refusal
        if not self.active:
            self._rest(MissionState.READY, index)
            return reasons.OK
        if self._machine.mode != states.HOLD:
            return self._set_off(index, self._mode(), now_ms)
        if self._machine.serial == self._serial:
            self._core.end_goal(reasons.REPLACED, now_ms)
        self.current = index
        self._under_way, self._left_ms = False, None
        return reasons.OK

    def resume(self, now_ms: int) -> int:
        """Continue after a hold, in the mode before it."""
        machine = self._machine
        if machine.mode != states.HOLD:
            return reasons.OK
        mode = machine.resume_mode if machine.resume_mode == states.GUIDED else states.AUTO
        refusal = modes.may_drive(machine, mode)
        if refusal == reasons.OK:
            refusal = self._core.command(mode_request(mode), now_ms)
        return refusal

    def abort(self, now_ms: int) -> int:
        """Stop; the mission can be started again."""
        self._core.end_goal(reasons.BY_OPERATOR, now_ms)
        self._fail(reasons.BY_OPERATOR)
        return reasons.OK

    # Execution.

    def step(self, now_ms: int) -> None:
        """Run one tick, before the core's step."""
        elapsed_ms, self._last_ms = now_ms - self._last_ms, now_ms
        if not self.active:
            return
        if (end := self.reason_to_end()) != reasons.OK:
            self._fail(end)
        elif self._machine.mode == states.HOLD:
            self.state, self.reason = MissionState.PAUSED, reasons.BY_OPERATOR
        elif not self._under_way:
            self._go(self.current, now_ms)
        else:
            self._wait(elapsed_ms, now_ms)

    def stopper(self, by: Stoppers) -> str:
        """Return who has paused or ended the mission."""
        if self.state == MissionState.PAUSED:
            return by.hold
        return by.mission if self.state == MissionState.FAILED and self.reason in BY_PERSONS else ""

    def status(self, time_ns: int, by: Stoppers = NOBODY) -> MissionStatus:
        """Return the mission's status, stamped `time_ns`, with the name of who stopped it."""
        return MissionStatus(
            time_ns=time_ns,
            mission_id=self.number if self.items else 0,
            hold_left_ms=(self._left_ms or 0) if self.state == MissionState.HOLDING else 0,
            count=len(self.items),
            current=self.current,
            state=self.state,
            reason=self.reason,
            stopped_by=self.stopper(by),
        )

    def _wait(self, elapsed_ms: int, now_ms: int) -> None:
        """Drive to the stop, then wait there until the hold time is over."""
        self.state, self.reason = MissionState.RUNNING, reasons.OK
        if self._left_ms is None:
            if self._machine.goal_state != states.REACHED:
                return
            self._left_ms, elapsed_ms = self._stops[self.current].hold_ms, 0
        self.state = MissionState.HOLDING
        self._left_ms -= elapsed_ms
        if self._left_ms > 0:
            return
        if self.current + 1 == len(self._stops):
            self.state = MissionState.DONE
        else:
            self._go(self.current + 1, now_ms)

    def _go(self, index: int, now_ms: int) -> None:
        self.current = index
        refusal = self._set_off(index, self._mode(), now_ms)
        if refusal != reasons.OK:
            self._fail(refusal)

    def _mode(self) -> int:
        """Return the mode for the next goal: GUIDED while that is chosen, else AUTO."""
        return states.GUIDED if self._machine.mode == states.GUIDED else states.AUTO

    def _set_off(self, index: int, mode: int, now_ms: int) -> int:
        """Set the goal of an item in the machine; a refusal changes nothing."""
        refusal = self._core.drive_to(self._stops[index].goal, mode, now_ms)
        if refusal == reasons.OK:
            self.current = index
            self.state, self.reason = MissionState.RUNNING, reasons.OK
            self._serial = self._machine.serial
            self._under_way, self._left_ms = True, None
        return refusal

    def reason_to_end(self) -> int:
        """Return the reason that ends an active mission now, or 0."""
        machine = self._machine
        if machine.serial != self._serial:
            return reasons.REPLACED
        if machine.vehicle == states.EMERGENCY_STOP:
            return reasons.BY_EMERGENCY_STOP
        if machine.vehicle != states.ACTIVE:
            return machine.vehicle_reason or reasons.DISARMED
        if machine.mode == states.MANUAL:
            return reasons.BY_HAND
        if self._under_way and machine.goal_state in (states.STUCK, states.ABORTED):
            return machine.goal_reason
        if machine.mode == states.GUIDED and not machine.operator:
            return reasons.OPERATOR_LOST
        return reasons.OK

    def _fail(self, reason: int) -> None:
        self.state, self.reason = MissionState.FAILED, reason

    def _rest(self, state: MissionState, current: int = 0) -> None:
        self.state, self.reason, self.current = state, reasons.OK, current

    def _missing(self, index: int) -> int:
        if not self._stops:
            return reasons.NO_MISSION
        return reasons.OK if 0 <= index < len(self._stops) else reasons.MISSION_ITEM_BAD


def mode_request(mode: int) -> CommandRequest:
    """Return the command that changes the mode."""
    return CommandRequest(request_id=0, param1=0.0, param2=float(mode), command=Command.DO_SET_MODE)


CORNER: Final = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION
CIRCLE: Final = Command.NAV_FENCE_CIRCLE_INCLUSION


class FenceItems:
    """Stores the uploaded `items` of the fence; the core has the fence itself."""

    max_items = MAX_CORNERS

    def __init__(self, core: Core) -> None:
        self.items: tuple[MissionItemInt, ...] = ()
        self._core = core

    def put(self, items: tuple[MissionItemInt, ...]) -> tuple[int | None, int]:
        """Replace the fence; return the index of a bad item, if any, and a reason, 0 if done."""
        kind = items[0].command
        for index, item in enumerate(items):
            reason = fence_problem_of(item, kind, len(items))
            if reason != reasons.OK:
                return index, reason
        refusal = self._core.set_fence(fence_of(items))
        if refusal == reasons.OK:
            self.items = items
        return None, refusal

    def clear(self) -> int:
        """Remove the fence and return a reason, 0 if done."""
        self.items = ()
        return self._core.set_fence(None)


def fence_problem_of(item: MissionItemInt, kind: int, count: int) -> int:
    """Return why an item cannot be part of a fence of this kind, or 0."""
    if item.command not in (CORNER, CIRCLE):
        return reasons.UNKNOWN_COMMAND
    if item.frame != FRAME_LOCAL_FLU:
        return reasons.UNKNOWN_FRAME
    whole = count == 1 if kind == CIRCLE else item.param1 == count
    return reasons.OK if whole and item.command == kind else reasons.FENCE_NOT_SIMPLE


def fence_of(items: tuple[MissionItemInt, ...]) -> Fence:
    """Return the fence that the items describe."""
    radius_m = tidy(items[0].param1) if items[0].command == CIRCLE else 0.0
    xs_m, ys_m = (tuple(place / PLACES_PER_M for place in places) for places in places_of(items))
    return Fence(xs_m, ys_m, radius_m)


def places_of(items: tuple[MissionItemInt, ...]) -> tuple[list[int], list[int]]:
    """Return the x and y coordinates of the items, in units of 1 / PLACES_PER_M metres."""
    return [item.x for item in items], [item.y for item in items]


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


TransferRequest: TypeAlias = (
    MissionCount | MissionItemInt | MissionRequestList | MissionRequestInt | MissionClearAll
)
TransferReply: TypeAlias = MissionCount | MissionRequestInt | MissionItemInt | MissionVerdict


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

    def __init__(self, mission: MissionExecutor, fence: ItemStore, kept: MissionStore) -> None:
        self._mission = mission
        self._kept = kept
        self._held: dict[int, ItemStore] = {MissionType.MISSION: mission, MissionType.FENCE: fence}
        self._uploads: dict[int, ReceivedItems] = {}

    def receive(self, request: TransferRequest, operator: str = "") -> TransferReply:
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

    def _begin(self, request: MissionCount, held: ItemStore, operator: str) -> TransferReply:
        kind = request.mission_type
        if request.count == 0:
            return self.verdict(kind, reasons.MISSION_EMPTY)
        if request.count > held.max_items:
            return self.verdict(kind, reasons.MISSION_TOO_LONG, held.max_items)
        self._uploads[kind] = ReceivedItems(request.count, operator)
        return MissionRequestInt(seq=0, mission_type=kind)

    def _collect(self, item: MissionItemInt, held: ItemStore, operator: str) -> TransferReply:
        kind = item.mission_type
        upload = self._uploads.get(kind)
        if upload is None or upload.operator != operator:
            return self.verdict(kind, reasons.MISSION_ITEM_BAD, item.seq)
        if not is_repeated(item, upload.items):
            if item.seq != len(upload.items) or upload.verdict is not None:
                return self.verdict(kind, reasons.MISSION_ITEM_BAD, item.seq)
            upload.items.append(item)
            if len(upload.items) == upload.count:
                bad, reason = held.put(tuple(upload.items))
                if reason == reasons.OK:
                    self._kept.keep(kind, held.items)
                upload.verdict = self.verdict(kind, reason, bad)
        return upload.verdict or MissionRequestInt(seq=len(upload.items), mission_type=kind)


def is_repeated(item: MissionItemInt, items: list[MissionItemInt]) -> bool:
    """Return whether an item repeats the last one; compared as text, so that NaN equals NaN."""
    return bool(items) and repr(items[-1]) == repr(item)


Exchange: TypeAlias = tuple[TransferRequest, TransferReply]


def restore_items(
    kept: MissionStore, transfers: Transfers, core: Core
) -> tuple[list[Exchange], list[tuple[Severity, str]]]:
    """Replay the uploads of fence and mission, in this order.

    Return the requests with their answers, up to the verdict that ends each upload, and the texts
    for the operators.
    """
    exchanges: list[Exchange] = []
    texts: list[tuple[Severity, str]] = []
    for kind in NAMES:
        try:
            items = kept.found(kind)
        except UnreadableItemsError as error:
            texts.append((Severity.ERROR, lose_items(kind, core, str(error))))
            continue
        if not items:
            continue
        requests: list[TransferRequest] = [MissionCount(count=len(items), mission_type=kind)]
        for request in requests + list(items):
            answer = transfers.receive(request)
            exchanges.append((request, answer))
            if isinstance(answer, MissionVerdict):
                break
        texts.append(report_replay(kind, items, answer, core))
    return exchanges, texts


def report_replay(
    kind: int, items: Items, answer: TransferReply, core: Core
) -> tuple[Severity, str]:
    """Return the severity and text for the result of a replayed upload."""
    why = refusal_in(answer)
    if why:
        return Severity.ERROR, lose_items(kind, core, why)
    if kind == MissionType.MISSION:
        count = f"{len(items)} item{'' if len(items) == 1 else 's'}"
        return Severity.INFO, f"mission restored, {count}, not started"
    fence, pose = core.state.machine.fence, core.state.odometry.pose
    if fence is not None and not fences.inside(fence, pose.x_m, pose.y_m):
        return Severity.WARNING, "fence restored, robot OUTSIDE of it: lift it to arm"
    return Severity.INFO, "fence restored"


def lose_items(kind: int, core: Core, why: str) -> str:
    """Return the text for items that cannot be restored; for a fence, forbid arming."""
    if kind != MissionType.FENCE:
        return f"saved {NAMES[kind]} NOT restored: {why}"
    core.lose_fence()
    return f"saved fence LOST: arming is refused until `fence off` or a new fence: {why}"


def refusal_in(answer: TransferReply) -> str:
    """Return why the items were refused; empty if they were accepted."""
    if not isinstance(answer, MissionVerdict):
        return "an item is stored twice"
    if answer.reason == reasons.OK:
        return ""
    item = "" if answer.item == NO_ITEM else f"item {answer.item + 1}: "
    return item + reason_text(answer.reason)
