"""Mission and fence: their upload, their files, and the drive from one stop to the next.

All of it is sans-I/O but the files: one of JSON for the mission, one for the fence.

- A mission sets one goal at a time in the core and checks it each tick, without an operator. A goal
  that ends before it is reached ends the mission with the same reason. Items without a goal wait,
  change the speed, or jump; each takes one tick at least. A mission starts in AUTO and keeps
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
from math import inf, isnan, radians
from types import MappingProxyType
from typing import Final, NamedTuple, Protocol, TypeAlias

import msgspec

from protocol.outcome import BY_PERSONS
from protocol.wire.enums import (
    FRAME_GLOBAL,
    FRAME_GLOBAL_INT,
    FRAME_GLOBAL_RELATIVE_ALT,
    FRAME_GLOBAL_RELATIVE_ALT_INT,
    FRAME_GLOBAL_TERRAIN_ALT,
    FRAME_GLOBAL_TERRAIN_ALT_INT,
    FRAME_LOCAL_ENU,
    FRAME_LOCAL_FLU,
    Command,
    MissionState,
    MissionType,
    Severity,
)
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
from robot.core.safety.fence import MAX_CORNERS, Fence
from robot.core.values import Goal
from robot.file_writer import Directory, StateFile, Ticket, sealed, text_in, unsealed
from robot.hosting import Core, SpeedLimit
from runtime.errors import LocalError
from runtime.units import UINT32

MAX_HOLD_S: Final = 3600.0
ENDLESS_MS: Final = UINT32
"""Hold time of an item at which the robot stays until an operator leads it on."""
MAX_REPEATS: Final = 1000
LEAST_SPEED_M_S: Final = 0.01
UNCHANGED: Final = -1.0
DEFAULT: Final = -2.0
"""Values of the speed in DO_CHANGE_SPEED besides speeds."""
GROUND_SPEEDS: Final = (0.0, 1.0)
"""Types of speed in DO_CHANGE_SPEED that a vehicle on the ground has."""
TOLERANCE_M: Final = 0.05
TOLERANCE_RAD: Final = radians(3.0)
"""Tolerances of items of common MAVLink that give none."""
FRAMES: Final = (
    FRAME_GLOBAL,
    FRAME_GLOBAL_INT,
    FRAME_GLOBAL_RELATIVE_ALT,
    FRAME_GLOBAL_RELATIVE_ALT_INT,
    FRAME_GLOBAL_TERRAIN_ALT,
    FRAME_GLOBAL_TERRAIN_ALT_INT,
    FRAME_LOCAL_ENU,
    FRAME_LOCAL_FLU,
)
"""Frames in which a client may have given the place of an item of common MAVLink; the robot keeps
them and reads x and y as metres in its own frame."""
LOITERS: Final = (Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TIME)
PLACED: Final = (Command.SIDESTEP_NAV_POSE, Command.NAV_WAYPOINT, *LOITERS)
"""Commands of items with a place."""


class MissionStop(NamedTuple):
    """A goal, None to stay, and the time to wait there."""

    goal: Goal | None
    hold_ms: int


def stop_of(item: MissionItemInt) -> MissionStop:
    """Return the stop that an item describes; the item need not be valid."""
    command = item.command
    if command not in PLACED:
        return MissionStop(None, in_ms(item.param1) if command == Command.NAV_DELAY else 0)
    place_m = item.x / PLACES_PER_M, item.y / PLACES_PER_M
    if command == Command.SIDESTEP_NAV_POSE:
        heading_rad = None if isnan(item.param4) else radians(item.param4)
        goal = Goal(*place_m, heading_rad, tidy(item.param2), radians(item.param3))
        return MissionStop(goal, in_ms(item.param1))
    hold_ms = ENDLESS_MS if command == Command.NAV_LOITER_UNLIM else in_ms(item.param1)
    radius_m = tidy(item.param2) if command == Command.NAV_WAYPOINT else 0.0
    # NaN and 0 stand for the usual tolerance; within the largest one is within any larger one
    tolerance_m = min(radius_m, modes.MAX_POSITION_TOLERANCE_M) if radius_m > 0.0 else TOLERANCE_M
    yaw_deg = 0.0 if command == Command.NAV_LOITER_TIME else item.param4
    heading_rad = heading_of(yaw_deg) if yaw_deg and not isnan(yaw_deg) else None
    return MissionStop(Goal(*place_m, heading_rad, tolerance_m, TOLERANCE_RAD), hold_ms)


def heading_of(yaw_deg: float) -> float:
    """Return the heading of a compass angle, for which x points east."""
    return radians(180.0 - (yaw_deg + 90.0) % 360.0)


def in_ms(time_s: float) -> int:
    """Return a time to wait in milliseconds; NaN is none."""
    return 0 if isnan(time_s) else round(1000.0 * time_s)


def stop_problem_of(item: MissionItemInt, machine: Machine, count: int) -> int:
    """Return why the robot cannot execute this item of `count`, or 0.

    NaN fails every comparison.
    """
    command = item.command
    if command in PLACED:
        is_own = command == Command.SIDESTEP_NAV_POSE
        if item.frame not in ((FRAME_LOCAL_FLU,) if is_own else FRAMES):
            return reasons.UNKNOWN_FRAME
        waits = command != Command.NAV_LOITER_UNLIM and (is_own or not isnan(item.param1))
        if waits and not 0.0 <= item.param1 <= MAX_HOLD_S:
            return reasons.HOLD_OUT_OF_RANGE
        goal = stop_of(item).goal
        return reasons.OK if goal is None else modes.goal_problem(machine, goal)
    if command == Command.NAV_DELAY:
        return reasons.OK if 0.0 <= item.param1 <= MAX_HOLD_S else reasons.HOLD_OUT_OF_RANGE
    if command == Command.DO_JUMP:
        target, repeats = item.param1, item.param2
        if not (1.0 <= target <= count and target == int(target)):
            return reasons.MISSION_ITEM_BAD
        whole = 0.0 <= repeats <= MAX_REPEATS and repeats == int(repeats)
        return reasons.OK if whole else reasons.PARAMETER_OUT_OF_RANGE
    if command == Command.DO_CHANGE_SPEED:
        speed_m_s = item.param2
        known = speed_m_s in (UNCHANGED, DEFAULT) or LEAST_SPEED_M_S <= speed_m_s <= inf
        known = known and item.param1 in GROUND_SPEEDS
        return reasons.OK if known else reasons.PARAMETER_OUT_OF_RANGE
    is_return = command == Command.NAV_RETURN_TO_LAUNCH
    return reasons.OK if is_return else reasons.UNKNOWN_COMMAND


def tidy(value: float) -> float:
    """Undo the rounding of a decimal number to float32, such as 0.005."""
    return float(f"{value:.7g}")


MAX_ITEMS: Final = 200
CURRENT: Final = -1
"""Item number that stands for the current item."""
ACTIVE: Final = (MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED)


class Stoppers(NamedTuple):
    """The names of those who stopped what another one had begun; empty otherwise."""

    goal: str = ""
    """It ended the goal."""
    hold: str = ""
    """It holds the robot, or has disarmed one that was driven by hand."""
    mission: str = ""
    """It ended the mission, or took it over."""


NOBODY: Final = Stoppers()


class MissionExecutor:
    """`items` are the uploaded ones; `number` counts missions; `current` is an index from 0.

    `starts` counts the accepted starts. Each of them drives every jump as often as it says again. A
    changed speed holds for all later items, until the mission ends.
    """

    max_items = MAX_ITEMS

    def __init__(self, core: Core) -> None:
        self.items: tuple[MissionItemInt, ...] = ()
        self.number = 0
        self.current = 0
        self.state = MissionState.NONE
        self.reason: int = reasons.OK
        self.starts = 0
        self.speed = SpeedLimit(core)
        self._core = core
        self._machine = core.state.machine
        self._stops: tuple[MissionStop, ...] = ()
        self._serial = 0  # serial number of the newest goal when the current item began
        self._begun = False  # whether the current item has begun
        self._drives = False  # whether that goal is the one of the current item
        self._jumped: dict[int, int] = {}  # how often each jump was taken since the start
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
            reason = stop_problem_of(item, self._machine, len(items))
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
        if refusal == reasons.OK:
            refusal = self._set_off(index, states.AUTO, now_ms)
        if refusal == reasons.OK:
            self.starts += 1
            self._jumped.clear()
            self.speed.set(None)
            for item in self.items[: index + 1]:
                self._change_speed(item)
        return refusal

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
        self._begun, self._drives, self._left_ms = False, False, None
        return reasons.OK

    def resume(self, now_ms: int) -> int:
        """Continue after a hold, in the mode before it."""
        machine = self._machine
        if machine.mode != states.HOLD:
            return reasons.OK
        if machine.resume_mode == states.SMART_RTL and modes.goal_is_active(machine):
            return self._core.command(CONTINUE, now_ms)
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
        self.speed.follow()
        elapsed_ms, self._last_ms = now_ms - self._last_ms, now_ms
        if not self.active:
            return
        if (end := self.reason_to_end()) != reasons.OK:
            self._fail(end)
        elif self._machine.mode == states.HOLD:
            self.state, self.reason = MissionState.PAUSED, reasons.BY_OPERATOR
        elif not self._begun:
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
            hold_left_ms=self._hold_left_ms,
            count=len(self.items),
            current=self.current,
            state=self.state,
            reason=self.reason,
            stopped_by=self.stopper(by),
        )

    @property
    def _hold_left_ms(self) -> int:
        """The rest of the hold time; 0 if there is none, or no end of it."""
        left_ms = self._left_ms or 0
        return left_ms if self.state == MissionState.HOLDING and left_ms < ENDLESS_MS else 0

    def _wait(self, elapsed_ms: int, now_ms: int) -> None:
        """Drive to the stop, then wait there until the hold time is over."""
        self.state, self.reason = MissionState.RUNNING, reasons.OK
        hold_ms = self._stops[self.current].hold_ms
        if self._left_ms is None:
            if self._drives and self._machine.goal_state != states.REACHED:
                return
            self._left_ms, elapsed_ms = hold_ms, 0
        self.state = MissionState.HOLDING
        self._left_ms -= 0 if hold_ms == ENDLESS_MS else elapsed_ms
        if self._left_ms > 0:
            return
        index = self._next()
        if index == len(self._stops):
            self.state = MissionState.DONE
            self.speed.release()
        else:
            self._go(index, now_ms)

    def _next(self) -> int:
        """Return the item after the current one: the target of a jump as often as it says."""
        item, done = self.items[self.current], self._jumped.get(self.current, 0)
        if item.command != Command.DO_JUMP or done >= item.param2:
            return self.current + 1
        self._jumped[self.current] = done + 1
        return int(item.param1) - 1

    def _go(self, index: int, now_ms: int) -> None:
        self.current = index
        refusal = self._set_off(index, self._mode(), now_ms)
        if refusal != reasons.OK:
            self._fail(refusal)

    def _mode(self) -> int:
        """Return the mode for the next goal: GUIDED while that is chosen, else AUTO."""
        return states.GUIDED if self._machine.mode == states.GUIDED else states.AUTO

    def _set_off(self, index: int, mode: int, now_ms: int) -> int:
        """Begin an item in the machine; a refusal changes nothing."""
        item, goal = self.items[index], self._stops[index].goal
        drives = goal is not None or item.command == Command.NAV_RETURN_TO_LAUNCH
        if goal is not None:
            refusal = self._core.drive_to(goal, mode, now_ms)
        elif drives:
            refusal = self._core.command(RETURN, now_ms)
        else:
            refusal = self._stay(mode, now_ms)
        if refusal == reasons.OK:
            self._change_speed(item)
            self.current = index
            self.state, self.reason = MissionState.RUNNING, reasons.OK
            self._serial = self._machine.serial
            self._begun, self._drives, self._left_ms = True, drives, None
        return refusal

    def _stay(self, mode: int, now_ms: int) -> int:
        """Begin an item without a goal; return a reason, 0 if done."""
        machine = self._machine
        refusal = modes.may_drive(machine, mode)
        if refusal == reasons.OK and modes.goal_is_active(machine):
            self._core.end_goal(reasons.REPLACED, now_ms)
        if refusal == reasons.OK and machine.mode != mode:
            refusal = self._core.command(mode_request(mode), now_ms)
        return refusal

    def _change_speed(self, item: MissionItemInt) -> None:
        if item.command == Command.DO_CHANGE_SPEED and item.param2 != UNCHANGED:
            self.speed.set(None if item.param2 == DEFAULT else item.param2)

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
        if self._drives and machine.goal_state in (states.STUCK, states.ABORTED):
            return machine.goal_reason
        if machine.mode == states.GUIDED and not machine.operator:
            return reasons.OPERATOR_LOST
        return reasons.OK

    def _fail(self, reason: int) -> None:
        self.state, self.reason = MissionState.FAILED, reason
        self.speed.release()

    def _rest(self, state: MissionState, current: int = 0) -> None:
        self.state, self.reason, self.current = state, reasons.OK, current

    def _missing(self, index: int) -> int:
        if not self._stops:
            return reasons.NO_MISSION
        return reasons.OK if 0 <= index < len(self._stops) else reasons.MISSION_ITEM_BAD


RETURN: Final = CommandRequest(
    request_id=0, param1=0.0, param2=0.0, command=Command.NAV_RETURN_TO_LAUNCH
)
CONTINUE: Final = CommandRequest(
    request_id=0, param1=1.0, param2=0.0, command=Command.DO_PAUSE_CONTINUE
)


def mode_request(mode: int) -> CommandRequest:
    """Return the command that changes the mode."""
    return CommandRequest(request_id=0, param1=0.0, param2=float(mode), command=Command.DO_SET_MODE)


INCLUSIONS: Final = (
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    Command.NAV_FENCE_CIRCLE_INCLUSION,
)
EXCLUSIONS: Final = (
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    Command.NAV_FENCE_CIRCLE_EXCLUSION,
)
CIRCLES: Final = (Command.NAV_FENCE_CIRCLE_INCLUSION, Command.NAV_FENCE_CIRCLE_EXCLUSION)


class FenceItems:
    """Stores the uploaded `items` of the fence; the core has the fence itself.

    A polygon is as many corners in a row as each of them says, a circle is one item. One outline is
    to stay in, any others to stay out of.
    """

    max_items = MAX_CORNERS

    def __init__(self, core: Core) -> None:
        self.items: tuple[MissionItemInt, ...] = ()
        self._core = core

    def put(self, items: tuple[MissionItemInt, ...]) -> tuple[int | None, int]:
        """Replace the fence; return the index of a bad item, if any, and a reason, 0 if done."""
        outlines: dict[bool, list[Fence]] = {True: [], False: []}
        at = 0
        while at < len(items):
            for index in range(at, at + size_of(items[at])):
                reason = fence_problem_of(items, index, at)
                if reason != reasons.OK:
                    return min(index, len(items) - 1), reason
            is_inclusion = items[at].command in INCLUSIONS
            if is_inclusion and outlines[True]:
                return at, reasons.FENCE_NOT_SIMPLE
            outlines[is_inclusion].append(fence_of(items[at : at + size_of(items[at])]))
            at += size_of(items[at])
        if not outlines[True]:
            return 0, reasons.FENCE_NOT_SIMPLE
        refusal = self._core.set_fence(outlines[True][0], tuple(outlines[False]))
        if refusal == reasons.OK:
            self.items = items
        return None, refusal

    def clear(self) -> int:
        """Remove the fence and return a reason, 0 if done."""
        self.items = ()
        return self._core.set_fence(None)


def size_of(item: MissionItemInt) -> int:
    """Return the number of items of the outline that begins with this one."""
    size = 1.0 if item.command in CIRCLES else item.param1
    return int(size) if 1.0 <= size <= MAX_CORNERS and size == int(size) else 1


def fence_problem_of(items: tuple[MissionItemInt, ...], index: int, first: int) -> int:
    """Return why an item cannot be part of the outline that begins with the `first` one, or 0."""
    if index >= len(items):
        return reasons.FENCE_NOT_SIMPLE
    item, kind = items[index], items[first].command
    if item.command not in (*INCLUSIONS, *EXCLUSIONS):
        return reasons.UNKNOWN_COMMAND
    if item.frame != FRAME_LOCAL_FLU:
        return reasons.UNKNOWN_FRAME
    whole = kind in CIRCLES or item.param1 == size_of(items[first])
    return reasons.OK if whole and item.command == kind else reasons.FENCE_NOT_SIMPLE


def fence_of(items: tuple[MissionItemInt, ...]) -> Fence:
    """Return the outline that the items describe."""
    radius_m = tidy(items[0].param1) if items[0].command in CIRCLES else 0.0
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
    pose = core.state.odometry.pose
    if not modes.is_permitted(core.state.machine, pose.x_m, pose.y_m):
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
